//! Linear elasticity with contact at the nodes, against contact at the points of every face.

use std::f64::consts::{FRAC_PI_4, SQRT_2};

use nalgebra::{Isometry3, Point3, Quaternion, UnitQuaternion, Vector3};
use ruffini_core::{
    Error,
    compliance::{
        Compliance, ComplianceOptions,
        nodal::{ContactSolution, Nodal},
    },
    deformation::{DeformationModel, Law, Moduli, Press, SoftBody},
    geometry::{PadMesh, Shape},
    sensor::Sensor,
};

use crate::bodies::{even, grid, nodes_where};

const GEL: Moduli = Moduli { young: 3e5, poisson: 0.47 };
const FRICTION: f64 = 0.8;
const MM: f64 = 1e-3;

fn pad(nodes: usize) -> PadMesh {
    Sensor::named("gelsight-mini").unwrap().pad(nodes).unwrap()
}

fn linear(pad: &PadMesh, friction: f64) -> Compliance {
    let body = SoftBody::new(pad.mesh.clone(), Law::default(), GEL, &pad.base).unwrap();
    Compliance::new(body, ComplianceOptions { friction, corrections: 0 }).unwrap()
}

fn nodal(friction: f64) -> Nodal {
    linear(&pad(600), friction).at_nodes().unwrap()
}

/// Pose of a ball whose lowest point is at (x, z) mm, beside the nodes.
fn ball(radius: f64, x: f64, z: f64) -> Vec<Isometry3<f64>> {
    vec![Isometry3::translation((x + 0.2) * MM, 0.3 * MM, z * MM + radius)]
}

fn press(radius: f64, path: Vec<Vec<Isometry3<f64>>>) -> Press {
    Press::along(vec![Shape::Sphere { radius }], path).unwrap()
}

/// Press straight down by `depth` mm.
fn down(radius: f64, depth: f64) -> Press {
    press(radius, vec![ball(radius, 0.0, 0.1), ball(radius, 0.0, -depth)])
}

fn gap(found: &ContactSolution, other: &ContactSolution) -> f64 {
    (found.wrench.force - other.wrench.force).norm() / other.wrench.force.norm()
}

#[test]
fn large_contacts_weigh_as_at_points() {
    let (fine, coarse) = (pad(1500), pad(600));
    let points = linear(&fine, FRICTION);
    let models = [points.at_nodes().unwrap(), points.at_coarse_nodes(&fine, &coarse).unwrap()];
    for (radius, depth) in [(0.03, 0.9), (0.012, 1.2)] {
        let exact = points.solve_path(&down(radius, depth)).pop().unwrap().unwrap().wrench.force;
        for (model, bound) in models.iter().zip([0.06, 0.06]) {
            let found = model.settle(&down(radius, depth)).unwrap().wrench.force;
            let error = (found - exact).norm() / exact.norm();
            assert!(error < bound, "radius {radius} m: {found} N against {exact} N");
        }
    }
}

#[test]
fn no_node_is_left_inside_and_none_is_pulled() {
    let (model, radius) = (nodal(FRICTION), 0.012);
    let press = press(radius, vec![ball(radius, 0.0, 0.1), ball(radius, 0.3, -1.0)]);
    let answer = model.solve_path(&press).pop().unwrap().unwrap();
    let centre = answer.poses[0].translation.vector;
    let (mut touching, mut deepest) = (0, 0f64);
    let nodes = model.body().mesh().vertices.iter().zip(&answer.displacement);
    for ((place, moved), force) in nodes.zip(&answer.contact_force) {
        let away = place.coords + moved - centre;
        deepest = deepest.max(radius - away.norm());
        if *force == Vector3::zeros() {
            continue;
        }
        touching += 1;
        let normal = away.normalize();
        // The ball pushes the pad away from the ball's centre.
        let push = force.dot(&normal);
        let along = (force - normal * push).norm();
        assert!(push > 0.0 && along <= FRICTION * push * 1.001, "{force} N at {place}");
    }
    assert!(touching > 10, "{touching} nodes touch");
    // The softness is 2 µm at a pressure of Young's modulus; the pressure is below that.
    assert!(deepest < 2e-6, "a node is {deepest:.1e} m inside");
}

#[test]
fn a_press_goes_on_where_another_ended() {
    let (model, radius) = (nodal(FRICTION), 0.012);
    let way: Vec<_> =
        (0..6).map(|i| ball(radius, 0.1 * f64::from(i), -0.2 * f64::from(i))).collect();
    let whole = model.settle(&press(radius, way.clone())).unwrap();
    let first = model.settle(&press(radius, way[..4].to_vec())).unwrap();
    let rest = press(radius, way[4..].to_vec()).after(first.history).unwrap();
    let gap = gap(&model.settle(&rest).unwrap(), &whole);
    assert!(gap < 1e-6, "forces differ by {gap:.1e}");
}

