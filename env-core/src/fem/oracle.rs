//! Comparison of the fast methods, with contact condensed to its nodes and factors reused, with the
//! slow one: Newton's method on the whole body with a factor for every step.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::{Element, Fem, FemOptions, Grasp, examples::grid};
use crate::{
    Result,
    deformation::{Deformation, Law, Moduli, Press, SoftBody, Wrench},
    geometry::{Shape, TetMesh},
    sensor::Sensor,
};

const MM: f64 = 1e-3;
const GEL: Moduli = Moduli { young: 2e5, poisson: 0.48 };
const FRICTION: f64 = 0.5;
/// Largest relative difference of displacements and forces: either method leaves a residual of 1e-7
/// N of some tenths of a newton, and a frame starts from the last.
const AGREE: f64 = 1e-5;

/// Returns `fem` without its fast methods.
fn slow(fem: &Fem) -> Fem {
    let mut slow = fem.clone();
    slow.limits.plain = true;
    slow
}

/// |a − b| over |b|.
fn off(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let gap: f64 = a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum();
    (gap / b.iter().map(Vector3::norm_squared).sum::<f64>()).sqrt()
}

/// Compares all frames of the two methods and returns the last frame.
fn compare(
    name: &str,
    fem: &Fem,
    shapes: Vec<Shape>,
    path: Vec<Vec<Isometry3<f64>>>,
) -> Deformation {
    let press = Press::along(shapes, path).unwrap();
    let [mut quick, slow] = [fem, &slow(fem)]
        .map(|fem| fem.solve_path(&press).into_iter().collect::<Result<Vec<_>>>().unwrap());
    for (i, (quick, slow)) in quick.iter().zip(&slow).enumerate() {
        let displacement = off(&quick.displacement, &slow.displacement);
        let force = off(&quick.contact_force, &slow.contact_force);
        println!("{name}, frame {i}: u {displacement:.1e}, forces {force:.1e}");
        assert!(
            slow.wrench.force.norm() > 0.0 || slow.contact_force.iter().any(|f| f.norm() > 0.0)
        );
        assert!(
            displacement < AGREE,
            "{name}, frame {i}: displacements differ by {displacement:.1e}"
        );
        assert!(force < AGREE, "{name}, frame {i}: contact forces differ by {force:.1e}");
    }
    let differ = quick.iter().zip(&slow).any(|(a, b)| a.displacement != b.displacement);
    assert!(differ, "{name}: the two ways are one");
    quick.pop().unwrap()
}

/// Poses of a shape whose lowest point is `reach` under its origin: pressed in by `depth` in four
/// frames, moved aside by 0.6 mm in four, rolled on by 0.15 rad in three, twisted by 0.1 rad in
/// two.
fn press_shear_roll_twist(reach: f64, depth: f64, top: f64) -> Vec<Vec<Isometry3<f64>>> {
    let at = |x: f64, y: f64, depth: f64, turn: Vector3<f64>| {
        let place = Translation3::new(x, y, top + reach - depth);
        vec![Isometry3::from_parts(place, UnitQuaternion::from_scaled_axis(turn))]
    };
    let still = Vector3::zeros();
    let down = (1..=4).map(|i| at(0.0, 0.0, depth * 0.25 * f64::from(i), still));
    let aside = (1..=4).map(|i| at(0.15 * MM * f64::from(i), 0.0, depth, still));
    let roll = |i: i32| -Vector3::x() * (0.05 * f64::from(i));
    let rolled = |i: i32| at(0.6 * MM, reach * 0.05 * f64::from(i), depth, roll(i));
    let twisted = |i: i32| {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::z() * (0.05 * f64::from(i)));
        let mut pose = rolled(3);
        pose[0].rotation = turn * pose[0].rotation;
        pose
    };
    down.chain(aside).chain((1..=3).map(rolled)).chain((1..=2).map(twisted)).collect()
}

fn bonded(mesh: TetMesh, moduli: impl Fn(f64) -> Moduli, options: FemOptions) -> Fem {
    let low = mesh.vertices.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
    let base = |n: &u32| mesh.vertices[*n as usize].z < low + 1e-9;
    let base: Vec<u32> = (0..mesh.vertices.len() as u32).filter(base).collect();
    let of_tet = |t: usize| moduli(mesh.corners(t).iter().map(|p| 0.25 * p.z).sum());
    let moduli = (0..mesh.tets.len()).map(of_tet).collect();
    Fem::new(SoftBody::graded(mesh, Law::NeoHookean, moduli, &base).unwrap(), options).unwrap()
}

