//! Soft objects between rigid fingers: the linear model and the network against finite elements.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use ruffini_core::{
    compliance::{Compliance, ComplianceOptions},
    deformation::{Deformation, Law, Moduli, Press, SoftBody},
    fem::{Fem, FemOptions},
    geometry::Shape,
    objects::tets_within,
    surrogate::soft::SoftSurrogate,
};

const MODULI: Moduli = Moduli { young: 1e5, poisson: 0.45 };
const FRICTION: f64 = 0.8;
const RADIUS: f64 = 0.02;

fn ball() -> Shape {
    Shape::Sphere { radius: RADIUS }
}

fn half_extents() -> Vector3<f64> {
    Vector3::new(0.0104, 0.0126, 0.002)
}

/// Poses of two fingers' boxes, each `depth` (m) past first contact with the ball.
fn closed(depth: f64) -> Vec<Isometry3<f64>> {
    let flip = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let away = RADIUS - depth + half_extents().z;
    let first = Isometry3::translation(0.0, 0.0, -away);
    vec![first, Isometry3::translation(0.0, 0.0, away) * flip]
}

fn squeeze(depths: &[f64]) -> Press {
    let finger = Shape::Cuboid { half_extents: half_extents() };
    Press::along(vec![finger; 2], depths.iter().map(|&d| closed(d)).collect()).unwrap()
}

fn body(nodes: usize) -> SoftBody {
    let mesh = tets_within(&ball(), nodes).unwrap();
    SoftBody::new(mesh, Law::default(), MODULI, &[]).unwrap()
}

fn network(moduli: Moduli) -> SoftSurrogate {
    SoftSurrogate::named("soft", &ball(), moduli, FRICTION).unwrap()
}

/// Force of the first finger along its normal (N): the sum over the nodes on its side.
fn force(answer: &Deformation, places: &[nalgebra::Point3<f64>]) -> f64 {
    let nodes = places.iter().zip(&answer.contact_force);
    nodes.filter(|(place, _)| place.z < 0.0).map(|(_, force)| force.z).sum()
}

fn relative(found: &[Vector3<f64>], truth: &[Vector3<f64>]) -> f64 {
    let squares = |v: &mut dyn Iterator<Item = f64>| v.sum::<f64>().sqrt();
    let apart = squares(&mut found.iter().zip(truth).map(|(a, b)| (a - b).norm_squared()));
    apart / squares(&mut truth.iter().map(Vector3::norm_squared))
}

#[test]
fn a_free_body_answers_small_squeezes_as_finite_elements_do() {
    let (body, press) = (body(800), squeeze(&[4e-4]));
    let options = ComplianceOptions { friction: FRICTION, corrections: 0 };
    let linear = Compliance::free(body.clone(), options).unwrap();
    let options = FemOptions { friction: FRICTION, ..FemOptions::default() };
    let truth = Fem::new(body.clone(), options).unwrap();
    let [found, truth] = [linear.solve_path(&press), truth.solve_path(&press)]
        .map(|mut answers| answers.pop().unwrap().unwrap());
    let places = &body.mesh().vertices;
    let [f, g] = [&found, &truth].map(|answer| force(answer, places));
    // The depth is 2 % of the ball's radius; the effect of large strain is of that order.
    assert!((f / g - 1.0).abs() < 0.03, "{f} N against {g} N");
    let error = relative(&found.displacement, &truth.displacement);
    assert!(error < 0.05, "displacement is off by {error}");
}

#[test]
fn a_free_body_without_contact_does_not_move() {
    let options = ComplianceOptions { friction: FRICTION, corrections: 0 };
    let linear = Compliance::free(body(300), options).unwrap();
    for answer in [
        linear.solve_path(&squeeze(&[-1e-4])).pop().unwrap().unwrap(),
        network(MODULI).solve_path(&squeeze(&[-1e-4])).pop().unwrap().unwrap(),
    ] {
        assert!(answer.displacement.iter().all(|u| *u == Vector3::zeros()));
        assert!(answer.von_mises.iter().all(|&stress| stress == 0.0));
        assert!(answer.contact_force.iter().all(|force| *force == Vector3::zeros()));
    }
}