#[test]
fn a_ball_that_is_dragged_slides_at_the_limit() {
    let friction = 0.3;
    let (model, radius) = (nodal(friction), 0.012);
    let way = (0..12).map(|i| ball(radius, 0.15 * f64::from(i), if i == 0 { 0.1 } else { -0.6 }));
    let force = model.settle(&press(radius, way.collect())).unwrap().wrench.force;
    // The ball's curvature inclines the normals, and with them the friction limit.
    let ratio = force.x / -force.z;
    assert!((ratio / friction - 1.0).abs() < 0.15, "{ratio} of the normal force");
    let smooth = nodal(0.0).settle(&down(radius, 0.6)).unwrap().wrench.force;
    assert!(smooth.xy().norm() < 0.02 * smooth.norm(), "{smooth} N without friction");
}

#[test]
fn a_force_is_met() {
    let (model, radius) = (nodal(FRICTION), 0.012);
    let poses = ball(radius, 0.0, 1.0);
    let shapes = vec![Shape::Sphere { radius }];
    let press = Press::with_force(shapes, poses, 5.0, -Vector3::z()).unwrap();
    let force = model.settle(&press).unwrap().wrench.force;
    assert!((force.z + 5.0).abs() < 1e-5, "{force} N");
}

#[test]
fn without_a_touch_nothing_moves() {
    let model = nodal(FRICTION);
    let path = [1.0, 0.01, -0.3].map(|z| ball(0.012, 0.0, z)).to_vec();
    let frames: Vec<_> =
        model.solve_path(&press(0.012, path)).into_iter().map(Result::unwrap).collect();
    let (above, touching) = (&frames[1], &frames[2]);
    assert!(above.displacement.iter().all(|u| *u == Vector3::zeros()));
    assert!(above.contact_force.iter().all(|f| *f == Vector3::zeros()));
    assert!(touching.wrench.force.z < -0.1, "{} N on the way on", touching.wrench.force);
}

#[test]
fn histories_of_other_models_are_refused() {
    let pad = pad(600);
    let points = linear(&pad, FRICTION);
    let model = points.at_nodes().unwrap();
    let history = |press: &Press| points.solve_path(press).pop().unwrap().unwrap().history;
    let press = down(0.012, 0.5);
    let mixed = press.clone().after(history(&press)).unwrap();
    assert!(model.settle(&mixed).unwrap_err().to_string().contains("history"));
    let own = model.settle(&press).unwrap().history;
    let mixed = press.after(own).unwrap();
    assert!(points.solve_path(&mixed)[0].as_ref().unwrap_err().to_string().contains("history"));
}

#[test]
fn a_thin_shape_moved_through_the_pad_is_not_unfelt() {
    let model = nodal(0.05);
    let ring = |wall: f64| {
        let outer = 2.5 * wall * MM;
        Shape::Annulus { outer, inner: outer - wall * MM, half_height: 0.5 * outer }
    };
    let force = |shape: &Shape, i: i32, z: f64| {
        let way = 0.17 * f64::from(i);
        let at = |z: f64| vec![Isometry3::translation((way - 1.0) * MM, 0.31 * MM, z * MM)];
        let press = Press::along(vec![shape.clone()], vec![at(2.0), at(z)]).unwrap();
        model.settle(&press).map(|found| found.wrench.force.norm())
    };
    let tip = Shape::Sphere { radius: 0.5 * MM };
    for shape in [ring(0.1), ring(0.5), ring(0.7), tip.clone()] {
        for i in 0..12 {
            let unfelt = force(&shape, i, -8.0).is_ok_and(|force| force < 1e-6);
            assert!(!unfelt, "{shape:?} at place {i} went through without a force");
        }
    }
    // A model that refuses all would pass so far. At these places a wide ball is answered, and the
    // tip where a node is near.
    let wide = Shape::Sphere { radius: 4.0 * MM };
    for i in 0..12 {
        let force = force(&wide, i, 3.7).unwrap();
        assert!(force > 0.1, "{force} N of a wide ball at place {i}");
    }
    let answered = (0..12).filter(|&i| force(&tip, i, 0.2).is_ok_and(|force| force > 0.01)).count();
    assert!(answered >= 3, "of a tip 0.3 mm deep at 12 places, {answered} are answered");
}

/// A block of 8 x 8 x 4 mm, a cell high and two wide.
fn coarse_block(moduli: Moduli, friction: f64) -> Nodal {
    let side = even(-4.0 * MM, 4.0 * MM, 2);
    let mesh = grid(&side, &side, &even(-4.0 * MM, 0.0, 1));
    let base: Vec<u32> = nodes_where(&mesh, |p| p.z < -3.9 * MM);
    let body = SoftBody::new(mesh, Law::default(), moduli, &base).unwrap();
    Compliance::new(body, ComplianceOptions { friction, corrections: 0 })
        .unwrap()
        .at_nodes()
        .unwrap()
}

