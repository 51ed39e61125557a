//! Linear elasticity condensed to the surface, against finite elements.

use std::{fs, path::PathBuf};

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use ruffini_core::{
    Error, Result,
    compliance::{Compliance, ComplianceOptions},
    deformation::{Deformation, DeformationModel, Law, Moduli, Press, SoftBody, Wanted},
    fem::{Fem, FemOptions},
    geometry::{Shape, TetMesh},
};

use crate::bodies::{even, graded, grid, nodes_where};

const GEL: Moduli = Moduli { young: 2e5, poisson: 0.48 };
const MM: f64 = 1e-3;

/// A pad of 20.75 × 25.25 × 4 mm, finer in the middle: about 1,000 nodes.
fn pad_mesh() -> TetMesh {
    let [x, y] =
        [(10.375 * MM, 14), (12.625 * MM, 16)].map(|(half, count)| graded(half, count, 4.0));
    grid(&x, &y, &even(-4.0 * MM, 0.0, 3))
}

/// An 8 × 8 × 4 mm block, its free face at z = 0.
fn block_mesh() -> TetMesh {
    let side = even(-4.0 * MM, 4.0 * MM, 6);
    grid(&side, &side, &even(-4.0 * MM, 0.0, 3))
}

fn bonded(mesh: TetMesh, law: Law, moduli: Moduli) -> SoftBody {
    let base = nodes_where(&mesh, |p| p.z < -3.999 * MM);
    SoftBody::new(mesh, law, moduli, &base).unwrap()
}

fn pad(law: Law) -> SoftBody {
    bonded(pad_mesh(), law, GEL)
}

fn block() -> SoftBody {
    bonded(block_mesh(), Law::NeoHookean, GEL)
}

fn fem(body: &SoftBody, friction: f64) -> Fem {
    Fem::new(body.clone(), FemOptions { friction, ..FemOptions::default() }).unwrap()
}

fn linear(body: &SoftBody, friction: f64) -> Compliance {
    Compliance::new(body.clone(), ComplianceOptions { friction, corrections: 0 }).unwrap()
}

fn ball() -> Shape {
    Shape::Sphere { radius: 4.0 * MM }
}

fn cuboid() -> Shape {
    Shape::Cuboid { half_extents: Vector3::new(3.0, 2.5, 4.0) * MM }
}

/// A shape that reaches 4 mm down, pressed in by `depth` and moved aside by `x`.
fn at(x: f64, depth: f64) -> Vec<Isometry3<f64>> {
    vec![Isometry3::translation(x, 0.0, 4.0 * MM - depth)]
}

/// A flat plate, facing down, at `height` and moved aside by `x`.
fn plate_at(x: f64, height: f64) -> Vec<Isometry3<f64>> {
    let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    vec![Isometry3::from_parts(Vector3::new(x, 0.0, height).into(), down)]
}

fn along(shape: Shape, path: Vec<Vec<Isometry3<f64>>>) -> Press {
    Press::along(vec![shape], path).unwrap()
}

fn frames(found: Vec<Result<Deformation>>) -> Vec<Deformation> {
    found.into_iter().collect::<Result<_>>().unwrap()
}

fn last(found: Vec<Result<Deformation>>) -> Deformation {
    frames(found).pop().unwrap()
}

fn relative(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let rest: f64 = a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum();
    (rest / b.iter().map(Vector3::norm_squared).sum::<f64>()).sqrt()
}

#[test]
fn finite_elements_of_the_linear_law_give_the_same_answer() {
    let body = pad(Law::Linear);
    let down = |depth: f64| vec![at(0.0, 0.5 * depth), at(0.0, depth)];
    // At an edge there may be several equilibria; frames of 0.05 mm single one out.
    let sheared: Vec<_> = (1..=8)
        .map(|i| at(0.0, 0.05 * MM * f64::from(i)))
        .chain((1..=8).map(|i| at(0.025 * MM * f64::from(i), 0.4 * MM)))
        .collect();
    for (shape, friction, path) in [
        (ball(), 0.0, down(0.01 * MM)),
        (ball(), 0.0, down(MM)),
        (ball(), 0.5, sheared.clone()),
        (cuboid(), 0.5, sheared),
    ] {
        let press = along(shape.clone(), path);
        let exact = last(fem(&body, friction).solve_path(&press));
        let found = last(linear(&body, friction).solve_path(&press));
        let error = relative(&found.displacement, &exact.displacement);
        // Both solve the same equations; the contact iteration leaves 1e-5 of its force.
        assert!(error < 1e-4, "{shape:?} μ {friction}: displacements differ by {error:.1e}");
        let error = relative(&as_vectors(&found.von_mises), &as_vectors(&exact.von_mises));
        assert!(error < 1e-4, "{shape:?} μ {friction}: stresses differ by {error:.1e}");
    }
}

