//! Soft pads: the implicit elastic foundation of bristles between the fingers and the object.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use ruffini_core::{
    deformation::{Law, Moduli, Press, SoftBody, Wrench},
    env::{Autoreset, Batch, Row, Setup},
    fem::{Fem, FemOptions},
    geometry::{PadOutline, Shape, Surface},
    scene::{
        CATALOGUE, Command, Failure, FingerState, ObjectModel, Pads, Scene, SceneConfig,
        SceneObject, SceneState, SoftPads,
    },
    sensor::{ElasticFoundation, Sensor},
    tactile::Choice,
    task::{Ending, ObjectSpec, TaskConfig},
};

use crate::grasp::{GraspCase, HEIGHT, matrix, run};

const MM: f64 = 1e-3;

pub(crate) fn gel() -> SoftPads {
    let sensor = Sensor::named("gelsight-mini").unwrap();
    SoftPads::new(&sensor, &sensor.calibrations[0])
}

pub(crate) fn soft() -> SceneConfig {
    SceneConfig::default().with_pads(gel())
}

pub(crate) fn ball() -> ObjectModel {
    ObjectModel::new(Shape::Sphere { radius: 0.015 }).unwrap()
}

/// Scene in which `model` has been gripped in weightlessness for a second at the height of 0.1 m.
pub(crate) fn gripped(config: &SceneConfig, model: &ObjectModel, mass: f64, grip: f64) -> Scene {
    let pose = Isometry3::translation(0.0, 0.0, 0.1);
    let object = SceneObject { model, scale: 1.0, mass, friction: 0.8, pose };
    let mut scene = Scene::new(config, &object, &pose.translation.vector, 0.0).unwrap();
    scene.set_gravity(0.0);
    hold(&mut scene, grip, 1.0);
    scene
}

/// Keeps gripping for a time (s).
pub(crate) fn hold(scene: &mut Scene, grip: f64, time: f64) {
    let period = scene.config().physics.control_period;
    for _ in 0..(time / period).round() as usize {
        scene.step(&Command { grip, ..Command::default() });
    }
}

