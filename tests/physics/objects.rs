//! The objects of the dataset and the grasps sampled on them.

use std::{collections::HashSet, f64::consts::PI};

use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rapier3d::parry::{
    math::{Pose, Vector},
    query::intersection_test,
    shape::{Cuboid, TriMesh},
};
use ruffini_core::{
    deformation::{Law, Moduli, SoftBody},
    geometry::{Shape, Surface},
    objects::{Antipodal, Family, FamilySplit, GraspSampler, Object, Rejection, catalogue},
    scene::{CATALOGUE, Command, ObjectModel, Scene, SceneConfig, SceneObject, named},
};

const SEED: u64 = 0;

#[test]
fn families_have_the_counts_of_the_paper() {
    let objects = catalogue(SEED);
    let of_split = |split| objects.iter().filter(|o| o.split == split).count();
    assert_eq!(
        [FamilySplit::Train, FamilySplit::Novel, FamilySplit::Soft].map(of_split),
        [49, 14, 1]
    );
    let names: HashSet<_> = objects.iter().map(|o| &o.name).collect();
    assert_eq!(names.len(), objects.len(), "every name is given once");
    for (i, a) in objects.iter().enumerate() {
        for b in &objects[..i] {
            assert_ne!(a.shape, b.shape, "{} and {}", a.name, b.name);
        }
    }
}

#[test]
fn an_object_follows_from_its_family_number_and_seed() {
    let objects = catalogue(SEED);
    assert_eq!(objects, catalogue(SEED));
    let apple = objects.iter().find(|o| o.name == "apple-2").unwrap();
    assert_eq!(*apple, Object::new(Family::Apple, 1, apple.seed));
    for (a, b) in objects.iter().zip(catalogue(SEED + 1)) {
        assert_ne!(a.shape, b.shape, "{} of two seeds", a.name);
    }
    // Bitwise the same on every machine.
    let ball = objects.iter().find(|o| o.family == Some(Family::Sphere)).unwrap();
    assert_eq!(ball.shape, Shape::Sphere { radius: 0.012_367_865_860_671_248 });
}

#[test]
fn surfaces_are_watertight_and_their_volumes_converge_at_second_order() {
    for seed in 0..3 {
        for object in catalogue(seed) {
            object.shape.clone().validated().unwrap();
            let [coarse, middle, fine] = [24, 48, 96].map(|segments| {
                let surface = object.surface(segments);
                let checked =
                    Surface::new(&object.name, surface.vertices(), surface.triangles()).unwrap();
                assert_eq!(checked, surface, "{}: nothing merged or turned", object.name);
                surface.mass_properties(1.0).mass
            });
            assert!(coarse > 0.0, "{}: {coarse} m³", object.name);
            let (first, second) = (middle - coarse, fine - middle);
            if matches!(object.shape, Shape::Cuboid { .. } | Shape::Prism { .. }) {
                assert_eq!((first, second), (0.0, 0.0), "{}: flat faces are exact", object.name);
                continue;
            }
            let rate = (first / second).log2();
            println!("{} {rate} {}", object.name, first / fine);
            // With 20 facets round a pointed end, the limit is not quite reached.
            assert!((rate - 2.0).abs() < 0.3, "{}: rate {rate}", object.name);
        }
    }
}

#[test]
fn mass_properties_are_those_of_the_closed_forms() {
    let mut checked = 0;
    for object in catalogue(SEED) {
        let Some((volume, moments)) = closed_form(&object.shape) else { continue };
        let found = object.mass_properties(1000.0);
        // 128 sides lack 0.04 % of a disc and 0.08 % of its second moment; of balls, somewhat more.
        let faceted = !matches!(object.shape, Shape::Cuboid { .. } | Shape::Prism { .. });
        let bound = if faceted { 2e-3 } else { 1e-12 };
        let close = |what: &str, found: f64, exact: f64| {
            let error = found / exact - 1.0;
            assert!(error.abs() < bound, "{}: {what} {found} for {exact}", object.name);
        };
        close("mass (kg)", found.mass, 1000.0 * volume);
        for (i, moment) in moments.into_iter().flatten().enumerate() {
            close("inertia (kg m²)", found.inertia[(i, i)], 1000.0 * volume * moment);
        }
        checked += 1;
    }
    assert_eq!(checked, 51, "all but the fruit and vegetables");
}