/// Numbers as `relative` takes them.
fn as_vectors(numbers: &[f64]) -> Vec<Vector3<f64>> {
    numbers.iter().map(|&number| Vector3::x() * number).collect()
}

#[test]
fn what_linear_elasticity_misses_grows_with_the_depth() {
    // Largest errors of force, displacement and stress against the neo-Hookean law. They are those
    // of linear elasticity itself on this pad, measured and rounded up.
    let body = pad(Law::NeoHookean);
    let (truth, model) = (fem(&body, 0.5), linear(&body, 0.5));
    let bounds = [
        (ball(), 0.25, [0.02, 0.03, 0.03]),
        (ball(), 0.5, [0.05, 0.05, 0.05]),
        (ball(), 1.0, [0.12, 0.10, 0.09]),
        (cuboid(), 0.25, [0.05, 0.04, 0.03]),
        (cuboid(), 0.5, [0.11, 0.07, 0.06]),
        (cuboid(), 1.0, [0.20, 0.15, 0.13]),
    ];
    for (shape, depth, bounds) in bounds {
        let steps = (20.0 * depth) as u32;
        let path = (1..=steps).map(|i| at(0.0, 0.05 * MM * f64::from(i))).collect();
        let press = along(shape.clone(), path);
        let exact = last(truth.solve_path(&press));
        let found = last(model.solve_path(&press));
        let errors = [
            relative(&[found.wrench.force], &[exact.wrench.force]),
            relative(&found.displacement, &exact.displacement),
            relative(&as_vectors(&found.von_mises), &as_vectors(&exact.von_mises)),
        ];
        println!("{shape:?} at {depth} mm: off by {errors:.3?} in force, u and stress");
        for (error, bound) in errors.into_iter().zip(bounds) {
            assert!(error < bound, "{shape:?} at {depth} mm: {error:.3}, expected < {bound}");
        }
    }
}

#[test]
fn corrections_lower_the_residual_down_to_the_answer_of_finite_elements() {
    let body = pad(Law::NeoHookean);
    let press = along(ball(), vec![at(0.0, 0.5 * MM)]);
    let exact = last(fem(&body, 0.5).solve_path(&press));
    let corrected: Vec<_> = (0..=12)
        .map(|corrections| {
            let options = ComplianceOptions { friction: 0.5, corrections };
            let model = Compliance::new(body.clone(), options).unwrap();
            let found = last(model.solve_path(&press));
            (found.residual, relative(&found.displacement, &exact.displacement))
        })
        .collect();
    println!("residual (N) and error of u by corrections: {corrected:?}");
    let falls = corrected.windows(2).all(|pair| pair[1].0 <= pair[0].0);
    assert!(falls, "residuals rise: {corrected:?}");
    let [none, four, twelve] = [0, 4, 12].map(|corrections| corrected[corrections].1);
    assert!(four < 0.05 * none, "after 4 corrections off by {four:.1e}, without by {none:.1e}");
    // The residual of the finite elements is 1e-7 N, with forces of about 0.5 N.
    assert!(twelve < 1e-5, "after 12 corrections off by {twelve:.1e}");
}

#[test]
fn corrections_along_a_sheared_path_keep_its_history() {
    let body = pad(Law::NeoHookean);
    let path = (1..=4).map(|i| at(0.0, 0.1 * MM * f64::from(i)));
    let path = path.chain((1..=4).map(|i| at(0.05 * MM * f64::from(i), 0.4 * MM))).collect();
    let press = along(ball(), path);
    let exact = last(fem(&body, 0.5).solve_path(&press));
    let options = ComplianceOptions { friction: 0.5, corrections: 12 };
    let found = last(Compliance::new(body, options).unwrap().solve_path(&press));
    let error = relative(&found.displacement, &exact.displacement);
    // The residual of every frame is below 1e-5 of the force, and the errors accumulate in the
    // history.
    assert!(error < 1e-4, "displacements differ by {error:.1e}");
}