#[test]
fn soft_pads_hold_what_must_hold_and_drop_what_must_drop() {
    let wrong = matrix(&soft());
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Two balls as one body: the gripped one is at the origin, the centre of mass `offset` (m) along y
/// from there.
fn dumbbell(offset: f64) -> ObjectModel {
    let [large, small] = [0.015, 0.010].map(|r| Shape::Sphere { radius: r }.surface(48).unwrap());
    let volume = |surface: &Surface| surface.mass_properties(1.0).mass;
    let away = offset * (1.0 + volume(&large) / volume(&small));
    let moved = small.vertices().iter().map(|v| v + Vector3::y() * away);
    let vertices: Vec<_> = large.vertices().iter().copied().chain(moved).collect();
    let first = large.vertices().len() as u32;
    let second = small.triangles().iter().map(|t| t.map(|i| i + first));
    let triangles: Vec<_> = large.triangles().iter().copied().chain(second).collect();
    let surface = Surface::new("dumbbell", &vertices, &triangles).unwrap();
    ObjectModel::new(Shape::Mesh(surface.into())).unwrap()
}

#[test]
fn a_ball_held_off_its_centre_of_mass_hardly_turns() {
    let model = dumbbell(8.0 * MM);
    for (mass, grip) in [(0.05, 5.0), (0.1, 10.0), (0.2, 20.0)] {
        let mut scene = gripped(&soft(), &model, mass, grip);
        let turn = |scene: &Scene| scene.state().object.pose.rotation;
        let before = turn(&scene);
        scene.set_gravity(9.81);
        hold(&mut scene, grip, 1.0);
        let after = turn(&scene);
        hold(&mut scene, grip, 4.0);
        let turned = before.angle_to(&after).to_degrees();
        let crept = after.angle_to(&turn(&scene)).to_degrees();
        assert!(turned < 5.0, "{mass} kg, {grip} N: turned by {turned}°");
        assert!(crept < 0.01, "{mass} kg, {grip} N: crept by {crept}°");
    }
}

/// Force (N) and contact area (m²) of the force law under a ball of radius `r` (m) at `depth` (m),
/// on a grid far finer than the elastic foundation.
fn law(pads: &SoftPads, r: f64, depth: f64) -> (f64, f64) {
    let PadOutline { width, length, thickness: h, .. } = pads.outline;
    let ElasticFoundation { normal, coupling: q, .. } = pads.foundation;
    let n = 200;
    let cell = width * length / f64::from(n * n);
    let at = |i: u32, extent: f64| ((f64::from(i) + 0.5) / f64::from(n) - 0.5) * extent;
    let (mut squares, mut depths, mut area) = (0.0, 0.0, 0.0);
    for i in 0..n * n {
        let (x, y) = (at(i / n, width), at(i % n, length));
        let place = Vector3::new(x, y, pads.outline.height(x, y) - (r - depth));
        let d = (r - place.norm()).max(0.0);
        squares += d * d * cell;
        // The component along the pad's normal.
        depths += d * cell * -place.z / place.norm();
        area += if d > 0.0 { cell } else { 0.0 };
    }
    let stored = (squares / h.powi(4)).powf(q - 1.0);
    (2.0 * q * normal * pads.young / h * stored * depths, area)
}

#[test]
fn the_ball_sinks_in_as_deep_as_the_law_says() {
    let pads = gel();
    for (young, grip) in [(0.3e6, 1.0), (0.3e6, 5.0), (0.3e6, 10.0), (1e6, 20.0)] {
        let pads = SoftPads { young, ..pads };
        let config = SceneConfig::default().with_pads(pads);
        let scene = gripped(&config, &ball(), 0.1, grip);
        for (finger, indentation) in scene.state().fingers.iter().zip(scene.indentations()) {
            let depth = 0.015 - finger.object.translation.z;
            let force = law(&pads, 0.015, depth).0;
            // The force is proportional to the square of the depth: 10 % of force are 5 % of depth.
            let error = (force / grip).sqrt() - 1.0;
            let depth_mm = depth / MM;
            assert!(error.abs() < 0.05, "{young} Pa, {grip} N: {depth_mm} mm, off by {error:.3}");
            let shown = indentation / depth - 1.0;
            assert!(shown.abs() < 0.1, "indentation off by {shown:.3}");
        }
    }
}

#[test]
fn the_ball_sinks_down_as_far_as_the_foundation_at_rest_says() {
    for (mass, grip) in [(0.02, 2.0), (0.1, 5.0), (0.2, 10.0)] {
        let mut scene = gripped(&soft(), &ball(), mass, grip);
        let seen = |scene: &Scene| scene.state().fingers[0].object;
        let before = seen(&scene);
        scene.set_gravity(9.81);
        hold(&mut scene, grip, 1.0);
        let after = seen(&scene);
        let mut path: Vec<_> = (1..=20)
            .map(|i| before.translation.vector + Vector3::z() * 5e-5 * f64::from(20 - i))
            .map(|place| Isometry3::from_parts(place.into(), before.rotation))
            .collect();
        path.push(after);
        let wrenches = gel().wrenches(&ball(), 0.8, &path);
        let weight = wrenches[19].force.y - wrenches[20].force.y;
        let error = weight / (0.5 * mass * 9.81) - 1.0;
        println!(
            "{mass} {} {weight} {}",
            before.translation.y - after.translation.y,
            wrenches[20].force.z
        );
        assert!(error.abs() < 0.05, "{mass} kg: {weight} N carried at rest, off by {error:.3}");
    }
}

#[test]
fn a_minute_of_holding_moves_nothing() {
    for mass in [0.005, 0.1, 0.5] {
        let grip = 40.0 * mass + 2.0;
        let mut scene = gripped(&soft(), &ball(), mass, grip);
        scene.set_gravity(9.81);
        hold(&mut scene, grip, 2.0);
        let before = scene.state().object_in_wrist();
        hold(&mut scene, grip, 60.0);
        let after = scene.state().object_in_wrist();
        let moved = (after.translation.vector - before.translation.vector).norm();
        let turned = after.rotation.angle_to(&before.rotation);
        assert!(moved < 1e-6 && turned < 1e-4, "{mass} kg: {moved} m, {turned} rad");
    }
}

/// The table bears an object that stands on it, and pads that close on its sides do not. After a
/// lift the object hangs equally far below its first position in the hand, however slowly the pads
/// have closed.
#[test]
fn what_stands_on_the_table_does_not_wear_the_hold() {
    let ellipsoid = Shape::Ellipsoid { semi_axes: Vector3::new(0.02, 0.014, 0.016) };
    for (model, height) in [(ball(), 0.015), (ObjectModel::new(ellipsoid).unwrap(), 0.016)] {
        let (mass, grip) = (0.25, 4.5);
        let mut sunk = Vec::new();
        for rate in [10.0, 5.0, 2.5] {
            let pose = Isometry3::translation(0.0, 0.0, height);
            let object = SceneObject { model: &model, scale: 1.0, mass, friction: 0.6, pose };
            let mut scene = Scene::new(&soft(), &object, &pose.translation.vector, 0.0).unwrap();
            hold(&mut scene, 0.3, 1.0);
            let period = scene.config().physics.control_period;
            let ramp = (1..).map(|step| 0.3 * (rate * period * f64::from(step)).exp());
            ramp.take_while(|force| *force < grip)
                .for_each(|force| hold(&mut scene, force, period));
            hold(&mut scene, grip, 0.4);
            let taken = scene.state();
            for finger in &taken.fingers {
                assert!(finger.touches());
                let sideways = finger.wrench.force.xy().norm();
                assert!(sideways < 0.02 * mass * 9.81, "{sideways} N sideways at {rate}/s");
            }
            let up = Command { velocity: 0.1 * Vector3::z(), grip, ..Command::default() };
            (0..25).for_each(|_| scene.step(&up));
            hold(&mut scene, grip, 0.4);
            let below = |state: &SceneState| state.object_in_wrist().translation.z;
            sunk.push(below(&taken) - below(&scene.state()));
        }
        println!("{sunk:?} m");
        for way in &sunk[1..] {
            assert!((way / sunk[0] - 1.0).abs() < 0.05, "{sunk:?} m");
        }
    }
}

/// A prism in the hand used to jump by 0.4 mm, over and over, because the normal of a whole row of
/// bristles turned by 45° as the crease between two faces passed it.
#[test]
fn forces_change_evenly_as_creases_pass_the_bristles() {
    let shape = Shape::Prism { sides: 8, radius: 0.017, half_height: 0.019 };
    let model = ObjectModel::new(shape).unwrap();
    // The axis of the prism lies across the finger, and a face on the gel.
    let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
    let height = 0.017 * (std::f64::consts::PI / 8.0).cos() - 0.4 * MM;
    let at = |i: i32| {
        let place = Vector3::new(0.0, f64::from(i) * 0.01 * MM, height);
        Isometry3::from_parts(place.into(), turn)
    };
    let path: Vec<_> = (0..=300).map(at).collect();
    let wrenches = gel().wrenches(&model, 0.0, &path);
    let most = wrenches.iter().map(|wrench| wrench.force.norm()).fold(0.0, f64::max);
    let step = |pair: &[Wrench]| (pair[1].force - pair[0].force).norm();
    let jump = wrenches.windows(2).map(step).fold(0.0, f64::max);
    assert!(most > 5.0 && jump < 0.01 * most, "a jump of {jump} N of {most} N in 10 µm");
}

#[test]
fn without_a_touch_the_wrench_is_zero() {
    let pose = Isometry3::translation(0.0, 0.0, 0.015);
    let model = ball();
    let object = SceneObject { model: &model, scale: 1.0, mass: 0.1, friction: 0.8, pose };
    let away = Vector3::new(0.0, 0.0, 0.016);
    let mut scene = Scene::new(&soft(), &object, &away, 0.0).unwrap();
    let check = |scene: &Scene| {
        for finger in scene.state().fingers {
            assert_eq!(finger.wrench, Wrench::default());
            assert!(!finger.touches());
        }
        assert_eq!(scene.indentations(), [0.0; 2]);
    };
    check(&scene);
    hold(&mut scene, -1.0, 0.2);
    check(&scene);
    hold(&mut scene, 5.0, 1.0);
    assert!(scene.state().fingers.iter().all(FingerState::touches));
    assert!(scene.indentations().iter().all(|depth| *depth > 0.0));
    hold(&mut scene, -5.0, 0.4);
    check(&scene);
}

#[test]
fn a_saved_scene_goes_on_bit_for_bit() {
    for name in ["sphere", "potato"] {
        let model = ObjectModel::new(ruffini_core::scene::named(name).unwrap()).unwrap();
        let mut scene = gripped(&soft(), &model, 0.1, 5.0);
        let push = Wrench { force: Vector3::new(0.1, 0.2, -6.0), torque: Vector3::zeros() };
        scene.correct(0, &push);
        let bytes = postcard::to_stdvec(&scene).unwrap();
        let mut other: Scene = postcard::from_bytes(&bytes).unwrap();
        other.attach(&[&model]);
        let mut lost: Scene = postcard::from_bytes(&bytes).unwrap();
        hold(&mut lost, 5.0, 0.04);
        assert_eq!(lost.state().failure, Some(Failure::Detached));
        for step in 0..50 {
            let velocity = Vector3::new(0.1 * f64::from(step).sin(), 0.05, 0.05);
            let command = Command { velocity, yaw_rate: 0.3, grip: 5.0 };
            scene.step(&command);
            other.step(&command);
            assert_eq!(scene.state(), other.state(), "{name}, step {step}");
        }
        assert_eq!(postcard::to_stdvec(&scene).unwrap(), postcard::to_stdvec(&other).unwrap());
    }
}

#[test]
fn random_actions_on_every_object_stay_finite_and_replay_from_a_snapshot() {
    let objects = CATALOGUE.map(|name| ObjectSpec::Name(name.into())).into();
    let config =
        TaskConfig { scene: soft(), objects, tactile: Choice::None, ..TaskConfig::default() };
    let setup = Arc::new(Setup::new(config).unwrap());
    let batch = || Batch::new(Arc::clone(&setup), 12, 1, Autoreset::NextStep).unwrap();
    let mut first = batch();
    first.seed(&(0..12).map(Some).collect::<Vec<_>>()).unwrap();
    first.reset(None).unwrap();
    let mut second = batch();
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let (mut met, mut met_again) = ([false; 12], [false; 12]);
    for step in 0..300 {
        if step == 150 {
            second.load(&first.save()).unwrap();
        }
        // At random, and with open fingers towards the object, to close on it.
        let mean = |row: &Row| {
            let (state, _) = row.state().expect("the row was reset");
            let way = state.object_in_wrist().translation.vector;
            let grip = if way.norm() < 0.01 { 0.5 } else { -0.5 };
            let toward = |x: f64| (30.0 * x).clamp(-1.0, 1.0);
            [toward(way.x), toward(way.y), toward(way.z), 0.0, grip]
        };
        let means: Vec<f64> = first.rows().iter().flat_map(mean).collect();
        let mut drawn = |mean: f64| (mean + random.random_range(-0.5..0.5)) as f32;
        let actions: Vec<f32> = means.into_iter().map(&mut drawn).collect();
        let result = first.step(&actions).unwrap();
        for outcome in &result.outcomes {
            let sound = outcome.ending.is_none_or(|ending| ending == Ending::ObjectLost);
            assert!(sound, "step {step}: {:?}", outcome.ending);
        }
        if step >= 150 {
            assert_eq!(second.step(&actions).unwrap().observation, result.observation);
        }
        let met = if step < 150 { &mut met } else { &mut met_again };
        for (met, row) in met.iter_mut().zip(first.rows()) {
            let touches =
                |(state, _): (SceneState, _)| state.fingers.iter().any(FingerState::touches);
            *met |= row.state().is_some_and(touches);
        }
    }
    let count = |met: [bool; 12]| met.into_iter().filter(|met| *met).count();
    let rows = [count(met), count(met_again)];
    assert!(rows.iter().all(|rows| *rows >= 10), "fingers touched in {rows:?} of 12 rows");
}

#[test]
fn extremes_are_held_or_dropped_and_stay_finite() {
    let block = ObjectModel::new(Shape::Cuboid { half_extents: [0.015, 0.015, 0.02].into() });
    let models = [("ball", ball()), ("block", block.unwrap())];
    let base = GraspCase { config: soft(), hold: 1.0, ..GraspCase::default() };
    let with_young = |young| soft().with_pads(SoftPads { young, ..gel() });
    let with_step = |step: f64, iterations| {
        let mut config = soft();
        config.physics.time_step = step;
        config.physics.control_period = step * (0.04 / step).round();
        config.physics.iterations = iterations;
        config
    };
    let mut trials = Vec::new();
    for mass in [1e-3, 5e-3, 0.02, 1.0] {
        trials.push((format!("{mass} kg"), GraspCase { mass, ..base.clone() }));
    }
    for friction in [0.0, 0.05, 0.3, 2.0, 5.0] {
        trials.push((format!("friction {friction}"), GraspCase { friction, ..base.clone() }));
    }
    for young in [1e5, 1e6] {
        for mass in [0.005, 0.5] {
            let config = with_young(young);
            let trial = GraspCase { config, mass, grip: 15.0, ..base.clone() };
            trials.push((format!("{young} Pa, {mass} kg"), trial));
        }
    }
    for (step, iterations) in [(1.0 / 120.0, 8), (1.0 / 500.0, 2), (1.0 / 1000.0, 1)] {
        for mass in [0.005, 0.1, 0.5] {
            let config = with_step(step, iterations);
            let trial = GraspCase { config, mass, grip: 15.0, ..base.clone() };
            trials.push((format!("{step} s, {mass} kg"), trial));
        }
    }
    let (mut holds, mut drops, mut wrong) = (0, 0, Vec::new());
    for (name, trial) in &trials {
        for (shape, model) in &models {
            let o = run(model, trial).unwrap();
            let friction = 2.0 * trial.friction * trial.grip;
            let must_hold = friction > 1.5 * 16.0 * trial.mass;
            let must_drop = friction < 0.8 * 9.81 * trial.mass;
            holds += usize::from(must_hold);
            drops += usize::from(must_drop);
            let held = o.lifted > 0.95 * HEIGHT && o.hold_slip < 0.5e-3 && o.shake_slip < 3e-3;
            let right =
                !o.failed && (!must_hold || held) && (!must_drop || o.lifted < 0.5 * HEIGHT);
            println!("{shape}, {name}: {} {o:?}", if right { "ok" } else { "WRONG" });
            if !right {
                wrong.push(format!("{shape}, {name}: {o:?}"));
            }
        }
    }
    assert_eq!((holds, drops), (38, 2));
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn pads_that_do_not_fit_are_refused() {
    let mut config = soft();
    config.gripper.pad_width = 0.03;
    let error = config.validate().unwrap_err().to_string();
    assert!(error.starts_with("pads.outline"), "{error}");
    let pads = Pads::Soft(SoftPads { young: f64::NAN, ..gel() });
    let error = SceneConfig { pads, ..soft() }.validate().unwrap_err().to_string();
    assert!(error.starts_with("pads.young"), "{error}");
}

/// The object's pose in the scene and the pad's mesh agree: the greatest depth of the mesh's face
/// nodes inside the object equals the indentation.
#[test]
fn the_pose_in_the_pads_frame_is_that_of_its_mesh() {
    let model = ObjectModel::new(Shape::Cuboid { half_extents: [0.012, 0.015, 0.02].into() });
    let scene = gripped(&soft(), &model.unwrap(), 0.1, 5.0);
    let mesh = Sensor::named("gelsight-mini").unwrap().pad(1000).unwrap();
    for (finger, indentation) in scene.state().fingers.iter().zip(scene.indentations()) {
        let depth = |&node: &u32| {
            let place: Point3<f64> = mesh.mesh.vertices[node as usize];
            let half_extents = Vector3::new(0.012, 0.015, 0.02);
            -Shape::Cuboid { half_extents }
                .distance(&finger.object.inverse_transform_point(&place))
                .value
        };
        let deepest = mesh.face.iter().map(depth).fold(f64::NEG_INFINITY, f64::max);
        let error = (indentation - deepest).abs();
        assert!(error < 0.1 * deepest, "{indentation} m, mesh {deepest} m");
        // The wrist's z is the pad's y.
        let turned = finger.object.rotation * Vector3::z();
        assert!(UnitQuaternion::rotation_between(&turned, &Vector3::y()).unwrap().angle() < 1e-3);
    }
}

/// The elastic foundation was fitted to finite elements by `fit_foundation`. On another mesh its
/// error is the one that this finds, a quarter at most at depths from 0.3 mm on.
#[test]
fn the_fitted_foundation_presses_like_the_finite_elements() {
    let sensor = Sensor::named("gelsight-mini").unwrap();
    let calibration = &sensor.calibrations[0];
    let pad = sensor.pad(1000).unwrap();
    let moduli = Moduli::from(calibration);
    let body = SoftBody::new(pad.mesh, Law::default(), moduli, &pad.base).unwrap();
    let fem = Fem::new(body, FemOptions { friction: 1.0, ..FemOptions::default() }).unwrap();
    let at = |x: f64, depth: f64| Isometry3::translation(x * MM, 0.0, 0.015 - depth * MM);
    let path = [at(0.0, 0.3), at(0.0, 0.6), at(0.0, 1.0), at(0.05, 1.0)];
    let press = Press::along(vec![ball().shape().clone()], path.map(|pose| vec![pose]).into());
    let frames = fem.solve_path(&press.unwrap());
    let down: Vec<_> = (1..=10).map(|i| at(0.0, 0.1 * f64::from(i))).chain([path[3]]).collect();
    let foundation = gel().wrenches(&ball(), 1.0, &down);
    for (frame, i) in frames.iter().zip([2, 5, 9, 10]) {
        let (exact, found) = (frame.as_ref().unwrap().wrench.force, foundation[i].force);
        let error = found.z / exact.z - 1.0;
        assert!(error.abs() < 0.27, "{} N against {} N: {error:.2}", found.z, exact.z);
    }
    let (exact, found) = (frames[3].as_ref().unwrap().wrench.force.x, foundation[10].force.x);
    let error = found / exact - 1.0;
    assert!(error.abs() < 0.25, "sideways {found} N against {exact} N: {error:.2}");
}
