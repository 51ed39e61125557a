//! Soft bodies pressed by rigid shapes.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use ruffini_core::{
    Error, Result,
    compliance::{Compliance, ComplianceOptions},
    deformation::{Deformation, DeformationModel, Drive, Law, Moduli, Press, SoftBody, Wrench},
    fem::{Element, Fem, FemOptions, Grasp},
    geometry::{Shape, TetMesh},
};

use crate::bodies::{even, graded, grid, nodes_where};

pub(crate) const GEL: Moduli = Moduli { young: 2e5, poisson: 0.48 };
pub(crate) const MM: f64 = 1e-3;

/// An 8 × 8 × 4 mm block, bonded underneath, its free face at z = 0.
pub(crate) fn block_mesh(cells: usize) -> TetMesh {
    let side = even(-4.0 * MM, 4.0 * MM, 2 * cells);
    grid(&side, &side, &even(-4.0 * MM, 0.0, cells))
}

pub(crate) fn base(mesh: &TetMesh) -> Vec<u32> {
    nodes_where(mesh, |p| p.z < -3.999 * MM)
}

pub(crate) fn block(moduli: Moduli, cells: usize, options: FemOptions) -> Fem {
    let mesh = block_mesh(cells);
    let base = base(&mesh);
    Fem::new(SoftBody::new(mesh, Law::NeoHookean, moduli, &base).unwrap(), options).unwrap()
}

pub(crate) fn rough(friction: f64) -> FemOptions {
    FemOptions { friction, ..FemOptions::default() }
}

/// A ball of radius 4 mm pressed in by `depth`, then moved aside by `x`.
pub(crate) fn ball_at(x: f64, depth: f64) -> Vec<Isometry3<f64>> {
    vec![Isometry3::translation(x, 0.0, 4.0 * MM - depth)]
}

pub(crate) fn ball() -> Vec<Shape> {
    vec![Shape::Sphere { radius: 4.0 * MM }]
}

/// A flat plate, facing down, at `height` and moved aside by `x`.
pub(crate) fn plate_at(x: f64, height: f64) -> Vec<Isometry3<f64>> {
    let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    vec![Isometry3::from_parts(Vector3::new(x, 0.0, height).into(), down)]
}

pub(crate) fn along(
    fem: &Fem,
    shapes: Vec<Shape>,
    path: Vec<Vec<Isometry3<f64>>>,
) -> Vec<Deformation> {
    let press = Press::along(shapes, path).unwrap();
    fem.solve_path(&press).into_iter().collect::<Result<_>>().unwrap()
}

pub(crate) fn last(fem: &Fem, shapes: Vec<Shape>, path: Vec<Vec<Isometry3<f64>>>) -> Deformation {
    along(fem, shapes, path).pop().unwrap()
}

pub(crate) fn relative(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let rest: f64 = a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum();
    (rest / b.iter().map(Vector3::norm_squared).sum::<f64>()).sqrt()
}

#[test]
fn no_force_without_contact() {
    let fem = block(GEL, 3, rough(0.5));
    let frame = last(&fem, ball(), vec![ball_at(0.0, -1e-6)]);
    assert_eq!(frame.wrench.force, Vector3::zeros());
    assert!(frame.displacement.iter().all(|u| *u == Vector3::zeros()));
    assert!(frame.von_mises.iter().all(|&s| s == 0.0));
}

#[test]
fn nodal_forces_add_up_to_the_wrench() {
    for element in [Element::P1Bar, Element::P2] {
        let fem = block(GEL, 3, FemOptions { element, friction: 0.5, ..FemOptions::default() });
        let frame = last(&fem, ball(), vec![ball_at(0.0, 0.5 * MM), ball_at(0.1 * MM, 0.5 * MM)]);
        let sum: Vector3<f64> = frame.contact_force.iter().sum();
        let force = frame.wrench.force;
        assert!(force.z < 0.0 && force.x > 0.0);
        assert!((sum - force).norm() < 1e-12 * force.norm(), "{element}: {sum} N and {force} N");
    }
}

