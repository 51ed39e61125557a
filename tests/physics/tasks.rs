//! The tasks: the load on a held object, endings at limits, and clean restarts.

use std::sync::Arc;

use nalgebra::Vector3;
use ruffini_core::{
    env::{Autoreset, Batch, Setup, StepResult},
    scene::{Command, Gripper, ObjectModel, Scene, SceneConfig, SceneObject, named},
    tactile::{Choice, Resolution},
    task::{Ending, ObjectSpec, StateChannel, TACTILE_CHANNELS, Task, TaskConfig},
};

const GRAVITY: f64 = 9.81;

/// Default settings of a task with every channel that needs none, and a coarse pad for speed.
fn config(task: &str, tactile: Choice) -> TaskConfig {
    let task = Task::named(task).unwrap();
    let felt = if tactile == Choice::None { &[][..] } else { &TACTILE_CHANNELS };
    let own = StateChannel::SHARED.iter().chain(task.channels()).map(|channel| channel.name());
    let channels = own
        .chain(felt.iter().copied())
        .filter(|name| !["distractors", "predicted_error"].contains(name));
    TaskConfig {
        tactile,
        resolution: Resolution { nodes: 150, ..Resolution::default() },
        observation: Some(channels.map(String::from).collect()),
        ..TaskConfig::of(&task)
    }
}

/// `config` with other values of its numeric settings.
fn with(mut config: TaskConfig, settings: &[(&str, f64)]) -> TaskConfig {
    for (name, value) in settings {
        config.set(name, &(*value).into()).unwrap();
    }
    config
}

/// Configuration of a sphere in the hand with a constant `load`.
fn loaded(tactile: Choice, load: f64, grip: f64) -> TaskConfig {
    let objects = vec![ObjectSpec::Name("sphere".into())];
    let settings = [("friction", 0.8), ("start_grip", grip), ("load", load), ("shaking", 0.0)];
    with(TaskConfig { objects, ..config("HoldStill", tactile) }, &settings)
}

fn batch(config: TaskConfig, rows: usize, autoreset: Autoreset) -> (Batch, Vec<f32>) {
    let setup = Arc::new(Setup::new(config).unwrap());
    let mut batch = Batch::new(setup, rows, 1, autoreset).unwrap();
    batch.seed(&(0..rows as u64).map(Some).collect::<Vec<_>>()).unwrap();
    let observation = batch.reset(None).unwrap();
    (batch, observation)
}

/// Actions (N, 5) of a hand at rest, with the grip component from `grip`.
fn gripping(rows: usize, grip: impl Fn(usize) -> f32) -> Vec<f32> {
    (0..rows).flat_map(|row| [0.0, 0.0, 0.0, 0.0, grip(row)]).collect()
}

/// Force of both pads on the object of the only row, in the world (N).
fn held_by(batch: &Batch) -> Vector3<f64> {
    let (state, _) = batch.rows()[0].state().unwrap();
    -state.fingers.iter().map(|f| f.pad.rotation * f.wrench.force).sum::<Vector3<f64>>()
}

/// Part of a row's observation that belongs to one channel.
fn channel<'a>(batch: &Batch, observation: &'a [f32], row: usize, name: &str) -> &'a [f32] {
    let layout = batch.setup().layout();
    let mut start = row * layout.size();
    for (channel, components) in layout.channels() {
        let size: usize = components.iter().map(|component| component.low.len()).sum();
        if *channel == name {
            return &observation[start..start + size];
        }
        start += size;
    }
    panic!("no channel {name}");
}

#[test]
fn an_episode_of_holding_starts_with_the_object_at_rest_between_the_pads() {
    for tactile in [Choice::None, Choice::Compliance] {
        let (batch, observation) = batch(config("HoldStill", tactile), 12, Autoreset::Disabled);
        for (i, row) in batch.rows().iter().enumerate() {
            let (state, draw) = row.state().unwrap();
            for finger in &state.fingers {
                let force = finger.normal_force();
                assert!((force - 5.0).abs() < 0.25, "{tactile:?}, row {i}: {force} N, not 5 N");
            }
            let speed = state.object.velocity.norm();
            assert!(speed < 2e-3, "{tactile:?}, row {i}, object {}: {speed} m/s", draw.object);
            if tactile != Choice::None {
                let markers = channel(&batch, &observation, i, "markers");
                let most = markers.iter().fold(0.0f32, |most, x| most.max(x.abs()));
                assert!((1e-5..4e-3).contains(&most), "row {i}: markers moved by {most} m");
            }
        }
    }
}

