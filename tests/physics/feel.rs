//! Environments with tactile sensing: presses of the whole batch, endings, snapshots, costs.

use std::sync::Arc;

use ruffini_core::{
    env::{Autoreset, Batch, Setup, StepResult},
    geometry::Shape,
    tactile::{Choice, Resolution},
    task::{Ending, ObjectSpec, ShapeSpec, StateChannel, TACTILE_CHANNELS, TaskConfig},
};

fn coarse(nodes: usize) -> Resolution {
    Resolution { nodes, ..Resolution::default() }
}

/// Configuration with the hand right above an object that it can hold, and a coarse pad for speed.
fn config(object: &str) -> TaskConfig {
    TaskConfig {
        objects: vec![ObjectSpec::Name(object.into())],
        position: [0.0, 0.0],
        start: [0.0, 0.0],
        start_height: [0.08, 0.08],
        yaw: [0.0, 0.0],
        size: [1.0, 1.0],
        tactile: Choice::Compliance,
        resolution: coarse(150),
        observation: Some(
            (StateChannel::SHARED.map(StateChannel::name).iter().chain(&TACTILE_CHANNELS))
                .filter(|name| **name != "predicted_error")
                .map(ToString::to_string)
                .collect(),
        ),
        ..TaskConfig::default()
    }
}

fn batch(config: TaskConfig, rows: usize, threads: usize, autoreset: Autoreset) -> Batch {
    let setup = Arc::new(Setup::new(config).unwrap());
    let mut batch = Batch::new(setup, rows, threads, autoreset).unwrap();
    batch.seed(&(0..rows as u64).map(Some).collect::<Vec<_>>()).unwrap();
    batch.reset(None).unwrap();
    batch
}

/// Actions (N, 5) that move down to the object, close with `grip` and lift; each row starts a
/// little later.
fn grasp(rows: usize, step: usize, grip: f32) -> Vec<f32> {
    let action = |row: usize| match step.saturating_sub(row % 3) {
        0..7 => [0.0, 0.0, -0.9, 0.0, -0.2],
        7..20 => [0.0, 0.0, 0.0, 0.0, grip],
        _ => [0.0, 0.0, 0.2, 0.1, grip],
    };
    (0..rows).flat_map(action).collect()
}

/// Part of a row's observation that belongs to one channel.
fn channel<'a>(batch: &Batch, result: &'a StepResult, row: usize, name: &str) -> &'a [f32] {
    let layout = batch.setup().layout();
    let mut start = row * layout.size();
    for (channel, components) in layout.channels() {
        let size: usize = components.iter().map(|component| component.low.len()).sum();
        if *channel == name {
            return &result.observation[start..start + size];
        }
        start += size;
    }
    panic!("no channel {name}");
}

#[test]
fn a_grasp_is_felt_by_both_fingers() {
    let mut batch = batch(config("sphere"), 1, 1, Autoreset::Disabled);
    let mut results = Vec::new();
    for step in 0..30 {
        results.push(batch.step(&grasp(1, step, 0.1)).unwrap());
        assert_eq!(results[step].outcomes[0].ending, None, "step {step}");
    }
    let before = channel(&batch, &results[2], 0, "markers");
    assert!(before.iter().all(|&x| x == 0.0), "felt something in the air");
    let (last, row) = (&results[29], 0);
    for name in ["markers", "displacement", "stress", "tet_stress", "traction", "wrench"] {
        let values = channel(&batch, last, row, name);
        for half in values.chunks(values.len() / 2) {
            assert!(half.iter().any(|&x| x != 0.0), "{name} of a finger is all zeros");
        }
    }
    // Each finger presses with the grip force.
    let wrench = channel(&batch, last, row, "wrench");
    for force in [wrench[2], wrench[8]] {
        assert!((force + 4.0).abs() < 0.4, "{force} N under a grip of 4 N");
    }
}

#[test]
fn a_row_that_feels_does_not_depend_on_its_batch_or_the_threads() {
    let short = TaskConfig { max_episode_steps: 25, ..config("cuboid") };
    for autoreset in [Autoreset::NextStep, Autoreset::SameStep] {
        let mut wide = batch(short.clone(), 4, 1, autoreset);
        let mut threaded = batch(short.clone(), 4, 3, autoreset);
        let mut narrow = batch(short.clone(), 1, 1, autoreset);
        let size = wide.setup().layout().size();
        for step in 0..40 {
            let a = grasp(4, step % 26, 0.2);
            let one = wide.step(&a).unwrap();
            let three = threaded.step(&a).unwrap();
            let alone = narrow.step(&a[..5]).unwrap();
            assert_eq!(one.observation, three.observation, "step {step}");
            assert_eq!(one.outcomes, three.outcomes, "step {step}");
            assert_eq!(one.observation[..size], alone.observation[..], "step {step}");
        }
    }
}