/// An 8 × 8 × 4 mm block with its face at z = 0, `cells` across its height.
fn block(cells: u32) -> TetMesh {
    let (n, h) = (2 * cells, f64::from(cells));
    grid([n, n, cells], |p| Point3::new(p.x - h, p.y - h, p.z - h) * (4.0 * MM / h))
}

fn rough() -> FemOptions {
    FemOptions { friction: FRICTION, ..FemOptions::default() }
}

#[test]
fn a_ball_that_slides_rolls_and_twists_on_a_pad_is_answered_alike() {
    let ball = Shape::Sphere { radius: 4.0 * MM };
    for element in [Element::P1Bar, Element::P2] {
        let cells = if element == Element::P2 { 2 } else { 4 };
        let fem = bonded(block(cells), |_| GEL, FemOptions { element, ..rough() });
        let path = press_shear_roll_twist(4.0 * MM, 0.8 * MM, 0.0);
        let last = compare(&format!("block, {element}"), &fem, vec![ball.clone()], path);
        let [pressed, dragged] = [-last.wrench.force.z, last.wrench.force.xy().norm()];
        assert!(dragged > 0.3 * FRICTION * pressed, "{dragged} N of friction at {pressed} N");
    }
    let sensor = Sensor::named("gelsight-mini").unwrap();
    let pad = sensor.pad(700).unwrap();
    let top = pad.mesh.vertices.iter().map(|p| p.z).fold(f64::MIN, f64::max);
    let body = SoftBody::new(pad.mesh, Law::NeoHookean, GEL, &pad.base).unwrap();
    let path = press_shear_roll_twist(4.0 * MM, 0.8 * MM, top);
    compare("gelsight-mini", &Fem::new(body, rough()).unwrap(), vec![ball], path);
}

#[test]
fn a_cone_and_an_edge_moved_sideways_on_quadratic_elements_are_answered_alike() {
    let outline = Sensor::named("gelsight-mini").unwrap().outline;
    let pad = outline.graded(&[Point3::origin()], 450).unwrap();
    let top = pad.mesh.vertices.iter().map(|p| p.z).fold(f64::MIN, f64::max);
    let body = SoftBody::new(pad.mesh, Law::NeoHookean, GEL, &pad.base).unwrap();
    let fem = Fem::new(body, FemOptions { element: Element::P2, ..rough() }).unwrap();
    let cone = Shape::Cone { radius: 6.0 * MM, half_height: 2.0 * MM };
    let cube = Shape::Cuboid { half_extents: Vector3::repeat(2.0 * MM) };
    let [over, aslant] = [1.0, 0.25].map(|turns| Vector3::x() * (turns * std::f64::consts::PI));
    // The first depths are too small for contact points as far apart as these. Only few of them lie
    // under the cone, and as it rolls on one comes off: there are two equilibria. So there are
    // somewhere on meshes of 300, 350, 500 and 600 nodes; on those of 450 and 550 there are not.
    for (name, shape, reach, turn, frames) in
        [("cone", cone, 2.0 * MM, over, 2..9), ("edge", cube, 8f64.sqrt() * MM, aslant, 2..13)]
    {
        let mut path = press_shear_roll_twist(reach, 0.4 * MM, top)[frames].to_vec();
        let turn = UnitQuaternion::from_scaled_axis(turn);
        for poses in &mut path {
            poses[0].rotation *= turn;
        }
        let last = compare(name, &fem, vec![shape], path);
        let [pressed, dragged] = [-last.wrench.force.z, last.wrench.force.xy().norm()];
        assert!(dragged > 0.3 * FRICTION * pressed, "{dragged} N of friction at {pressed} N");
    }
}

#[test]
fn a_plate_that_covers_the_whole_face_is_answered_alike() {
    let plate = Shape::Cuboid { half_extents: Vector3::new(6.0, 6.0, 2.0) * MM };
    let path = press_shear_roll_twist(2.0 * MM, 0.4 * MM, 0.0);
    // Rolling would lift the plate off.
    compare("plate", &bonded(block(4), |_| GEL, rough()), vec![plate], path[..8].to_vec());
}

