//! Batches: the same numbers for any batch and any number of threads; endings stay in their row.

use std::sync::Arc;

use ruffini_core::{
    Error,
    env::{Autoreset, Batch, Setup},
    tactile::Choice,
    task::{Ending, Range, StartQuantity, StateChannel, Task, TaskConfig},
};

fn batch(config: TaskConfig, rows: usize, threads: usize, autoreset: Autoreset) -> Batch {
    let setup = Arc::new(Setup::new(config).unwrap());
    let mut batch = Batch::new(setup, rows, threads, autoreset).unwrap();
    batch.seed(&(0..rows as u64).map(Some).collect::<Vec<_>>()).unwrap();
    batch.reset(None).unwrap();
    batch
}

/// Actions (N, 5) that move, close and lift, different in every row.
fn actions(rows: usize, step: usize) -> Vec<f32> {
    let number =
        |i: usize| (0.7 * (i % 5) as f32 + 0.37 * (i / 5) as f32 + 0.11 * step as f32).sin();
    (0..5 * rows).map(number).collect()
}

fn all_channels() -> TaskConfig {
    TaskConfig {
        observation: Some(StateChannel::SHARED.map(|channel| channel.name().into()).into()),
        ..TaskConfig::default()
    }
}

#[test]
fn a_row_does_not_depend_on_its_batch_or_the_threads() {
    let short = TaskConfig { max_episode_steps: 20, ..all_channels() };
    for autoreset in [Autoreset::NextStep, Autoreset::SameStep] {
        let mut wide = batch(short.clone(), 6, 1, autoreset);
        let mut threaded = batch(short.clone(), 6, 4, autoreset);
        let mut narrow = batch(short.clone(), 2, 1, autoreset);
        let size = wide.setup().layout().size();
        for step in 0..50 {
            let a = actions(6, step);
            let one = wide.step(&a).unwrap();
            let four = threaded.step(&a).unwrap();
            let two = narrow.step(&a[..10]).unwrap();
            assert_eq!(one.observation, four.observation, "step {step}");
            assert_eq!(one.outcomes, four.outcomes, "step {step}");
            assert_eq!(one.observation[..2 * size], two.observation[..], "step {step}");
            assert_eq!(one.outcomes[..2], two.outcomes[..], "step {step}");
        }
    }
}

#[test]
fn a_snapshot_replays_bit_for_bit() {
    let mut first = batch(all_channels(), 4, 1, Autoreset::NextStep);
    for step in 0..40 {
        first.step(&actions(4, step)).unwrap();
    }
    let saved = first.save();
    let mut second = batch(all_channels(), 4, 1, Autoreset::NextStep);
    second.load(&saved).unwrap();
    for step in 40..140 {
        let [a, b] = [&mut first, &mut second].map(|b| b.step(&actions(4, step)).unwrap());
        assert_eq!(a.observation, b.observation, "step {step}");
        assert_eq!(a.outcomes, b.outcomes, "step {step}");
    }
}

#[test]
fn damaged_and_foreign_snapshots_are_refused() {
    let mut one = batch(TaskConfig::default(), 1, 1, Autoreset::NextStep);
    let saved = one.save();
    for byte in [0, 9, 17, 30, saved[0].len() - 1] {
        let mut damaged = saved.clone();
        damaged[0][byte] ^= 1;
        assert!(matches!(one.load(&damaged), Err(Error::BadState { .. })), "byte {byte}");
    }
    let mut other = batch(all_channels(), 1, 1, Autoreset::NextStep);
    assert!(matches!(other.load(&saved), Err(Error::BadState { .. })));
    assert!(one.load(&[&saved[0][..10]]).is_err());
    assert!(one.load(&saved).is_ok());
}

