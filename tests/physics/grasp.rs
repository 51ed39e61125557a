//! The grasp matrix: close on an object, lift it by 10 cm, hold it for 5 s, shake it at 3 Hz.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use ruffini_core::{
    Result,
    geometry::{Shape, StarShaped, Wave},
    scene::{Command, ObjectModel, Scene, SceneConfig, SceneObject, SceneState, named},
};

/// Parameters of one grasp.
#[derive(Clone)]
pub(crate) struct GraspCase {
    pub(crate) config: SceneConfig,
    pub(crate) mass: f64,
    pub(crate) friction: f64,
    pub(crate) grip: f64,
    pub(crate) shake: bool,
    pub(crate) hold: f64,
}

impl Default for GraspCase {
    fn default() -> Self {
        Self {
            config: SceneConfig::default(),
            mass: 0.1,
            friction: 0.8,
            grip: 10.0,
            shake: true,
            hold: 5.0,
        }
    }
}

/// Result of a grasp.
#[derive(Debug, Default)]
pub(crate) struct GraspResult {
    pub(crate) failed: bool,
    /// Rise of the object over the table at the end of the hold (m).
    pub(crate) lifted: f64,
    /// Motion of the object in the hand during the hold and the shaking (m).
    pub(crate) hold_slip: f64,
    pub(crate) shake_slip: f64,
    /// Mean normal force of a pad during the hold (N).
    pub(crate) normal_force: f64,
    /// Largest relative error of Σ contact force against weight plus inertia during the hold.
    pub(crate) imbalance: f64,
    /// Largest speed of the object (m/s).
    pub(crate) top_speed: f64,
}

/// Height of the lift (m).
pub(crate) const HEIGHT: f64 = 0.1;
const SETTLE: f64 = 0.2;
const CLOSE: f64 = 0.9;
const LIFT: f64 = 1.0;
const SHAKE: f64 = 3.0;

fn smooth(s: f64) -> f64 {
    let s = s.clamp(0.0, 1.0);
    s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
}

/// Wrist pose at time `t` (s) of a grasp at height `z` (m).
fn wrist(trial: &GraspCase, t: f64, z: f64) -> Isometry3<f64> {
    let lifting = SETTLE + CLOSE;
    let shaking = lifting + LIFT + trial.hold;
    let lift = HEIGHT * smooth((t - lifting) / LIFT);
    let s = t - shaking;
    let envelope = (s / 0.3).clamp(0.0, 1.0) * ((SHAKE - s) / 0.3).clamp(0.0, 1.0);
    let swing = |amplitude: f64, frequency: f64| amplitude * envelope * (TAU * frequency * s).sin();
    let position = Vector3::new(swing(0.01, 3.0), swing(0.01, 2.5), z + lift + swing(0.01, 3.4));
    let turn = Vector3::new(swing(0.35, 1.1), swing(0.35, 0.9), swing(0.35, 0.7));
    Isometry3::from_parts(Translation3::from(position), UnitQuaternion::from_scaled_axis(turn))
}