#[test]
fn a_soft_solid_rolled_between_two_plates_is_answered_alike() {
    let semi_axes = Vector3::new(8.0, 6.0, 5.0) * MM;
    let mesh = TetMesh::of_shape(&Shape::Ellipsoid { semi_axes }, 1.8 * MM).unwrap();
    let body = SoftBody::new(mesh, Law::NeoHookean, GEL, &[]).unwrap();
    let fem = Fem::new(body, rough()).unwrap();
    let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let plates = |squeeze: f64, aside: f64| {
        let low = Isometry3::translation(0.0, 0.0, -5.0 * MM + squeeze);
        let high = Translation3::new(aside, 0.0, 5.0 * MM - squeeze);
        vec![low, Isometry3::from_parts(high, down)]
    };
    let closing = (1..=4).map(|i| plates(0.1 * MM * f64::from(i), 0.0));
    let rolling = (1..=4).map(|i| plates(0.4 * MM, 0.3 * MM * f64::from(i)));
    compare(
        "solid",
        &fem,
        vec![Shape::HalfSpace, Shape::HalfSpace],
        closing.chain(rolling).collect(),
    );
}

#[test]
fn a_body_with_a_layer_a_million_times_stiffer_is_answered_alike() {
    let [soft, stiff] = [1e3, 1e9].map(|young| Moduli { young, poisson: 0.45 });
    let layers = |z: f64| if z < -2.0 * MM { stiff } else { soft };
    // The tolerance grows with the stiffest part, a thousand times.
    let options = FemOptions { tolerance: 1e-12, ..rough() };
    let fem = bonded(block(4), layers, options);
    let path = press_shear_roll_twist(4.0 * MM, 0.5 * MM, 0.0);
    compare("layers", &fem, vec![Shape::Sphere { radius: 4.0 * MM }], path);
}

#[test]
fn a_crooked_box_in_a_grasp_is_answered_alike() {
    let pad = bonded(block(3), |_| GEL, FemOptions { friction: 0.8, ..FemOptions::default() });
    let facing = |gap: f64, aside: f64| {
        [1.0, -1.0].map(|side| {
            let turn = Vector3::y() * (side * std::f64::consts::FRAC_PI_2);
            let place = Translation3::new(-side * 0.5 * gap, 0.0, aside);
            Isometry3::from_parts(place, UnitQuaternion::from_scaled_axis(turn))
        })
    };
    let crooked = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.04, 0.02));
    let closing = (0..4).map(|i| facing((6.0 - 0.1 * f64::from(i)) * MM, 0.0));
    let shearing = (1..=4).map(|i| facing(5.7 * MM, 0.05 * MM * f64::from(i)));
    let grasp = Grasp {
        object: Shape::Cuboid { half_extents: Vector3::new(3.0, 2.5, 2.0) * MM },
        start: Isometry3::from_parts(Vector3::zeros().into(), crooked),
        path: closing.chain(shearing).collect(),
        load: Wrench { force: Vector3::new(0.0, 0.02, 0.0), torque: Vector3::zeros() },
    };
    let [quick, slow] = [pad.clone(), slow(&pad)]
        .map(|pad| grasp.solve([&pad, &pad]).into_iter().collect::<Result<Vec<_>>>().unwrap());
    for (i, (quick, slow)) in quick.iter().zip(&slow).enumerate() {
        for (quick, slow) in quick.pads.iter().zip(&slow.pads) {
            let off = off(&quick.displacement, &slow.displacement);
            println!("grasp, frame {i}: u {off:.1e}");
            assert!(off < AGREE, "frame {i}: displacements differ by {off:.1e}");
        }
        let turn = quick.object.rotation.angle_to(&slow.object.rotation);
        let distance = (quick.object.translation.vector - slow.object.translation.vector).norm();
        // Either method leaves a residual of 1e-6 N on the object, which the pads hold by 100 N/m
        // or more, on an arm of 3 mm or less.
        assert!(
            turn < 3e-6 && distance < 1e-8,
            "frame {i}: off by {turn:.1e} rad and {distance:.1e} m"
        );
    }
    let differ =
        quick.iter().zip(&slow).any(|(a, b)| a.pads[0].displacement != b.pads[0].displacement);
    assert!(differ, "the two ways are one");
}