#[test]
fn a_wide_sticking_contact_goes_on_where_the_offset_before_finds_no_balance() {
    let body = pad(Law::NeoHookean);
    let wide = Shape::Sphere { radius: 20.0 * MM };
    let path = [0.5, 1.0, 1.4].map(|depth| at(0.0, (depth - 16.0) * MM)).to_vec();
    let press = along(wide, path);
    let exact = last(fem(&body, 0.8).solve_path(&press));
    let errors = [0, 1, 3, 12].map(|corrections| {
        let model = Compliance::new(body.clone(), ComplianceOptions { friction: 0.8, corrections })
            .unwrap();
        relative(&last(model.solve_path(&press)).displacement, &exact.displacement)
    });
    println!("error of u after 0, 1, 3, 12 corrections: {errors:?}");
    // Corrections start from the linear solution there; after so long a step they do not converge fully.
    assert!(errors[3] < 0.25 * errors[0], "{errors:?}");
}

#[test]
fn no_force_without_contact() {
    for corrections in [0, 4] {
        let model =
            Compliance::new(block(), ComplianceOptions { friction: 0.5, corrections }).unwrap();
        let path = vec![at(0.0, -1e-6), at(0.0, 0.3 * MM), at(0.0, -0.5 * MM)];
        let frames = frames(model.solve_path(&along(ball(), path)));
        assert!(frames[1].wrench.force.z < 0.0);
        for frame in [&frames[0], &frames[2]] {
            assert_eq!(frame.wrench.force, Vector3::zeros(), "{corrections} corrections");
            assert!(
                frame.displacement.iter().all(|u| *u == Vector3::zeros()),
                "{corrections} corrections"
            );
            assert!(frame.von_mises.iter().all(|&s| s == 0.0), "{corrections} corrections");
            assert_eq!(frame.residual, 0.0, "{corrections} corrections");
        }
    }
}

#[test]
fn nodal_forces_add_up_to_the_wrench() {
    let body = block();
    for (shape, corrections) in [(ball(), 0), (cuboid(), 0), (ball(), 3)] {
        let model = Compliance::new(body.clone(), ComplianceOptions { friction: 0.5, corrections })
            .unwrap();
        let press = along(shape, vec![at(0.0, 0.3 * MM), at(0.1 * MM, 0.3 * MM)]);
        let frame = last(model.solve_path(&press));
        let sum: Vector3<f64> = frame.contact_force.iter().sum();
        let error = (sum - frame.wrench.force).norm() / frame.wrench.force.norm();
        assert!(frame.wrench.force.z < 0.0 && frame.wrench.force.x > 0.0);
        assert!(error < 1e-12, "forces differ by {error:.1e}");
        let nodes = body.mesh().vertices.iter().zip(&frame.displacement).zip(&frame.contact_force);
        let torque: Vector3<f64> = nodes.map(|((x, u), f)| (x.coords + u).cross(f)).sum();
        let error = (torque - frame.wrench.torque).norm() / frame.wrench.torque.norm();
        // The displacement at the nodes comes from another solve, equal to rounding.
        assert!(error < 1e-8, "torques differ by {error:.1e}");
    }
}

#[test]
fn friction_sticks_below_and_slips_at_its_limit() {
    let friction = 0.4;
    let model = linear(&block(), friction);
    let mut path = vec![plate_at(0.0, -0.2 * MM)];
    path.extend((1..=2).map(|i| plate_at(0.02 * MM * f64::from(i), -0.2 * MM)));
    // The first long slide aligns the slip of all points, the second keeps the direction.
    path.extend([plate_at(2.0 * MM, -0.2 * MM), plate_at(4.0 * MM, -0.2 * MM)]);
    let frames = frames(model.solve_path(&along(Shape::HalfSpace, path)));
    let ratio = |frame: &Deformation| frame.wrench.force.x / -frame.wrench.force.z;
    let [small, twice, slid] = [1, 2, 4].map(|i| ratio(&frames[i]));
    assert!(small > 0.0 && twice < friction, "{small}, {twice}");
    // While sticking, the block acts as a spring, softened by the rim that slips first.
    assert!((twice / small - 2.0).abs() < 0.2, "{small}, then {twice}");
    // Friction of slipping points is μ times pressure; the contact has converged to 1e-5.
    assert!((slid / friction - 1.0).abs() < 1e-3, "{slid} against {friction}");
}