#[test]
fn a_rough_plate_squeezes_a_block_without_locking() {
    // Held above and below, the block can only expand at its sides.
    let squeeze = |element, poisson, cells| {
        let moduli = Moduli { young: 2e5, poisson };
        let fem = block(moduli, cells, FemOptions { element, ..rough(5.0) });
        let frame = last(&fem, vec![Shape::HalfSpace], vec![plate_at(0.0, -0.2 * MM)]);
        -frame.wrench.force.z
    };
    for poisson in [0.3, 0.49, 0.499, 0.4999] {
        let reference = squeeze(Element::P2, poisson, 3);
        let averaged = squeeze(Element::P1Bar, poisson, 6) / reference - 1.0;
        println!("ν {poisson}: p1-bar off by {:.1} % of {reference} N", 100.0 * averaged);
        // Both meshes have the same nodes, and linear elements converge one order more slowly.
        assert!(averaged.abs() < 0.02, "ν {poisson}: off by {averaged:.3} of {reference} N");
    }
    let locked = squeeze(Element::P1, 0.4999, 6) / squeeze(Element::P2, 0.4999, 3);
    assert!(locked > 1.08, "p1 should lock, found {locked} times the reference");
}

#[test]
fn friction_sticks_below_and_slips_at_its_limit() {
    let friction = 0.4;
    let fem = block(GEL, 3, rough(friction));
    let mut path = vec![plate_at(0.0, -0.2 * MM)];
    path.extend((1..=2).map(|i| plate_at(0.02 * MM * f64::from(i), -0.2 * MM)));
    path.extend((4..=6).map(|i| plate_at(0.5 * MM * f64::from(i), -0.2 * MM)));
    let frames = along(&fem, vec![Shape::HalfSpace], path);
    let ratio = |frame: &Deformation| frame.wrench.force.x / -frame.wrench.force.z;
    let [small, twice, slid] = [1, 2, 5].map(|i| ratio(&frames[i]));
    assert!(small > 0.0 && twice < friction, "{small}, {twice}");
    // While sticking, the block acts as a spring, softened by the rim that slips first.
    assert!((twice / small - 2.0).abs() < 0.2, "{small}, then {twice}");
    // Friction of slipping points is μ times pressure.
    assert!((slid / friction - 1.0).abs() < 1e-3, "{slid} against {friction}");
}

#[test]
fn the_path_does_not_matter_without_friction() {
    let fem = block(GEL, 3, rough(0.0));
    let direct = last(&fem, ball(), vec![ball_at(0.0, 0.4 * MM)]);
    let detour = vec![
        ball_at(0.0, 0.3 * MM),
        ball_at(0.5 * MM, 0.6 * MM),
        ball_at(0.0, 0.8 * MM),
        ball_at(0.0, 0.4 * MM),
    ];
    let round = last(&fem, ball(), detour);
    let error = relative(&round.displacement, &direct.displacement);
    // The residual of both frames is 1e-7 N, with forces of about 0.3 N.
    assert!(error < 1e-6, "displacements differ by {error:.1e}");
}

#[test]
fn a_turned_scene_turns_the_answer() {
    let turn = Isometry3::new(Vector3::new(0.01, -0.02, 0.03), Vector3::new(0.4, -1.0, 0.7));
    let mesh = block_mesh(3);
    let base = base(&mesh);
    let turned =
        TetMesh { vertices: mesh.vertices.iter().map(|v| turn * v).collect(), ..mesh.clone() };
    let path = [ball_at(0.0, 0.5 * MM), ball_at(0.1 * MM, 0.5 * MM)];
    let [here, there] = [(mesh, Isometry3::identity()), (turned, turn)].map(|(mesh, turn)| {
        let body = SoftBody::new(mesh, Law::NeoHookean, GEL, &base).unwrap();
        let path = path.iter().map(|poses| vec![turn * poses[0]]).collect();
        last(&Fem::new(body, rough(0.5)).unwrap(), ball(), path)
    });
    let turned: Vec<_> = here.displacement.iter().map(|u| turn.rotation * u).collect();
    let error = relative(&there.displacement, &turned);
    // The residual of both frames is 1e-7 N, with forces of about 0.4 N, and errors of friction add
    // up over two frames.
    assert!(error < 1e-5, "displacements differ by {error:.1e}");
}