/// Volume (m³) and, if known, moments of inertia over mass (m²).
fn closed_form(shape: &Shape) -> Option<(f64, Option<[f64; 3]>)> {
    let upright = |polar: f64, h: f64| {
        let across = 0.5 * polar + h * h / 3.0;
        Some([across, across, polar])
    };
    Some(match *shape {
        Shape::Sphere { radius: r } => (4.0 / 3.0 * PI * r.powi(3), Some([0.4 * r * r; 3])),
        Shape::Cuboid { half_extents: h } => {
            let square = h.component_mul(&h);
            let moments = [0, 1, 2].map(|i| (square.sum() - square[i]) / 3.0);
            (8.0 * h.product(), Some(moments))
        }
        Shape::Ellipsoid { semi_axes: e } => {
            let square = e.component_mul(&e);
            let moments = [0, 1, 2].map(|i| (square.sum() - square[i]) / 5.0);
            (4.0 / 3.0 * PI * e.product(), Some(moments))
        }
        Shape::Cylinder { radius: r, half_height: h } => {
            (2.0 * PI * r * r * h, upright(0.5 * r * r, h))
        }
        Shape::Annulus { outer: a, inner: b, half_height: h } => {
            (2.0 * PI * (a * a - b * b) * h, upright(0.5 * (a * a + b * b), h))
        }
        Shape::Prism { sides, radius: r, half_height: h } => {
            let (sin, cos) = (2.0 * PI / f64::from(sides)).sin_cos();
            (f64::from(sides) * r * r * sin * h, upright(r * r * (2.0 + cos) / 6.0, h))
        }
        Shape::Cup { bottom, rim, half_height, wall } => {
            let frustum = |a: f64, b: f64, h: f64| PI / 3.0 * h * (a * a + a * b + b * b);
            let hollow = frustum(bottom - wall, rim - wall, 2.0 * half_height - wall);
            (frustum(bottom, rim, 2.0 * half_height) - hollow, None)
        }
        _ => return None,
    })
}

#[test]
fn distances_have_the_sign_of_the_solid_and_a_gradient_of_one() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    for object in catalogue(SEED) {
        let (shape, fine) = (&object.shape, object.surface(160));
        let reach = 0.7 * fine.size();
        let (mut smooth, count) = (0, 60);
        for _ in 0..count {
            let p = Point3::from(Vector3::from_fn(|_, _| random.random_range(-reach..reach)));
            let found = shape.distance(&p);
            // Facets of 160 to the circle lie at most 0.1 mm inside the sharpest of these curves.
            let gap = found.value - fine.distance(&p).value;
            assert!(gap.abs() < 1e-4, "{} at {p}: {gap} m off its facets", object.name);
            let h = 1e-6;
            let around = [0, 1, 2].map(|i| {
                let step = h * Vector3::ith(i, 1.0);
                [shape.distance(&(p + step)), shape.distance(&(p - step))]
            });
            // Across the medial axis the normal jumps and there is no gradient.
            if around.iter().flatten().any(|d| (d.normal - found.normal).norm() > 1e-2) {
                continue;
            }
            let slope = Vector3::from(around.map(|[a, b]| (a.value - b.value) / (2.0 * h)));
            let error = (slope - found.normal).norm();
            // Error bound: curvature changes over millimetres, (h / 1 mm)², and rounding is 1e-16 m
            // over h.
            assert!(error < 1e-5, "{} at {p}: gradient {slope}", object.name);
            smooth += 1;
        }
        assert!(smooth > count * 9 / 10, "{}: a gradient at {smooth}/{count}", object.name);
    }
}