#[test]
fn the_path_does_not_matter_without_friction() {
    let model = linear(&block(), 0.0);
    let direct = last(model.solve_path(&along(ball(), vec![at(0.0, 0.4 * MM)])));
    let detour =
        vec![at(0.0, 0.3 * MM), at(0.5 * MM, 0.6 * MM), at(0.0, 0.8 * MM), at(0.0, 0.4 * MM)];
    let round = last(model.solve_path(&along(ball(), detour)));
    let error = relative(&round.displacement, &direct.displacement);
    // The contact iteration leaves 1e-5 of its force.
    assert!(error < 1e-4, "displacements differ by {error:.1e}");
}

#[test]
fn a_press_goes_on_where_another_ended() {
    let body = bonded(block_mesh(), Law::Linear, GEL);
    let path = [at(0.0, 0.2 * MM), at(0.0, 0.4 * MM), at(0.1 * MM, 0.4 * MM)];
    let rest = |first: Deformation| {
        along(ball(), vec![at(0.2 * MM, 0.5 * MM)]).after(first.history).unwrap()
    };
    let model = linear(&body, 0.5);
    let whole = [path.to_vec(), vec![at(0.2 * MM, 0.5 * MM)]].concat();
    let whole = last(model.solve_path(&along(ball(), whole)));
    let begun = along(ball(), path.to_vec());
    // The finite elements of the linear law produce the same history.
    for begun in [model.solve_path(&begun), fem(&body, 0.5).solve_path(&begun)] {
        let found = last(model.solve_path(&rest(last(begun))));
        let error = relative(&found.displacement, &whole.displacement);
        assert!(error < 1e-4, "displacements differ by {error:.1e}");
    }
}

#[test]
fn a_corrected_press_goes_on_where_finite_elements_ended() {
    let body = block();
    let fem = fem(&body, 0.5);
    let begun = last(fem.solve_path(&along(ball(), vec![at(0.0, 0.2 * MM), at(0.0, 0.4 * MM)])));
    let press = along(ball(), vec![at(0.05 * MM, 0.42 * MM)]).after(begun.history).unwrap();
    let exact = last(fem.solve_path(&press));
    let options = ComplianceOptions { friction: 0.5, corrections: 12 };
    let found = last(Compliance::new(body, options).unwrap().solve_path(&press));
    let error = relative(&found.displacement, &exact.displacement);
    // The residual of the corrections is below 1e-5 of the force.
    assert!(error < 1e-4, "displacements differ by {error:.1e}");
}

#[test]
fn presses_are_answered_in_order_whatever_the_threads() {
    let model = linear(&block(), 0.3);
    let presses: Vec<_> = (0..6)
        .map(|i| along([ball(), cuboid()][i % 2].clone(), vec![at(0.0, 0.1 * MM * (i + 1) as f64)]))
        .collect();
    let answers = |threads: usize, model: &Compliance| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        frames(pool.install(|| model.solve(&presses)))
    };
    let [one, two] = [1, 2].map(|threads| answers(threads, &model));
    for ((press, one), two) in presses.iter().zip(&one).zip(&two) {
        let alone = last(model.solve_path(press));
        assert_eq!(one.displacement, alone.displacement);
        assert_eq!(two.displacement, alone.displacement);
    }
}

#[test]
fn asking_for_less_changes_nothing_that_is_answered() {
    let model = linear(&block(), 0.4);
    let path = vec![at(0.0, 0.2 * MM), at(0.05 * MM, 0.3 * MM)];
    let presses = [ball(), cuboid()].map(|shape| along(shape, path.clone()));
    // A single thread reuses its memory for the second press.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let whole = frames(pool.install(|| model.solve(&presses)));
    let moved = frames(pool.install(|| model.solve_partially(&presses, Wanted::default())));
    for (whole, moved) in whole.iter().zip(moved) {
        assert!(moved.von_mises.is_empty());
        assert_eq!(moved.history, whole.history);
        assert_eq!(moved.contact_force, whole.contact_force);
        assert_eq!((moved.wrench, moved.iterations), (whole.wrench, whole.iterations));
    }
}