#[test]
fn the_order_of_nodes_does_not_matter() {
    let mesh = block_mesh(3);
    let count = mesh.vertices.len() as u32;
    // 101 is prime and does not divide the number of nodes, so this is a permutation.
    let renumber = |node: u32| node * 101 % count;
    let mut shuffled = mesh.clone();
    for node in 0..count {
        shuffled.vertices[renumber(node) as usize] = mesh.vertices[node as usize];
    }
    shuffled.tets = mesh.tets.iter().rev().map(|tet| tet.map(renumber)).collect();
    let [plain, shuffled] = [mesh, shuffled].map(|mesh| {
        let base = base(&mesh);
        let body = SoftBody::new(mesh, Law::NeoHookean, GEL, &base).unwrap();
        last(&Fem::new(body, rough(0.5)).unwrap(), ball(), vec![ball_at(0.0, 0.5 * MM)])
    });
    let back: Vec<_> =
        (0..count).map(|node| shuffled.displacement[renumber(node) as usize]).collect();
    let error = relative(&back, &plain.displacement);
    assert!(error < 1e-6, "displacements differ by {error:.1e}");
}

#[test]
fn the_order_of_nodes_of_a_solid_does_not_matter() {
    let ball = TetMesh::of_shape(&Shape::Sphere { radius: 8.0 * MM }, 2.5 * MM).unwrap();
    let count = ball.vertices.len() as u32;
    let renumber = |node: u32| (u64::from(node) * 1009 % u64::from(count)) as u32;
    assert!(!count.is_multiple_of(1009), "{count} nodes");
    let mut shuffled = ball.clone();
    for node in 0..count {
        shuffled.vertices[renumber(node) as usize] = ball.vertices[node as usize];
    }
    shuffled.tets =
        ball.tets.iter().rev().map(|&[a, b, c, d]| [b, c, a, d].map(renumber)).collect();
    for element in [Element::P1, Element::P1Bar, Element::P2] {
        let pressed = |mesh: &TetMesh| {
            let base = nodes_where(mesh, |p| p.z < -5.0 * MM);
            let body = SoftBody::new(mesh.clone(), Law::NeoHookean, GEL, &base).unwrap();
            let fem = Fem::new(body, FemOptions { element, ..rough(0.5) }).unwrap();
            let pose = vec![Isometry3::translation(MM, 0.0, 11.2 * MM)];
            last(&fem, vec![Shape::Sphere { radius: 4.0 * MM }], vec![pose]).displacement
        };
        let (plain, other) = (pressed(&ball), pressed(&shuffled));
        let back: Vec<_> = (0..count).map(|node| other[renumber(node) as usize]).collect();
        let error = relative(&back, &plain);
        assert!(error < 1e-6, "{element}: displacements differ by {error:.1e}");
    }
}

#[test]
fn a_press_goes_on_where_another_ended() {
    let fem = block(GEL, 3, rough(0.5));
    let path = [ball_at(0.0, 0.4 * MM), ball_at(0.1 * MM, 0.4 * MM), ball_at(0.2 * MM, 0.5 * MM)];
    let whole = last(&fem, ball(), path.to_vec());
    let first = last(&fem, ball(), path[..2].to_vec());
    let press = Press::along(ball(), path[2..].to_vec()).unwrap().after(first.history).unwrap();
    let rest = fem.solve_path(&press).pop().unwrap().unwrap();
    let error = relative(&rest.displacement, &whole.displacement);
    // They start the last frame from different states; the residual of both is 1e-7 N, with forces
    // of about 0.4 N.
    assert!(error < 1e-6, "displacements differ by {error:.1e}");
}