#[test]
fn a_shape_that_drags_nodes_along_stops_at_what_holds_the_body() {
    // A large inclined cone, moved from above to below: nodes moved along, 11 mm and more below the
    // base, and finally slid off its side.
    let turn = Quaternion::new(0.077_541, 0.300_842, 0.933_336, -0.179_905);
    let turn = UnitQuaternion::new_normalize(turn);
    let at = |z: f64| {
        let place = Vector3::new(0.668, 1.462, z) * MM;
        vec![Isometry3::from_parts(place.into(), turn)]
    };
    let cone = vec![Shape::Cone { radius: 7.755 * MM, half_height: 7.755 * MM }];
    let stiff = Moduli { young: 3.588e8, poisson: 0.3617 };
    let press = Press::along(cone, vec![at(5.487), at(-18.0)]).unwrap();
    let error = coarse_block(stiff, 0.6819).settle(&press).unwrap_err();
    assert!(matches!(error, Error::Penetrated { .. }), "{error}");
}

#[test]
fn a_tip_is_not_moved_past_a_wide_face_in_one_load_step() {
    // With two cells of 4 mm, a tip between the nodes is at least 1.5 mm away from all of them.
    let model = coarse_block(GEL, 0.1);
    let force = |x: f64, y: f64, z: f64| {
        let at = |z: f64| vec![Isometry3::translation(x * MM, y * MM, z * MM)];
        let tip = vec![Shape::Sphere { radius: 0.5 * MM }];
        let end = model.settle(&Press::along(tip, vec![at(0.6), at(z)]).unwrap());
        end.map(|found| found.wrench.force.norm())
    };
    for x in [-2.0, 1.3, 2.1] {
        let unfelt = force(x, 1.8, -5.3).is_ok_and(|force| force < 1e-6);
        assert!(!unfelt, "at x = {x} mm it went through without a force");
    }
    // On the node in the middle it is answered.
    let on_node = force(0.0, 0.0, 0.3).unwrap();
    assert!(on_node > 0.1, "{on_node} N on a node");
}

#[test]
fn an_edge_of_a_thick_block_between_nodes_is_refused() {
    // Nodes are 4 mm apart, and the edge, of 90°, is between two rows of them.
    let model = coarse_block(GEL, 0.5);
    let half_extents = Vector3::repeat(10.0 * MM);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_4);
    let down_to = |y: f64, depth: f64| {
        let place = Vector3::new(0.0, y, 10.0 * SQRT_2 - depth) * MM;
        let at = vec![Isometry3::from_parts(place.into(), turn)];
        model.settle(&Press::along(vec![Shape::Cuboid { half_extents }], vec![at]).unwrap())
    };
    let felt = down_to(0.0, 0.5).unwrap().wrench.force;
    assert!(felt.z < -0.1, "{felt} N on a row of nodes");
    assert!(down_to(2.0, 0.05).is_ok_and(|found| found.wrench.force.norm() == 0.0));
    let error = down_to(2.0, 1.5).unwrap_err();
    assert!(matches!(error, Error::Penetrated { .. }), "{error}");
}

#[test]
fn a_tip_between_nodes_is_refused_and_one_on_a_node_is_felt() {
    let model = nodal(0.5);
    let radius = 0.5 * MM;
    let vertices = &model.body().mesh().vertices;
    let apex = vertices.iter().find(|p| p.coords.norm() < 1e-9).expect("a node at the apex");
    // The next node across the face.
    let near = |p: &&Point3<f64>| p.y == 0.0 && p.z > -1e-4 && p.x > 1e-6;
    let next = vertices.iter().filter(near).map(|p| p.x).fold(f64::INFINITY, f64::min);
    let tip = |x: f64, depth: f64| {
        let at = vec![Isometry3::translation(x, 0.0, radius - depth)];
        model.settle(&Press::along(vec![Shape::Sphere { radius }], vec![at]).unwrap())
    };
    let felt = tip(apex.x, 0.3 * MM).unwrap().wrench.force;
    assert!(felt.z < -1e-3, "{felt} N");
    let error = tip(0.5 * next, 0.3 * MM).unwrap_err();
    assert!(matches!(error, Error::Penetrated { .. }), "{error}");
}

#[test]
fn a_ball_that_the_skin_folds_round_is_refused() {
    // While it moves to below the pad, with little friction, nodes slide all round it.
    let (model, radius) = (linear(&pad(300), 0.03).at_nodes().unwrap(), 2.2161e-3);
    let at = |z: f64| vec![Isometry3::translation(-1.84112e-3, 6.51621e-3, z)];
    let error = model.settle(&press(radius, vec![at(2.1461e-3), at(-7.49425e-3)])).unwrap_err();
    assert!(matches!(error, Error::Inverted), "{error}");
}