#[test]
fn tetrahedra_fill_every_object_as_one_sound_body() {
    for object in catalogue(SEED) {
        // Walls are 3 mm thick or more; smooth solids need a less fine mesh.
        let smooth = matches!(object.shape, Shape::StarShaped(_));
        let spacing = if smooth { 0.0035 } else { 0.0025 };
        let mesh = object.tets(spacing).unwrap();
        let quality = mesh.quality();
        let [least, most] = [quality.min_dihedral, quality.max_dihedral].map(f64::to_degrees);
        // Bounds of isosurface stuffing for smooth solids (Labelle and Shewchuk 2007).
        assert!(least > 10.7 && most < 164.8, "{}: {least}° to {most}°", object.name);
        let (found, exact) = (mesh.volume(), object.mass_properties(1.0).mass);
        // A right-angled edge is cut off by half a spacing: 0.8 mm², four times in a ring section
        // of 50 mm².
        let error = found / exact - 1.0;
        assert!(error.abs() < 0.06, "{}: {found} m³ for {exact} m³", object.name);
        let moduli = Moduli { young: 1e5, poisson: 0.45 };
        SoftBody::new(mesh, Law::NeoHookean, moduli, &[]).unwrap();
    }
}

/// Grasps of an object, sampled as in the dataset.
fn grasps(object: &Object, count: usize) -> Vec<Antipodal> {
    GraspSampler::default().sample(&object.shape, count, object.seed).unwrap().grasps
}

#[test]
fn every_object_has_a_hundred_grasps() {
    for object in catalogue(SEED) {
        let found = grasps(&object, 100);
        assert_eq!(found.len(), 100, "{}", object.name);
        let narrowest = found.iter().map(|g| g.width).fold(f64::INFINITY, f64::min);
        assert!(narrowest < 0.06, "{}: {narrowest} m wide", object.name);
        assert_eq!(found[..10], grasps(&object, 10), "{}: the same seed", object.name);
    }
}

#[test]
fn both_apexes_touch_the_object_inside_their_friction_cones() {
    let friction = GraspSampler::default().friction;
    for object in catalogue(SEED) {
        for grasp in grasps(&object, 20) {
            let angles = grasp.pads(grasp.width).map(|pad| {
                let touched = object.shape.distance(&(pad * Point3::origin()));
                // Newton's method stops at 1e-12 of the radius; the angle of an axis from 1 − 1e-16
                // is 1e-8.
                assert!(touched.value.abs() < 1e-9, "{}: {} m", object.name, touched.value);
                touched.normal.angle(&-(pad * Vector3::z()))
            });
            let steepest = angles[0].max(angles[1]);
            assert!(steepest.tan() < friction, "{}: {steepest} rad", object.name);
            let quality = 1.0 - steepest.tan() / friction;
            assert!((quality - grasp.quality).abs() < 1e-6, "{}: {quality}", object.name);
        }
    }
}

/// Decimetre (m): Parry's tolerances are absolute and suit that unit, as in the scene.
const UNIT: f64 = 0.1;

#[test]
fn parry_finds_no_finger_in_an_object_either() {
    let sampler = GraspSampler::default();
    let (hand, pad) = (&sampler.hand, sampler.hand.pad);
    for object in catalogue(SEED) {
        let surface = object.surface(96);
        let at = |v: &Point3<f64>| parry(&(v.coords / UNIT));
        let vertices = surface.vertices().iter().map(at).collect();
        let mesh = TriMesh::new(vertices, surface.triangles().to_vec()).unwrap();
        for grasp in grasps(&object, 20) {
            let open = 0.5 * grasp.width + sampler.clearance;
            let base = 0.5 * grasp.width + pad.thickness;
            let back = open + pad.thickness + hand.finger_depth;
            let low = -0.5 * pad.length;
            // Descending with open pads, and closed at the grasp.
            for [inner, top] in [[open, 0.15], [base, hand.palm]] {
                let half = Vector3::new(back - inner, pad.width, top - low) * (0.5 / UNIT);
                let finger = Cuboid::new(parry(&half));
                for side in [-0.5, 0.5] {
                    let middle = Point3::new(side * (inner + back), 0.0, 0.5 * (top + low));
                    let pose = Pose::from_parts(at(&(grasp.tool * middle)), {
                        let q = grasp.tool.rotation.coords.map(|x| x as f32);
                        rapier3d::parry::math::Rotation::from_xyzw(q.x, q.y, q.z, q.w)
                    });
                    let met = intersection_test(&Pose::IDENTITY, &mesh, &pose, &finger).unwrap();
                    assert!(!met.intersecting, "{}: {grasp:?}", object.name);
                }
            }
        }
    }
}