#[test]
fn the_pads_bear_weight_and_load() {
    for tactile in [Choice::None, Choice::Compliance] {
        for load in [0.0, 1.5] {
            let (mut batch, _) = batch(loaded(tactile, load, 8.0), 1, Autoreset::Disabled);
            for _ in 0..50 {
                batch.step(&gripping(1, |_| 0.0)).unwrap();
            }
            let weight = batch.rows()[0].state().unwrap().1.mass * GRAVITY + load;
            let force = held_by(&batch);
            let error = (force - weight * Vector3::z()).norm();
            assert!(error < 0.02 * weight, "{tactile:?}: {force:?} N hold {weight} N");
        }
    }
}

/// A grip 1.3 times the Coulomb limit holds the sphere, one 0.7 times drops it.
#[test]
fn an_object_is_dropped_below_the_coulomb_limit_and_by_name() {
    let config = TaskConfig { mass: [0.1, 0.1], ..loaded(Choice::None, 1.0, 8.0) };
    let limit = (0.1 * GRAVITY + 1.0) / (2.0 * 0.8);
    let changes = [1.3f64, 0.7].map(|share| (share * limit / 8.0).ln());
    let most = config.task.gradual_grip().unwrap().rate * 0.04;
    let (mut batch, _) = batch(config, 2, Autoreset::Disabled);
    for step in 0..100 {
        // The grip changes at the largest rate until it has its target value.
        let action = |row: usize| ((changes[row] / most) as f32 + step as f32).clamp(-1.0, 0.0);
        let StepResult { outcomes, .. } = batch.step(&gripping(2, action)).unwrap();
        let still = outcomes[0].terms.get(&batch.setup().config().task, "still");
        assert!(outcomes[0].ending.is_none() && still > 0.9, "still {still} above the limit");
        if outcomes[1].terminated {
            assert_eq!(outcomes[1].ending, Some(Ending::Dropped));
            assert!(!outcomes[1].is_success);
            return;
        }
    }
    panic!("held below the limit");
}

/// The same hold succeeds with up to three times the least grip force and not with more, once the
/// grip has settled for a second.
#[test]
fn a_hold_by_too_much_force_is_no_success() {
    let task = Task::named("HoldStill").unwrap();
    for (grip, light) in [(3.5, true), (3.9, false)] {
        let config = TaskConfig { mass: [0.1, 0.1], ..loaded(Choice::None, 1.0, grip) };
        let least = (0.1 * GRAVITY + 1.0) / (2.0 * 0.8);
        let (mut batch, _) = batch(config, 1, Autoreset::Disabled);
        for step in 0..100 {
            let outcome = &batch.step(&gripping(1, |_| 0.0)).unwrap().outcomes[0];
            let success = light && step >= 25;
            assert_eq!(outcome.is_success, success, "{grip} N of {least} N, step {step}");
            let economy = outcome.terms.get(&task, "grip_economy");
            assert!((economy - (1.0 - grip / (6.0 * least))).abs() < 1e-9, "{economy}");
        }
    }
}

/// The fingers close at about the speed in the settings, so that first contact is gentle.
#[test]
fn gentle_fingers_close_at_their_speed() {
    let gripper = TaskConfig::of(&Task::named("GraspFragile").unwrap()).scene.gripper;
    for force in [1.0, 2.0, 5.0, 10.0] {
        let speed = closing_speed(&gripper, force);
        let error = (speed / gripper.closing_speed - 1.0).abs();
        assert!(error < 0.25, "{speed} m/s under {force} N");
    }
}