#[test]
fn a_bonded_body_is_not_a_free_one() {
    let mesh = tets_within(&ball(), 300).unwrap();
    let bonded = SoftBody::new(mesh, Law::default(), MODULI, &[0, 1, 2]).unwrap();
    let error = Compliance::free(bonded, ComplianceOptions::default()).err().unwrap().to_string();
    assert_eq!(error, "fixed: found 3 nodes, expected none: a free body");
}

#[test]
fn the_fingers_forces_are_action_and_reaction() {
    let network = network(MODULI);
    for answer in network.solve_path(&squeeze(&[5e-4, 1.5e-3])) {
        let [a, b] = network.of_fingers(&half_extents(), &answer.unwrap());
        let (size, left) = (a.force.norm(), (a.force + b.force).norm());
        // Rounding of single precision over some hundred nodes.
        assert!(size > 0.1 && left < 1e-4 * size, "{left} N of {size} N are left");
        assert!(a.force.z > 0.0 && b.force.z < 0.0);
    }
}

#[test]
fn stress_and_force_go_with_youngs_modulus_and_displacement_does_not() {
    let press = squeeze(&[1e-3]);
    let [stiff, soft] = [1e5, 4e4].map(|young| {
        network(Moduli { young, ..MODULI }).solve_path(&press).pop().unwrap().unwrap()
    });
    let error = relative(&soft.displacement, &stiff.displacement);
    // The contact is solved to 1e-5 of the forces, and the network computes in single precision.
    assert!(error < 1e-3, "displacement differs by {error}");
    let scaled = |field: &[f64]| field.iter().map(|s| Vector3::x() * 0.4 * *s).collect::<Vec<_>>();
    let stress: Vec<_> = soft.von_mises.iter().map(|s| Vector3::x() * *s).collect();
    let error = relative(&stress, &scaled(&stiff.von_mises));
    assert!(error < 1e-3, "stress differs by {error}");
    let force: Vec<_> = stiff.contact_force.iter().map(|f| f * 0.4).collect();
    let error = relative(&soft.contact_force, &force);
    assert!(error < 1e-3, "contact force differs by {error}");
}

#[test]
fn the_network_answers_a_ball_that_it_never_saw_as_finite_elements_do() {
    let network = network(MODULI);
    let truth = body(network.card().linear_nodes);
    let places = truth.mesh().vertices.clone();
    let options = FemOptions { friction: FRICTION, ..FemOptions::default() };
    let truth = Fem::new(truth, options).unwrap();
    let press = squeeze(&[1e-3]);
    let truth = truth.solve_path(&press).pop().unwrap().unwrap();
    let found = network.solve_path(&press).pop().unwrap().unwrap();
    let force_of = |answer, places: &[_]| force(answer, places);
    let f = force_of(&found, &network.body().mesh().vertices);
    let g = force_of(&truth, &places);
    // Three times the median error on objects outside the training data.
    let bound = 3.0 * network.card().novel.network.force.unwrap().median;
    assert!((f / g - 1.0).abs() < bound, "{f} N against {g} N, bound {bound}");
}

#[test]
fn presses_that_are_no_squeezes_are_refused() {
    let network = network(MODULI);
    let ball = Press::along(vec![ball()], vec![vec![Isometry3::identity()]]).unwrap();
    let error = network.solve_path(&ball).pop().unwrap().unwrap_err().to_string();
    assert_eq!(error, "shapes: found 1 shapes, expected two equal cuboids: the fingers");
    let plane = SoftSurrogate::named("soft", &Shape::HalfSpace, MODULI, FRICTION);
    assert!(plane.err().unwrap().to_string().contains("a half-space"));
    let other = SoftSurrogate::named("hard", &self::ball(), MODULI, FRICTION);
    assert!(other.err().unwrap().to_string().contains("one of soft"));
}