#[test]
fn presses_are_answered_in_order_whatever_the_threads() {
    let fem = block(GEL, 2, rough(0.3));
    let depth = |i: u32| 0.1 * MM * f64::from(i + 1);
    let presses: Vec<_> =
        (0..4).map(|i| Press::along(ball(), vec![ball_at(0.0, depth(i))]).unwrap()).collect();
    let together = fem.solve(&presses);
    for (press, frame) in presses.iter().zip(together) {
        let alone = fem.solve_path(press).pop().unwrap().unwrap();
        assert_eq!(frame.unwrap().displacement, alone.displacement);
    }
}

#[test]
fn a_given_force_is_met_by_the_travel_that_causes_it() {
    for friction in [0.0, 0.5] {
        let fem = block(GEL, 3, rough(friction));
        let start = ball_at(0.0, -2.0 * MM);
        let press = Press::with_force(ball(), start, 0.3, -Vector3::z()).unwrap();
        let pushed = fem.solve_path(&press).pop().unwrap().unwrap();
        let force = -pushed.wrench.force.z;
        assert!((force - 0.3).abs() < 1e-6, "{force} N, not 0.3 N");
        let moved = last(&fem, ball(), vec![pushed.poses.clone()]);
        // Friction sticks at the place of first contact, which the two presses determine
        // differently.
        let error = moved.wrench.force.z / pushed.wrench.force.z - 1.0;
        assert!(error.abs() < 2e-3, "μ {friction}: moved there it presses {error:.1e} more");
        if friction == 0.0 {
            // The push was solved on the whole body, the moved ball on the nodes that it may touch.
            let off = relative(&moved.displacement, &pushed.displacement);
            assert!(off < 1e-6, "what is condensed is off by {off:.1e}");
        }
    }
}

#[test]
fn a_push_within_the_tolerance_is_refused() {
    let fem = block(GEL, 2, rough(0.0));
    let push = |force: f64| {
        let press = Press::with_force(ball(), ball_at(0.0, -MM), force, -Vector3::z()).unwrap();
        fem.solve_path(&press).pop().unwrap()
    };
    let error = push(5e-8).unwrap_err().to_string();
    assert!(error.contains("more than the tolerance"), "{error}");
    let force = -push(1e-5).unwrap().wrench.force.z;
    assert!((force - 1e-5).abs() < 2e-7, "{force} N, not 1e-5 N");
}

#[test]
fn a_body_with_no_face_to_press_is_refused() {
    let mesh = block_mesh(2);
    let all: Vec<u32> = (0..mesh.vertices.len() as u32).collect();
    // All nodes, and all surface nodes.
    let outer: Vec<u32> = mesh.boundary().concat();
    for held in [all, outer] {
        let body = SoftBody::new(mesh.clone(), Law::NeoHookean, GEL, &held).unwrap();
        let fem = Fem::new(body.clone(), rough(0.0)).map(|_| ()).unwrap_err();
        let linear = Compliance::new(body, ComplianceOptions::default()).map(|_| ()).unwrap_err();
        for error in [fem, linear].map(|error| error.to_string()) {
            assert!(error.contains("held all round"), "{error}");
        }
    }
}

#[test]
fn a_push_that_misses_the_body_is_named() {
    let fem = block(GEL, 2, rough(0.0));
    let press = Press::with_force(ball(), ball_at(0.0, -MM), 1.0, Vector3::z()).unwrap();
    let error = fem.solve_path(&press).pop().unwrap().unwrap_err();
    // The push is followed for a metre, in steps that grow with the distance.
    let Error::Unreachable { reached: 0.0, travel, .. } = error else { panic!("{error}") };
    assert!((1.0..2.1).contains(&travel), "{travel} m");
}