#[test]
fn a_turned_scene_turns_the_answer() {
    let turn = Isometry3::new(Vector3::new(0.01, -0.02, 0.03), Vector3::new(0.4, -1.0, 0.7));
    let mesh = block_mesh();
    let base = nodes_where(&mesh, |p| p.z < -3.999 * MM);
    let turned =
        TetMesh { vertices: mesh.vertices.iter().map(|v| turn * v).collect(), ..mesh.clone() };
    let path = [at(0.0, 0.4 * MM), at(0.1 * MM, 0.4 * MM)];
    let [here, there] = [(mesh, Isometry3::identity()), (turned, turn)].map(|(mesh, turn)| {
        let body = SoftBody::new(mesh, Law::NeoHookean, GEL, &base).unwrap();
        let path = path.iter().map(|poses| vec![turn * poses[0]]).collect();
        last(linear(&body, 0.5).solve_path(&along(ball(), path)))
    });
    let turned: Vec<_> = here.displacement.iter().map(|u| turn.rotation * u).collect();
    let error = relative(&there.displacement, &turned);
    // Patches of equal rank may be formed in another order, and contact converges to 1e-5.
    assert!(error < 1e-4, "displacements differ by {error:.1e}");
}

#[test]
fn a_given_force_is_met_by_the_travel_that_causes_it() {
    for (shape, friction, corrections) in [(ball(), 0.0, 0), (ball(), 0.5, 3), (cuboid(), 0.5, 0)] {
        let model = Compliance::new(block(), ComplianceOptions { friction, corrections }).unwrap();
        let press =
            Press::with_force(vec![shape.clone()], at(0.0, -2.0 * MM), 0.3, -Vector3::z()).unwrap();
        let pushed = last(model.solve_path(&press));
        let force = -pushed.wrench.force.z;
        assert!((force - 0.3).abs() < 1e-6, "{shape:?}: {force} N, not 0.3 N");
        // The press continues to less force.
        let less = Press::with_force(vec![shape.clone()], at(0.0, 0.0), 0.1, -Vector3::z());
        let less = last(model.solve_path(&less.unwrap().after(pushed.history).unwrap()));
        let force = -less.wrench.force.z;
        assert!((force - 0.1).abs() < 1e-6, "{shape:?}: {force} N, not 0.1 N");
        assert!(less.poses[0].translation.z > pushed.poses[0].translation.z);
    }
}

#[test]
fn a_force_of_a_few_micronewtons_is_met() {
    let models = [linear(&pad(Law::NeoHookean), 0.5), linear(&block(), 0.0)];
    for model in &models {
        for force in [3e-6, 1e-4, 1e-3] {
            let push =
                || Press::with_force(vec![ball()], at(0.0, 0.0), force, -Vector3::z()).unwrap();
            let points = last(model.solve_path(&push())).wrench.force;
            let nodes = model.at_nodes().unwrap().settle(&push()).unwrap().wrench.force;
            for found in [points, nodes] {
                // The largest residual of a frame.
                assert!((-found.z - force).abs() <= 1e-7, "{found} N against {force} N");
            }
        }
    }
}

#[test]
fn a_push_that_misses_the_body_is_named() {
    let model = linear(&block(), 0.0);
    let press = Press::with_force(vec![ball()], at(0.0, -MM), 1.0, Vector3::z()).unwrap();
    let error = model.solve_path(&press).pop().unwrap().unwrap_err();
    // The push is followed for a metre, in steps that grow with the distance.
    let Error::Unreachable { reached: 0.0, travel, .. } = error else { panic!("{error}") };
    assert!((1.0..2.1).contains(&travel), "{travel} m");
}

#[test]
fn stiff_soft_and_rough_are_solved() {
    for (young, poisson, friction) in
        [(1e3, 0.48, 0.5), (1e9, 0.48, 0.5), (2e5, 0.4999, 0.0), (2e5, 0.0, 0.5), (2e5, 0.48, 5.0)]
    {
        let model = linear(&bonded(block_mesh(), Law::Linear, Moduli { young, poisson }), friction);
        let frame = last(model.solve_path(&along(ball(), vec![at(0.0, MM)])));
        let force = -frame.wrench.force.z;
        assert!(force > 0.0, "E {young} ν {poisson} μ {friction}: {force} N");
        assert!(frame.residual < 1e-4 * force, "E {young}: {} N left", frame.residual);
    }
}