#[test]
fn reset_forgets_what_was_before() {
    let config = all_channels();
    let mut used = batch(config.clone(), 2, 1, Autoreset::NextStep);
    for step in 0..150 {
        used.step(&actions(2, step)).unwrap();
    }
    used.seed(&[Some(0), Some(1)]).unwrap();
    let again = used.reset(None).unwrap();
    let mut fresh = batch(config, 2, 1, Autoreset::NextStep);
    fresh.seed(&[Some(0), Some(1)]).unwrap();
    assert_eq!(again, fresh.reset(None).unwrap());
    let [a, b] = [&mut used, &mut fresh].map(|b| b.step(&actions(2, 0)).unwrap());
    assert_eq!(a.observation, b.observation);
}

/// Random extreme actions for many episodes of extreme objects: every number stays within its
/// declared bounds, and an early end has a reason.
#[test]
fn observations_stay_within_their_bounds() {
    let extremes: [(Range, Range, Range); 3] = [
        ([0.002, 0.002], [0.0, 0.0], [0.3, 0.3]),
        ([1000.0, 1000.0], [2.0, 2.0], [1.0, 1.0]),
        ([0.002, 10.0], [0.0, 4.0], [0.2, 1.5]),
    ];
    for (mass, friction, size) in extremes {
        let config = TaskConfig { mass, friction, size, ..all_channels() };
        let mut batch = batch(config, 16, 1, Autoreset::NextStep);
        let layout = batch.setup().layout().clone();
        for step in 0..300 {
            let wild: Vec<_> = actions(16, 7 * step).iter().map(|a| a.signum()).collect();
            let result = batch.step(&wild).unwrap();
            for row in result.observation.chunks(layout.size()) {
                assert!(layout.holds(row), "{mass:?} kg, step {step}: {row:?}");
            }
            for outcome in result.outcomes {
                assert_eq!(outcome.terminated, outcome.ending.is_some());
                assert_ne!(outcome.ending, Some(Ending::EngineError));
            }
        }
    }
}

#[test]
fn a_row_that_cannot_start_leaves_the_others_a_whole_step() {
    let config = TaskConfig {
        tactile: Choice::None,
        mass: [0.05, 0.5],
        friction: [0.01, 1.0],
        ..TaskConfig::of(&Task::named("HoldStill").unwrap())
    };
    // So heavy and smooth that the hand holds nothing; not a number is drawn.
    let give = |batch: &mut Batch, quantities: [f64; 2]| {
        for (quantity, value) in
            [StartQuantity::Mass, StartQuantity::Friction].into_iter().zip(quantities)
        {
            batch.give(quantity, &[f64::NAN, value]).unwrap();
        }
    };
    let (heavy, drawn) = ([0.5, 0.01], [0.05, 1.0]);
    for autoreset in [Autoreset::NextStep, Autoreset::SameStep] {
        let setup = Arc::new(Setup::new(config.clone()).unwrap());
        let [mut pair, mut alone] =
            [2, 1].map(|rows| Batch::new(setup.clone(), rows, 1, autoreset).unwrap());
        pair.seed(&[Some(3), Some(4)]).unwrap();
        alone.seed(&[Some(3)]).unwrap();
        alone.reset(None).unwrap();
        give(&mut pair, heavy);
        let error = pair.reset(None).unwrap_err().to_string();
        assert!(error.contains("does not hold in any of 20 draws"), "{error}");
        give(&mut pair, drawn);
        pair.reset(Some(&[false, true])).unwrap();
        give(&mut pair, heavy);
        let mut failed = false;
        for step in 0..400 {
            let action = &actions(2, step);
            let result = pair.step(action);
            alone.step(&action[..5]).unwrap();
            failed = result.is_err();
            if failed {
                break;
            }
            if autoreset == Autoreset::NextStep && step == 10 {
                pair.end(&[false, true]).unwrap();
            }
        }
        assert!(failed, "the second row never ended");
        assert_eq!([pair.rows()[0].is_new(), pair.rows()[1].is_new()], [false, true]);
        assert_eq!(pair.save()[0], alone.save()[0]);
    }
}