#[test]
fn what_a_body_bears_of_a_force_that_is_too_much_is_told() {
    // The ball passes the block at some newtons; the error reports how far it came, even if 1e5 N
    // were requested.
    let fem = block(GEL, 2, rough(0.2));
    let borne = |force: f64| {
        let press = Press::with_force(ball(), ball_at(0.0, -MM), force, -Vector3::z()).unwrap();
        match fem.solve_path(&press).pop().unwrap() {
            Err(Error::Unreachable { reached, travel, .. }) => (reached, travel),
            other => panic!("{:?}", other.map(|frame| frame.wrench)),
        }
    };
    let [(much, deep), (more, deeper)] = [1e3, 1e5].map(borne);
    assert!(much > 1.0 && more > 1.0, "{much} N of 1e3 N, {more} N of 1e5 N");
    // Load steps are at least a sixteenth of the reached force, which limits its accuracy.
    assert!((more / much - 1.0).abs() < 0.2, "{much} N of 1e3 N, {more} N of 1e5 N");
    // Travel through the gap and into the block, at most until the ball is below its face.
    for travel in [deep, deeper] {
        assert!((MM..9.0 * MM).contains(&travel), "{travel} m");
    }
}

#[test]
fn stiff_soft_and_rough_are_solved() {
    for (young, poisson, friction) in
        [(1e3, 0.48, 0.5), (1e9, 0.48, 0.5), (2e5, 0.4999, 0.0), (2e5, 0.0, 0.5), (2e5, 0.48, 5.0)]
    {
        let fem = block(Moduli { young, poisson }, 3, rough(friction));
        let frame = last(&fem, ball(), vec![ball_at(0.0, MM)]);
        assert!(frame.wrench.force.z < 0.0, "E {young} ν {poisson} μ {friction}");
    }
}

#[test]
fn a_block_is_squeezed_to_a_third() {
    let fem = block(Moduli { young: 2e5, poisson: 0.4 }, 2, rough(1.0));
    let path = (1..=14).map(|i| plate_at(0.0, -0.2 * MM * f64::from(i))).collect();
    let frames = along(&fem, vec![Shape::HalfSpace], path);
    let forces: Vec<f64> = frames.iter().map(|frame| -frame.wrench.force.z).collect();
    assert!(forces.windows(2).all(|pair| pair[1] > pair[0]), "{forces:?} N");
}

#[test]
fn a_free_block_is_held_between_two_plates() {
    let mesh = block_mesh(2);
    let body = SoftBody::new(mesh, Law::NeoHookean, GEL, &[]).unwrap();
    let fem = Fem::new(body, rough(0.5)).unwrap();
    let bottom = Isometry3::translation(0.0, 0.0, -4.0 * MM);
    let top = plate_at(0.0, -0.2 * MM)[0];
    let frame = last(&fem, vec![Shape::HalfSpace, Shape::HalfSpace], vec![vec![bottom, top]]);
    // The block is at rest: the forces of the plates cancel to the tolerance.
    let net = frame.wrench.force.norm();
    assert!(net < 1e-7, "{net} N");
    let side = nodes_where(fem.body().mesh(), |p: &Point3<f64>| p.x > 3.9 * MM);
    assert!(side.iter().any(|&n| frame.displacement[n as usize].x > 0.05 * MM));
}

#[test]
fn the_published_force_on_a_gel_pad_is_met() {
    // Pad of 20.75 × 25.25 × 4 mm, ball of 4 mm, stable neo-Hookean, no friction: 1.3133 N at 1 mm
    // by NGSolve, GetFEM and CalculiX under refinement. This mesh is 0.6 % too stiff.
    let z: Vec<f64> =
        even(0.0, 1.0, 3).iter().rev().map(|t| -4.0 * MM * t * (0.8 + 0.2 * t)).collect();
    let mesh = grid(&graded(10.375 * MM, 18, 12.0), &graded(12.625 * MM, 18, 12.0), &z);
    let base = base(&mesh);
    let body = SoftBody::new(mesh, Law::StableNeoHookean, GEL, &base).unwrap();
    let options = FemOptions { element: Element::P2, ..FemOptions::default() };
    let fem = Fem::new(body, options).unwrap();
    let force = -last(&fem, ball(), vec![ball_at(0.0, MM)]).wrench.force.z;
    assert!((force / 1.3133 - 1.0).abs() < 0.01, "{force} N against 1.3133 N");
}