/// Mean speed of the fingers (m/s), closing without an object under `force` (N), after 0.3 s.
fn closing_speed(gripper: &Gripper, force: f64) -> f64 {
    let config = SceneConfig { gripper: gripper.clone(), ..SceneConfig::default() };
    let model = ObjectModel::new(named("sphere").unwrap()).unwrap();
    let pose = model.rest(1.0, 0.1, 0.1, 0.0);
    let object = SceneObject { model: &model, scale: 1.0, mass: 0.1, friction: 0.5, pose };
    let mut scene = Scene::new(&config, &object, &Vector3::new(-0.1, -0.1, 0.1), 0.0).unwrap();
    (0..7).for_each(|_| scene.step(&Command { grip: force, ..Command::default() }));
    let fingers = scene.state().fingers;
    -0.5 * (fingers[0].velocity + fingers[1].velocity)
}

#[test]
fn the_first_step_past_the_limit_ends_a_fragile_grasp() {
    let (mut batch, observation) =
        batch(config("GraspFragile", Choice::Compliance), 4, Autoreset::Disabled);
    let limits: Vec<f32> =
        (0..4).map(|row| channel(&batch, &observation, row, "stress_limit")[0]).collect();
    assert!(limits.windows(2).all(|pair| pair[0] != pair[1]), "{limits:?} Pa");
    let (mut ended, mut felt) = ([false; 4], 0);
    while ended != [true; 4] {
        let StepResult { observation, outcomes, .. } =
            batch.step(&[0.0, 0.0, 0.0, 0.0, 0.6].repeat(4)).unwrap();
        let running: Vec<_> = (0..4).filter(|&row| !ended[row]).collect();
        for row in running {
            let outcome = &outcomes[row];
            let stress = channel(&batch, &observation, row, "tet_stress");
            let peak = stress.iter().copied().fold(0.0, f32::max);
            let share = channel(&batch, &observation, row, "stress_ratio")[0];
            assert!((share - peak / limits[row]).abs() < 1e-6 * share, "{share} of the limit");
            let exceeded = outcome.ending == Some(Ending::StressExceeded);
            assert_eq!(exceeded, peak > limits[row], "{peak} of {} Pa", limits[row]);
            assert!(!outcome.truncated, "within {} Pa after all steps", limits[row]);
            ended[row] = exceeded;
            felt += usize::from(peak > 0.0 && !exceeded);
        }
        let over: Vec<_> = outcomes.iter().map(|outcome| outcome.terminated).collect();
        batch.reset(Some(&over)).unwrap();
    }
    assert!(felt > 4, "{felt} steps with stress within the limit");
}

/// The trial's grip lifts every object with the stress found in the trial, whether applied quickly
/// or slowly.
#[test]
fn every_limit_can_be_kept() {
    [10.0, 5.0].into_iter().for_each(keep_limits);
}

fn keep_limits(grip_rate: f64) {
    let config = with(config("GraspFragile", Choice::Compliance), &[("grip_rate", grip_rate)]);
    let start = config.task.gradual_grip().unwrap().start;
    let (mut batch, _) = batch(config, 24, Autoreset::Disabled);
    let draws: Vec<_> = batch.rows().iter().map(|row| row.state().unwrap().1).collect();
    let mut grips = [start; 24];
    for step in 0..60 {
        let mut actions = Vec::new();
        for (grip, draw) in grips.iter_mut().zip(&draws) {
            let most = grip_rate * 0.04;
            let change = (draw.trial.unwrap().grip / *grip).ln().clamp(-most, most);
            *grip *= change.exp();
            actions.extend([0.0, 0.0, if step < 20 { 0.0 } else { 0.4 }, 0.0, change / most]);
        }
        let actions: Vec<_> = actions.into_iter().map(|x| x as f32).collect();
        let StepResult { observation, outcomes, .. } = batch.step(&actions).unwrap();
        for (row, (outcome, draw)) in outcomes.iter().zip(&draws).enumerate() {
            assert!(!outcome.terminated, "step {step}, row {row}: {outcome:?}");
            if step == 59 {
                assert!(outcome.is_success, "row {row}: {outcome:?}");
                let share = channel(&batch, &observation, row, "stress_ratio")[0];
                let found = f64::from(share) * draw.trial.unwrap().margin;
                assert!((found - 1.0).abs() < 0.1, "row {row}: {found} of the trial's stress");
            }
        }
    }
}

