//! The stages that a configured environment runs in every step, and what each costs.

use std::time::Instant;

use super::Setup;

/// One stage of a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// What it does.
    pub name: String,
    /// How often it ran in a step of one environment, on average.
    pub runs: f64,
    /// Its time in a step of one environment (µs), on average.
    pub microseconds: f64,
}

/// Rapier's part of a step.
pub(super) const SCENE: usize = 0;
/// Finding contact and making presses.
pub(super) const PRESS: usize = 1;
/// Answering presses.
pub(super) const MODEL: usize = 2;
/// Handing the answers back to the rigid world.
pub(super) const CORRECTION: usize = 3;
/// Terms of the reward.
pub(super) const REWARD: usize = 4;
/// Finding the highest stress in the pads.
pub(super) const PEAK: usize = 5;
/// The first channel of the observation; the others follow.
pub(super) const CHANNEL: usize = 6;

/// Time spent so far, by stage.
#[derive(Clone, Debug, Default)]
pub(super) struct Costs {
    /// Runs and nanoseconds of each stage.
    stages: Vec<(u64, u64)>,
}

impl Costs {
    /// What `work` returns, its time counted as one run of `stage`.
    pub(super) fn time<T>(&mut self, stage: usize, work: impl FnOnce() -> T) -> T {
        self.time_all(stage, 1, work)
    }

    /// What `work` returns, its time counted as several `runs` of `stage`.
    pub(super) fn time_all<T>(&mut self, stage: usize, runs: u64, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.add(stage, runs, start.elapsed().as_nanos() as u64);
        result
    }

    fn add(&mut self, stage: usize, runs: u64, nanoseconds: u64) {
        if self.stages.len() <= stage {
            self.stages.resize(stage + 1, (0, 0));
        }
        let (all_runs, time) = &mut self.stages[stage];
        *all_runs += runs;
        *time += nanoseconds;
    }

    fn of(&self, stage: usize) -> (u64, u64) {
        self.stages.get(stage).copied().unwrap_or_default()
    }

    /// Adds what `other` counted.
    pub(super) fn include(&mut self, other: &Self) {
        for (stage, &(runs, time)) in other.stages.iter().enumerate() {
            self.add(stage, runs, time);
        }
    }

    /// The stages that `setup` runs, in order, with their means over the steps counted.
    pub(super) fn plan(&self, setup: &Setup) -> Vec<Stage> {
        let steps = self.of(SCENE).0.max(1) as f64;
        let stage = |stage: usize, name: String| {
            let (runs, time) = self.of(stage);
            Stage { name, runs: runs as f64 / steps, microseconds: 1e-3 * time as f64 / steps }
        };
        let mut plan = vec![stage(SCENE, "scene".into())];
        if let Some(touch) = setup.touch() {
            plan.push(stage(PRESS, "press".into()));
            plan.push(stage(MODEL, format!("model {}", touch.model().name())));
            plan.push(stage(CORRECTION, "correction".into()));
        }
        if setup.soft(0).is_some() {
            plan.push(stage(PRESS, "press".into()));
            plan.push(stage(MODEL, "model soft".into()));
            plan.push(stage(CORRECTION, "correction".into()));
        }
        if setup.config().fragility.is_some() {
            plan.push(stage(PEAK, "peak stress".into()));
        }
        let channels = setup.layout().channels().iter().enumerate();
        plan.extend(channels.map(|(i, (name, _))| stage(CHANNEL + i, format!("channel {name}"))));
        plan.push(stage(REWARD, "reward".into()));
        plan
    }
}