pub(crate) fn run(model: &ObjectModel, trial: &GraspCase) -> Result<GraspResult> {
    let mut config = trial.config.clone();
    config.gripper.max_force = trial.grip;
    let pose = model.rest(1.0, 0.0, 0.0, 0.0);
    let object =
        SceneObject { model, scale: 1.0, mass: trial.mass, friction: trial.friction, pose };
    let z = pose.translation.z.max(trial.config.workspace.low[2]);
    let start = Vector3::new(0.0, 0.0, z);
    let mut scene = Scene::new(&config, &object, &start, 0.0)?;
    let dt = trial.config.physics.time_step;
    let lifted_at = SETTLE + CLOSE + LIFT;
    let held_until = lifted_at + trial.hold;
    let end = held_until + if trial.shake { SHAKE } else { 0.0 };
    let mut outcome = GraspResult::default();
    let (mut held_from, mut shaken_from): (Option<SceneState>, Option<SceneState>) = (None, None);
    let (mut forces, mut before) = (Vec::new(), scene.state());
    for i in 1..=(end / dt).round() as usize {
        let t = i as f64 * dt;
        // Weightless until gripped, so that the test is of holding and not of balancing.
        let gripped = t > SETTLE + CLOSE - 0.1;
        scene.set_gravity(if gripped { trial.config.physics.gravity } else { 0.0 });
        scene.advance(&wrist(trial, t, z), if t > SETTLE { trial.grip } else { -1.0 });
        let state = scene.state();
        if state.failure.is_some() {
            outcome.failed = true;
            return Ok(outcome);
        }
        outcome.top_speed = outcome.top_speed.max(state.object.velocity.norm());
        if t > lifted_at + 0.2 && t <= held_until {
            held_from.get_or_insert_with(|| state.clone());
            forces.push(0.5 * (state.fingers[0].normal_force() + state.fingers[1].normal_force()));
            let error = imbalance(trial, &before, &state, dt);
            outcome.imbalance = outcome.imbalance.max(error);
        }
        if t > held_until {
            shaken_from.get_or_insert_with(|| state.clone());
        }
        if (t - held_until).abs() < 0.5 * dt {
            outcome.lifted = state.object.pose.translation.z - pose.translation.z;
            outcome.hold_slip = slip(held_from.as_ref().unwrap(), &state);
        }
        before = state;
    }
    outcome.normal_force = forces.iter().sum::<f64>() / forces.len() as f64;
    outcome.shake_slip = shaken_from.map_or(0.0, |from| slip(&from, &before));
    Ok(outcome)
}

/// Motion of the object's origin relative to the middle of the two pads (m).
fn slip(from: &SceneState, to: &SceneState) -> f64 {
    let seen = |state: &SceneState| {
        let [a, b] = [0, 1].map(|k| state.fingers[k].pad.translation.vector);
        let offset = state.object.pose.translation.vector - 0.5 * (a + b);
        state.wrist.pose.rotation.inverse() * offset
    };
    (seen(to) - seen(from)).norm()
}

/// |Σ contact force − m (a + g)| relative to the weight.
fn imbalance(trial: &GraspCase, before: &SceneState, state: &SceneState, dt: f64) -> f64 {
    let on_object = |k: usize| {
        let finger = &state.fingers[k];
        -(finger.pad.rotation * finger.wrench.force)
    };
    let weight = trial.mass * trial.config.physics.gravity;
    let acceleration = (state.object.velocity - before.object.velocity) / dt;
    let needed = trial.mass * acceleration + weight * Vector3::z();
    (on_object(0) + on_object(1) + state.table.force - needed).norm() / weight
}

/// The nine shapes, about 30 mm wide.
pub(crate) fn shapes() -> Vec<(&'static str, ObjectModel)> {
    // The peanut has a waist, so that its triangles collide and not its hull.
    let peanut = Shape::StarShaped(StarShaped::new(
        Vector3::new(0.018, 0.018, 0.024),
        vec![Wave { amplitude: -0.25, vector: Vector3::z() * 3.0, phase: 0.0 }],
    ));
    let peanut = Shape::Mesh(peanut.surface(16).unwrap().into());
    let shapes = [
        ("sphere", Shape::Sphere { radius: 0.015 }),
        ("cuboid", Shape::Cuboid { half_extents: Vector3::new(0.015, 0.015, 0.020) }),
        ("cylinder", Shape::Cylinder { radius: 0.015, half_height: 0.020 }),
        ("32-gon", Shape::Prism { sides: 32, radius: 0.015, half_height: 0.020 }),
        ("octagon", Shape::Prism { sides: 8, radius: 0.016, half_height: 0.015 }),
        ("annulus", Shape::Annulus { outer: 0.020, inner: 0.013, half_height: 0.010 }),
        ("cup", Shape::Cup { bottom: 0.016, rim: 0.020, half_height: 0.020, wall: 0.002 }),
        ("potato", named("potato").unwrap()),
        ("peanut mesh", peanut),
    ];
    shapes.map(|(name, shape)| (name, ObjectModel::new(shape).unwrap())).into()
}