#[test]
fn rewards_are_means_of_terms_in_the_unit_interval() {
    for name in ["GraspLift", "GraspFragile", "HoldStill"] {
        let task = Task::named(name).unwrap();
        let (mut batch, _) = batch(config(name, Choice::Compliance), 3, Autoreset::NextStep);
        for step in 0..40 {
            let wild = |i: usize| (0.7 * (i % 5) as f32 + 0.37 * i as f32 + step as f32).sin();
            let actions: Vec<_> = (0..15).map(wild).collect();
            for outcome in batch.step(&actions).unwrap().outcomes {
                let terms = outcome.terms.values(&task);
                assert_eq!(terms.len(), task.terms().len());
                let sound = terms.iter().chain([&outcome.reward]).all(|x| (0.0..=1.0).contains(x));
                assert!(sound, "{task:?}: {outcome:?}");
            }
        }
    }
}

/// The saved state after a reset does not depend on the history; a snapshot during shaking replays.
#[test]
fn gripped_objects_restart_and_replay_to_the_byte() {
    for (task, tactile) in [
        ("HoldStill", Choice::None),
        ("HoldStill", Choice::Compliance),
        ("GraspFragile", Choice::Compliance),
    ] {
        let config = config(task, tactile);
        let (mut used, _) = batch(config.clone(), 2, Autoreset::SameStep);
        for _ in 0..10 {
            used.step(&gripping(2, |row| 0.5 - 0.6 * row as f32)).unwrap();
        }
        let saved = used.save();
        let later = used.step(&gripping(2, |_| 0.4)).unwrap();
        used.load(&saved).unwrap();
        assert_eq!(used.step(&gripping(2, |_| 0.4)).unwrap().observation, later.observation);
        used.seed(&[Some(0), Some(1)]).unwrap();
        let again = used.reset(None).unwrap();
        let (fresh, first) = batch(config, 2, Autoreset::SameStep);
        assert_eq!(again, first, "{task:?}, {tactile:?}");
        assert_eq!(used.save(), fresh.save(), "{task:?}, {tactile:?}");
    }
}

#[test]
fn settings_of_another_task_are_refused_by_name() {
    let message = |json: &str| TaskConfig::from_json(json).unwrap_err().to_string();
    for (json, parts) in [
        (r#"{"task": "GraspFragile", "tactile": "none"}"#, ["tactile: found none", "surrogate"]),
        (r#"{"safety_factor": 2}"#, ["safety_factor", "GraspLift has no such setting"]),
        (r#"{"task": "GraspFragile", "safety_factor": 9}"#, ["safety_factor: found 9", "20 N"]),
        (r#"{"load": [0, 1]}"#, ["load", "GraspLift has no such setting"]),
        (r#"{"task": "HoldStill", "load": [2, 1]}"#, ["load", "rising range"]),
        (r#"{"task": "HoldStill", "load": "heavy"}"#, ["load: found \"heavy\"", "one number or"]),
        (r#"{"task": "HoldStill", "start_grip": 21}"#, ["start_grip", "21"]),
        (r#"{"task": "HoldStill", "max_grip_ratio": 0.5}"#, ["max_grip_ratio", "0.5"]),
        (r#"{"task": "HoldStill", "shaking_frequency": 126}"#, ["shaking_frequency", "0 to 125"]),
        (
            r#"{"task": "HoldStill", "reward_weights": {"lift": 1}}"#,
            ["lift", "still, grip_economy"],
        ),
        (
            r#"{"task": "HoldStill", "observation": "stress_limit"}"#,
            ["stress_limit", "one or more"],
        ),
        (r#"{"gripper": {"max_force": "big"}}"#, ["gripper.max_force", "invalid type"]),
        (r#"{"gripper": {"colour": 1}}"#, ["gripper", "colour"]),
        (r#"{"colour": 1}"#, ["settings: found colour", "one of mass"]),
        (r#"{"task": "juggle"}"#, ["task", "expected one of GraspLift"]),
    ] {
        let message = message(json);
        assert!(parts.iter().all(|part| message.contains(part)), "{json}: {message}");
    }
}