#[test]
fn a_snapshot_in_mid_grasp_replays_bit_for_bit() {
    let mut first = batch(config("cylinder"), 2, 1, Autoreset::NextStep);
    for step in 0..18 {
        first.step(&grasp(2, step, 0.15)).unwrap();
    }
    let saved = first.save();
    let mut second = batch(config("cylinder"), 2, 1, Autoreset::NextStep);
    second.load(&saved).unwrap();
    for step in 18..30 {
        let a = grasp(2, step, 0.15);
        let (one, two) = (first.step(&a).unwrap(), second.step(&a).unwrap());
        assert_eq!(one.observation, two.observation, "step {step}");
        assert_eq!(one.outcomes, two.outcomes, "step {step}");
    }
    let felt = first.step(&grasp(2, 30, 0.15)).unwrap();
    let touched = channel(&first, &felt, 0, "markers").iter().any(|&x| x != 0.0);
    assert!(touched, "nothing was felt at the end of the replay");
}

#[test]
fn a_reset_forgets_what_was_felt() {
    let mut used = batch(config("sphere"), 1, 1, Autoreset::Disabled);
    for step in 0..20 {
        used.step(&grasp(1, step, 0.2)).unwrap();
    }
    let mut fresh = batch(config("sphere"), 1, 1, Autoreset::Disabled);
    for batch in [&mut used, &mut fresh] {
        batch.seed(&[Some(7)]).unwrap();
    }
    assert_eq!(used.reset(None).unwrap(), fresh.reset(None).unwrap());
    assert_eq!(used.save(), fresh.save());
}

#[test]
fn a_press_without_an_answer_ends_its_episode_only() {
    // The full grip drives the edges of a thin ring between the nodes of the pads.
    let sharp = Shape::Annulus { outer: 0.02, inner: 0.0195, half_height: 0.01 };
    let ring = ShapeSpec { sharp, edge_radius: None };
    let ring = TaskConfig {
        objects: vec![ObjectSpec::Shape(ring)],
        tactile: Choice::Surrogate,
        resolution: Resolution::default(),
        ..config("sphere")
    };
    let mut batch = batch(ring, 3, 1, Autoreset::Disabled);
    let mut ended = [false; 3];
    for step in 0..25 {
        let mut actions = grasp(3, step, 1.0);
        // The last row never closes.
        actions[14] = actions[14].min(-0.2);
        let result = batch.step(&actions).unwrap();
        assert!(result.observation.iter().all(|x| x.is_finite()), "step {step}");
        let mut again = vec![false; 3];
        for (row, outcome) in result.outcomes.iter().enumerate() {
            let failed = outcome.ending == Some(Ending::PressFailed);
            // After a restart of the contact the error is reported and the episode goes on.
            assert!(outcome.press_error.is_some() || !failed);
            ended[row] |= failed;
            again[row] = outcome.terminated;
        }
        if again.contains(&true) {
            batch.reset(Some(&again)).unwrap();
        }
    }
    assert_eq!(ended, [true, true, false]);
}

#[test]
fn the_plan_lists_what_is_asked_for_and_what_it_costs() {
    let asked = |names: &[&str]| Some(names.iter().map(ToString::to_string).collect());
    let touch = TaskConfig { observation: asked(&["markers", "time"]), ..config("sphere") };
    let names = |batch: &mut Batch| {
        batch.plan(false).into_iter().map(|stage| stage.name).collect::<Vec<_>>()
    };
    let mut feeling = batch(touch.clone(), 2, 1, Autoreset::NextStep);
    let stages = [
        "scene",
        "press",
        "model compliance",
        "correction",
        "channel markers",
        "channel time",
        "reward",
    ];
    assert_eq!(names(&mut feeling), stages);
    let blind = TaskConfig { tactile: Choice::None, observation: asked(&["time"]), ..touch };
    assert_eq!(
        names(&mut batch(blind, 2, 1, Autoreset::NextStep)),
        ["scene", "channel time", "reward"]
    );
    for step in 0..6 {
        feeling.step(&grasp(2, step, 0.2)).unwrap();
    }
    let plan = feeling.plan(true);
    assert_eq!((plan[0].runs, plan[2].runs), (1.0, 0.0), "the model ran without contact");
    for step in 6..24 {
        feeling.step(&grasp(2, step, 0.2)).unwrap();
    }
    let plan = feeling.plan(false);
    assert!(plan[2].runs > 0.5 && plan[2].microseconds > 0.0, "{:?}", plan[2]);
}