/// Runs the 63 grasps of the matrix and describes those that went wrong.
pub(crate) fn matrix(config: &SceneConfig) -> Vec<String> {
    let (mut held, mut dropped, mut wrong) = (0, 0, Vec::new());
    for (name, model) in shapes() {
        for (mass, grip) in
            [0.02, 0.1, 0.5].into_iter().flat_map(|m| [1.0, 5.0, 20.0].map(|g| (m, g)))
        {
            let trial = GraspCase { config: config.clone(), mass, grip, ..GraspCase::default() };
            // Shaking needs up to 16 m/s² of friction; a third of reserve stays clear of the limit.
            let friction = 2.0 * trial.friction * grip;
            let (must_hold, must_drop) =
                (friction > 1.5 * 16.0 * mass, friction < 0.8 * 9.81 * mass);
            if !(must_hold || must_drop) {
                continue;
            }
            let o = run(&model, &trial).unwrap();
            let right = if must_hold {
                held += 1;
                let carried = (o.lifted - HEIGHT).abs() < 5e-3 && o.imbalance < 0.02;
                carried && o.hold_slip < 0.5e-3 && o.shake_slip < 3e-3
            } else {
                dropped += 1;
                o.lifted < 0.5 * HEIGHT
            };
            println!("{name} {mass} kg {grip} N: {} {o:?}", if right { "ok" } else { "WRONG" });
            if o.failed || !right {
                wrong.push(format!("{name}, {mass} kg, {grip} N: {o:?}"));
            }
        }
    }
    assert_eq!((held, dropped), (54, 9));
    wrong
}