fn parry(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x as f32, v.y as f32, v.z as f32)
}

#[test]
fn the_rigid_scene_takes_every_object() {
    for object in catalogue(SEED) {
        let model = ObjectModel::new(object.shape.clone()).unwrap();
        let lowest = |v: &Point3<f64>| (model.rest(1.0, 0.0, 0.0, 0.0) * v).z;
        let lowest = model.surface().vertices().iter().map(lowest).fold(f64::INFINITY, f64::min);
        assert!(lowest.abs() < 1e-12, "{}: {lowest} m over the table", object.name);
    }
}

#[test]
fn on_a_table_the_hand_stays_above_it() {
    let shape = Shape::Cylinder { radius: 0.02, half_height: 0.03 };
    let table = Some(-0.03);
    let sampler = GraspSampler { table, ..GraspSampler::default() };
    let sampling = sampler.sample(&shape, 50, SEED).unwrap();
    assert_eq!(sampling.grasps.len(), 50);
    assert!(sampling.rejected[&Rejection::Table] > 0, "{:?}", sampling.rejected);
    for grasp in sampling.grasps {
        for pad in grasp.pads(grasp.width) {
            let half = 0.5 * sampler.hand.pad.length;
            let ends = [-half, half].map(|y| (pad * Point3::new(0.0, y, 0.0)).z);
            assert!(ends.into_iter().all(|z| z > -0.03), "pad ends at {ends:?} m");
        }
    }
}

#[test]
fn what_cannot_be_held_says_why() {
    let reasons = |shape: Shape| {
        let sampling = GraspSampler::default().sample(&shape, 5, SEED).unwrap();
        assert_eq!(sampling.grasps.len(), 0, "{shape:?}");
        sampling.rejected.into_keys().collect::<Vec<_>>()
    };
    assert_eq!(reasons(Shape::Sphere { radius: 0.05 }), [Rejection::TooWide]);
    // Sides at 60° to each other need μ > √3.
    let tall = Shape::Prism { sides: 3, radius: 0.02, half_height: 0.05 };
    assert_eq!(reasons(tall), [Rejection::TooWide, Rejection::OutsideCone]);
    let message = |sampler: GraspSampler, shape: Shape| {
        sampler.sample(&shape, 1, SEED).unwrap_err().to_string()
    };
    assert!(message(GraspSampler::default(), Shape::HalfSpace).contains("half-space"));
    let slippery = GraspSampler { friction: 0.0, ..GraspSampler::default() };
    assert!(message(slippery, Shape::Sphere { radius: 0.02 }).contains("friction"));
}

/// Objects stay where `ObjectModel::rest` places them. Hulls of flat faces roll by up to a
/// millimetre from the pose of the solver's slow roll alone.
#[test]
fn what_is_laid_on_the_table_stays_there() {
    let (config, away) = (SceneConfig::default(), Vector3::new(-0.1, -0.1, 0.1));
    for name in CATALOGUE {
        let model = ObjectModel::new(named(name).unwrap()).unwrap();
        for scale in [0.5, 1.0, 1.2] {
            let pose = model.rest(scale, 0.05, 0.05, 0.3);
            let object = SceneObject { model: &model, scale, mass: 0.1, friction: 1.0, pose };
            let mut scene = Scene::new(&config, &object, &away, 0.0).unwrap();
            (0..25).for_each(|_| scene.step(&Command::default()));
            let now = scene.state().object.pose.translation.vector;
            let way = (now - pose.translation.vector).norm();
            assert!(way < 5e-5, "{name}, {scale} of its size: {way} m");
        }
    }
}
