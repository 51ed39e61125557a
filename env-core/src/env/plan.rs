//! Stages of a step in a configured environment, and their computing time.

use std::time::Instant;

use super::Setup;

/// Stage of a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// Name of the stage.
    pub name: String,
    /// Mean number of runs in a step of one environment.
    pub runs: f64,
    /// Mean time in a step of one environment (µs).
    pub microseconds: f64,
}

/// Index of the stage that steps the rigid bodies with Rapier.
pub(super) const SCENE: usize = 0;
/// Index of the stage that detects contact and creates presses.
pub(super) const PRESS: usize = 1;
/// Index of the stage that solves presses.
pub(super) const MODEL: usize = 2;
/// Index of the stage that corrects the contact forces of the rigid bodies with the solutions.
pub(super) const CORRECTION: usize = 3;
/// Index of the stage that computes the reward.
pub(super) const REWARD: usize = 4;
/// Index of the stage that finds the highest stress in the pads.
pub(super) const PEAK: usize = 5;
/// Index of the first channel of the observation; the other channels follow.
pub(super) const CHANNEL: usize = 6;

/// Time spent so far in each stage.
#[derive(Clone, Debug, Default)]
pub(super) struct StageTimes {
    /// Number of runs and time (ns) of each stage.
    stages: Vec<(u64, u64)>,
}

impl StageTimes {
    /// Runs `work`, records its time as one run of `stage`, and returns its result.
    pub(super) fn time<T>(&mut self, stage: usize, work: impl FnOnce() -> T) -> T {
        self.time_all(stage, 1, work)
    }

    /// Runs `work`, records its time as `runs` runs of `stage`, and returns its result.
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

    /// Adds the runs and times of `other`.
    pub(super) fn include(&mut self, other: &Self) {
        for (stage, &(runs, time)) in other.stages.iter().enumerate() {
            self.add(stage, runs, time);
        }
    }

    /// Stages that `setup` runs, in order, with their means over the recorded steps.
    pub(super) fn plan(&self, setup: &Setup) -> Vec<Stage> {
        let steps = self.of(SCENE).0.max(1) as f64;
        let stage = |stage: usize, name: String| {
            let (runs, time) = self.of(stage);
            Stage { name, runs: runs as f64 / steps, microseconds: 1e-3 * time as f64 / steps }
        };
        let mut plan = vec![stage(SCENE, "scene".into())];
        if let Some(name) = setup.tactile().name() {
            plan.push(stage(PRESS, "press".into()));
            plan.push(stage(MODEL, format!("model {name}")));
            plan.push(stage(CORRECTION, "correction".into()));
        }
        if setup.config().task.limits_pad_stress() {
            plan.push(stage(PEAK, "peak stress".into()));
        }
        let channels = setup.layout().channels().iter().enumerate();
        plan.extend(channels.map(|(i, (name, _))| stage(CHANNEL + i, format!("channel {name}"))));
        plan.push(stage(REWARD, "reward".into()));
        plan
    }
}