#[test]
fn what_must_hold_holds_and_what_must_drop_drops() {
    let wrong = matrix(&SceneConfig::default());
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Fall distance (m) in 1 s under gravity of an object gripped in weightlessness.
fn fall(model: &ObjectModel, mass: f64, grip: f64, friction: f64) -> f64 {
    let config = SceneConfig::default();
    let pose = Isometry3::translation(0.0, 0.0, 0.1);
    let object = SceneObject { model, scale: 1.0, mass, friction, pose };
    let mut scene = Scene::new(&config, &object, &pose.translation.vector, 0.0).unwrap();
    let period = config.physics.control_period;
    for i in 0..50 {
        let gripped = f64::from(i) * period >= 1.0;
        scene.set_gravity(if gripped { config.physics.gravity } else { 0.0 });
        scene.step(&Command { grip, ..Command::default() });
    }
    0.1 - scene.state().object.pose.translation.z
}

/// Two pads carry m g above the friction coefficient μ* = m g / 2 F. This holds only for faces that
/// lie flat on the pads: tapered or lumpy bodies have another limit.
///
/// The block of 0.5 kg is an exception. Friction that was locked in across the slip direction
/// during closing decays only with slip. In four-point contacts under bodies much heavier than a
/// finger it takes between 10 and 12 % of the limit.
#[test]
fn an_object_slips_within_six_percent_of_the_coulomb_limit() {
    let square = ["sphere", "cuboid", "cylinder", "32-gon", "octagon", "annulus"];
    for (name, model) in shapes().iter().filter(|(name, _)| square.contains(name)) {
        for (mass, grip) in [(0.02, 5.0), (0.1, 10.0), (0.5, 20.0)] {
            let limit = mass * 9.81 / (2.0 * grip);
            let reserve = if *name == "cuboid" && mass == 0.5 { 0.12 } else { 0.06 };
            let [below, above] = [0.94, 1.0 + reserve].map(|f| fall(model, mass, grip, f * limit));
            assert!(below > 0.02, "{name}, {mass} kg: fell only {below} m below the limit");
            assert!(above < 0.5e-3, "{name}, {mass} kg: fell {above} m above the limit");
        }
    }
}

#[test]
fn extremes_stay_finite_and_right() {
    let cuboid =
        |half: [f64; 3]| ObjectModel::new(Shape::Cuboid { half_extents: half.into() }).unwrap();
    let sphere = |radius| ObjectModel::new(Shape::Sphere { radius }).unwrap();
    let (block, ball) = (cuboid([0.015, 0.015, 0.02]), sphere(0.015));
    let plate = cuboid([0.0005, 0.015, 0.015]);
    let base = GraspCase { hold: 2.0, ..GraspCase::default() };
    let mut fast = base.clone();
    fast.config.gripper.closing_speed = 5.0;
    let strong = GraspCase { grip: 100.0, ..base.clone() };
    let mut cases: Vec<(String, &ObjectModel, GraspCase)> = Vec::new();
    for mass in [1e-5, 1e-4, 5e-4, 1e-3, 1e-2, 1.0, 10.0, 100.0, 1000.0] {
        for (name, model) in [("block", &block), ("ball", &ball)] {
            cases.push((format!("{name} of {mass} kg"), model, GraspCase { mass, ..base.clone() }));
        }
    }
    for friction in [0.0, 0.2, 0.5, 1.0, 2.0] {
        cases.push((
            format!("friction {friction}"),
            &block,
            GraspCase { friction, ..base.clone() },
        ));
    }
    let (small_block, small_ball) = (cuboid([0.0025; 3]), sphere(0.0025));
    let small = GraspCase { mass: 0.0005, grip: 2.0, ..base.clone() };
    cases.push(("5 mm block".into(), &small_block, small.clone()));
    cases.push(("5 mm ball".into(), &small_ball, small));
    cases.push(("100 N".into(), &block, strong.clone()));
    cases.push(("100 N on a ball".into(), &ball, strong));
    cases.push(("5 m/s".into(), &block, fast.clone()));
    cases.push(("5 m/s on a ball".into(), &ball, fast));
    for mass in [0.002, 0.05] {
        let trial = GraspCase { mass, grip: 5.0, ..base.clone() };
        cases.push((format!("1 mm plate of {mass} kg"), &plate, trial));
    }
    let (mut holds, mut drops, mut refused, mut wrong) = (0, 0, 0, Vec::new());
    for (name, model, trial) in &cases {
        // Rapier's forces are accurate up to a ratio of grip force to mass of 20 000 m/s².
        let o = match run(model, trial) {
            Ok(o) => o,
            Err(error) => {
                assert!(trial.grip / trial.mass > 2e4, "{name}: {error}");
                assert!(error.to_string().starts_with("object mass"), "{name}: {error}");
                refused += 1;
                continue;
            }
        };
        let friction = 2.0 * trial.friction * trial.grip;
        let must_hold = friction > 1.5 * 16.0 * trial.mass;
        let must_drop = friction < 0.8 * 9.81 * trial.mass;
        holds += usize::from(must_hold);
        drops += usize::from(must_drop);
        let force = (o.normal_force / trial.grip - 1.0).abs();
        let held =
            o.lifted > 0.95 * HEIGHT && force < 0.02 && o.hold_slip < 0.5e-3 && o.shake_slip < 3e-3;
        let right = !o.failed && (!must_hold || held) && (!must_drop || o.lifted < 0.5 * HEIGHT);
        println!("{name}: {} {o:?}", if right { "ok" } else { "WRONG" });
        if !right {
            wrong.push(format!("{name}: {o:?}"));
        }
    }
    assert_eq!((holds, drops, refused), (18, 7, 4));
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn what_nobody_touches_stays_where_it_stands() {
    let away = Vector3::new(0.1, 0.1, 0.2);
    let plain = ["sphere", "cuboid", "cylinder", "prism", "annulus", "cup"];
    // Hulls of flat faces, which chatter where contact is too stiff.
    let hulls = ["ellipsoid", "potato", "lemon", "apple", "eggplant"];
    for name in plain.into_iter().chain(hulls) {
        let model = ObjectModel::new(named(name).unwrap()).unwrap();
        let pose = model.rest(1.0, 0.0, 0.0, 0.3);
        let object = SceneObject { model: &model, scale: 1.0, mass: 0.1, friction: 0.8, pose };
        let mut scene = Scene::new(&SceneConfig::default(), &object, &away, 0.0).unwrap();
        let mut at = |steps: u32| {
            (0..steps).for_each(|_| scene.step(&Command::default()));
            scene.state().object.pose.translation.vector
        };
        let way = (at(10) - at(250)).norm();
        // At most 0.01 mm in 10 s; a cup with a floor in one piece moves by 5 mm.
        assert!(way < 1e-5, "{name} went {:.3} mm in 10 s", 1e3 * way);
    }
}