#[test]
fn a_tip_finer_than_the_mesh_is_felt() {
    let pose = vec![Isometry3::translation(0.4 * MM, 0.3 * MM, 0.4 * MM)];
    let tip = along(Shape::Sphere { radius: 0.5 * MM }, vec![pose]);
    let frame = last(linear(&block(), 0.0).solve_path(&tip));
    assert!(frame.wrench.force.z < 0.0, "{} N", frame.wrench.force.z);
}

#[test]
fn a_press_through_the_pad_is_refused() {
    for corrections in [0, 4] {
        let model =
            Compliance::new(block(), ComplianceOptions { friction: 0.0, corrections }).unwrap();
        let found = model.solve_path(&along(ball(), vec![at(0.0, 0.2 * MM), at(0.0, 4.5 * MM)]));
        assert_eq!(found.len(), 2);
        let error = found[1].as_ref().map(|frame| frame.wrench).unwrap_err();
        let in_the_base = matches!(error, Error::Penetrated { .. } | Error::StepTooLong { .. });
        let named = in_the_base || matches!(error, Error::Inverted | Error::NotConverged { .. });
        assert!(named, "{corrections} corrections: {error}");
    }
}

#[test]
fn a_force_beyond_the_pad_is_refused() {
    for corrections in [0, 2] {
        let model =
            Compliance::new(block(), ComplianceOptions { friction: 0.5, corrections }).unwrap();
        let press = Press::with_force(vec![ball()], at(0.0, 0.0), 100.0, -Vector3::z()).unwrap();
        let error = model.solve_path(&press).pop().unwrap().map(|frame| frame.wrench).unwrap_err();
        let named = matches!(error, Error::Inverted | Error::Unreachable { .. });
        assert!(named, "{corrections} corrections: {error}");
    }
}

#[test]
fn bodies_and_options_that_make_no_sense_are_refused() {
    let refused = |fixed: &[u32], options: ComplianceOptions| {
        let body = SoftBody::new(block_mesh(), Law::Linear, GEL, fixed).unwrap();
        Compliance::new(body, options).map(|_| ()).unwrap_err().to_string()
    };
    let mesh = block_mesh();
    let base = nodes_where(&mesh, |p| p.z < -3.999 * MM);
    let edge = nodes_where(&mesh, |p| p.z < -3.999 * MM && p.x < -3.999 * MM);
    assert!(refused(&[], ComplianceOptions::default()).contains("fixed: found 0 nodes"));
    assert!(refused(&base[..2], ComplianceOptions::default()).contains("fixed: found 2 nodes"));
    assert!(edge.len() > 3);
    assert!(refused(&edge, ComplianceOptions::default()).contains("not on a line"));
    let options = |friction, corrections| ComplianceOptions { friction, corrections };
    assert!(refused(&base, options(0.0, 13)).contains("corrections: found 13, expected 0 to 12"));
    for friction in [f64::NAN, -0.1, f64::INFINITY] {
        assert!(refused(&base, options(friction, 0)).contains("friction"));
    }
    let other = last(linear(&pad(Law::Linear), 0.0).solve_path(&along(ball(), vec![at(0.0, 0.0)])));
    let press = along(ball(), vec![at(0.0, 0.0)]).after(other.history).unwrap();
    let error = linear(&block(), 0.0).solve_path(&press).pop().unwrap().unwrap_err();
    assert!(error.to_string().contains("history"), "{error}");
}

/// Temporary folder that is deleted at the end of the test.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("ruffini-{name}-{}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn files(&self) -> Vec<PathBuf> {
        fs::read_dir(&self.0).unwrap().map(|entry| entry.unwrap().path()).collect()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[test]
fn a_stored_compliance_answers_the_same_and_a_damaged_one_is_computed_anew() {
    let folder = Folder::new("compliance");
    let answer = || {
        let model = Compliance::cached(block(), ComplianceOptions::default(), &folder.0).unwrap();
        last(model.solve_path(&along(ball(), vec![at(0.0, 0.3 * MM)]))).displacement
    };
    let computed = answer();
    let [file] = &folder.files()[..] else { panic!("{:?}", folder.files()) };
    let sound = fs::read(file).unwrap();
    assert_eq!(answer(), computed);
    let changed = |at: usize| {
        let mut bytes = sound.clone();
        bytes[at] ^= 1;
        bytes
    };
    let end = sound.len() - 1;
    for damaged in [changed(0), changed(40), changed(end), sound[..end].to_vec(), Vec::new()] {
        fs::write(file, damaged).unwrap();
        assert_eq!(answer(), computed);
        assert_eq!(fs::read(file).unwrap(), sound);
    }
    // An intact file of another body is detected by its key.
    let softer = bonded(block_mesh(), Law::NeoHookean, Moduli { young: 1e5, ..GEL });
    drop(Compliance::cached(softer, ComplianceOptions::default(), &folder.0).unwrap());
    let other = folder.files().into_iter().find(|path| path != file).unwrap();
    fs::copy(&other, file).unwrap();
    assert_eq!(answer(), computed);
    assert_eq!(folder.files().len(), 2);
}