#[test]
fn a_press_shows_how_it_is_controlled() {
    let press = Press::with_force(ball(), ball_at(0.0, 0.0), 2.0, Vector3::new(0.0, 0.0, -3.0));
    let press = press.unwrap();
    assert!(matches!(press.drive(), Drive::Force { force: 2.0, direction, .. }
        if direction.z == -1.0));
}

/// Poses of two pads that face each other along x, `gap` between their faces.
fn facing(gap: f64) -> [Isometry3<f64>; 2] {
    [1.0, -1.0].map(|side| {
        let turn =
            UnitQuaternion::from_axis_angle(&Vector3::y_axis(), side * std::f64::consts::FRAC_PI_2);
        Isometry3::from_parts(Vector3::new(-side * 0.5 * gap, 0.0, 0.0).into(), turn)
    })
}

#[test]
fn a_ball_between_two_pads_finds_the_middle_and_carries_its_load() {
    let pad = block(GEL, 3, rough(0.6));
    let path: Vec<_> = (0..6).map(|i| facing(8.1 * MM - 0.2 * MM * f64::from(i))).collect();
    let weight = Wrench { force: Vector3::new(0.0, 0.0, -0.02), torque: Vector3::zeros() };
    for (load, start) in [(Wrench::default(), 0.03 * MM), (weight, 0.0)] {
        // The pads first touch in the second frame; a load can only be carried once they hold.
        let closing = Grasp {
            object: ball()[0].clone(),
            start: Isometry3::translation(start, 0.0, 0.0),
            path: if load.force == Vector3::zeros() {
                Vec::clone(&path)
            } else {
                path[1..].to_vec()
            },
            load,
        };
        let frames = closing.solve([&pad, &pad]);
        let last = frames.last().unwrap().as_ref().unwrap();
        assert_eq!(frames.len(), closing.path.len());
        let poses = facing(0.0);
        let [left, right] = [0, 1].map(|i| poses[i].rotation * last.pads[i].wrench.force);
        let net = (left + right - load.force).norm();
        // Ten times the tolerance of a pad.
        assert!(net < 1e-6, "{net} N unbalanced");
        assert!(left.norm() > 0.3, "{left} N");
        let middle = last.object.translation.vector.x;
        assert!(middle.abs() < 1e-3 * MM, "{middle} m off the middle");
    }
}

#[test]
fn a_tip_finer_than_the_mesh_is_felt() {
    // The faces are 1.3 mm wide, and a ball of half a millimetre is between their nodes.
    let fem = block(GEL, 3, rough(0.0));
    let pose = vec![Isometry3::translation(0.4 * MM, 0.3 * MM, 0.4 * MM)];
    let tip = last(&fem, vec![Shape::Sphere { radius: 0.5 * MM }], vec![pose]);
    assert!(tip.wrench.force.z < 0.0, "{} N", tip.wrench.force.z);
}

#[test]
fn a_crooked_box_is_turned_straight_by_the_pads() {
    let pad = block(GEL, 3, rough(0.8));
    let crooked = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.04, 0.02));
    let grasp = Grasp {
        object: Shape::Cuboid { half_extents: Vector3::new(3.0, 2.5, 2.0) * MM },
        start: Isometry3::from_parts(Vector3::zeros().into(), crooked),
        path: (0..4).map(|i| facing(6.0 * MM - 0.1 * MM * f64::from(i))).collect(),
        load: Wrench::default(),
    };
    let frames = grasp.solve([&pad, &pad]);
    let last = frames.last().unwrap().as_ref().unwrap();
    let (before, after) = (crooked.angle(), last.object.rotation.angle());
    assert!(after < 0.9 * before, "{after} rad, was {before} rad");
    assert!(last.residual < 1e-6, "{} N unbalanced", last.residual);
}