#[test]
fn a_folder_that_cannot_be_written_is_named() {
    let folder = Folder::new("compliance-file");
    let file = folder.0.join("not-a-folder");
    fs::write(&file, "").unwrap();
    let error =
        Compliance::cached(block(), ComplianceOptions::default(), &file).map(|_| ()).unwrap_err();
    assert!(matches!(error, Error::File { .. }), "{error}");
}

#[test]
fn a_shape_moved_through_the_body_is_not_unfelt() {
    // Moved from just above the block to below it in one frame.
    for radius in [2.0 * MM, 20.0 * MM] {
        let model = linear(&block(), 0.0);
        let force = |z: f64| {
            let at = |z| vec![Isometry3::translation(0.3 * MM, 0.2 * MM, z)];
            let press = along(Shape::Sphere { radius }, vec![at(radius + 0.1 * MM), at(z)]);
            model.solve_path(&press).pop().unwrap().map(|frame| frame.wrench.force.norm())
        };
        let felt = force(radius - 0.3 * MM).unwrap();
        assert!(felt > 0.1, "{felt} N of a ball of {radius} m, 0.3 mm deep");
        let unfelt = force(-5.0 * MM - radius).is_ok_and(|force| force < 1e-6);
        assert!(!unfelt, "a ball of {radius} m went through the block without a force");
    }
}

#[test]
fn a_thin_wall_moved_through_the_body_is_not_unfelt() {
    // Rings with walls of 0.3 to 0.7 mm, moved from above the block to below it at several places.
    let model = linear(&block(), 0.05);
    for wall in [0.3, 0.5, 0.7] {
        let outer = 2.5 * wall * MM;
        let ring = Shape::Annulus { outer, inner: outer - wall * MM, half_height: 0.5 * outer };
        for i in 0..12 {
            let turn = UnitQuaternion::from_euler_angles(0.0, 0.1 * f64::from(i % 3), 0.0);
            let force = |z: f64| {
                let at = |z: f64| {
                    let place = Vector3::new((0.17 * f64::from(i) - 1.0) * MM, 0.31 * MM, z);
                    vec![Isometry3::from_parts(place.into(), turn)]
                };
                let press = along(ring.clone(), vec![at(2.0 * outer), at(z)]);
                model.solve_path(&press).pop().unwrap().map(|frame| frame.wrench.force.norm())
            };
            let felt = force(0.5 * outer - 0.2 * MM).unwrap();
            assert!(felt > 0.1, "{felt} N of a ring of {wall} mm at place {i}, 0.2 mm deep");
            let unfelt = force(-5.0 * MM - 2.0 * outer).is_ok_and(|force| force < 1e-6);
            assert!(!unfelt, "a ring of {wall} mm at place {i} went through without a force");
        }
    }
}

#[test]
fn nothing_begins_or_sinks_unfelt_in_a_linear_body_or_what_holds_it() {
    // Shapes that start below the surface without containing a surface point: a ring in the block,
    // a ball in its base.
    let ring = Shape::Annulus { outer: 1.0 * MM, inner: 0.6 * MM, half_height: 0.5 * MM };
    let ball = Shape::Sphere { radius: 0.5 * MM };
    let base = block().mesh().vertices.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
    for (shape, height) in [(ring, 0.5 * base), (ball, base - 0.2 * MM)] {
        let at = |z| vec![Isometry3::translation(0.0, 0.0, z)];
        let press = along(shape, vec![at(height), at(base - 3.0 * MM)]);
        let error = linear(&block(), 0.05).solve_path(&press).remove(0).map(|frame| frame.wrench);
        assert!(error.is_err(), "at {height} m: {error:?}");
    }
}
