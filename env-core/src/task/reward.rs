//! Reward: a weighted mean of named terms, each in [0, 1].

use super::{Progress, RewardWeights, StepState, Task, TaskConfig, reward_weights::MOST};

/// Computes a term, in [0, 1].
type Evaluate = fn(&StepState, &Progress, &TaskConfig) -> f64;

/// Term of a task's reward.
#[derive(Clone, Copy, Debug)]
pub struct RewardTerm {
    /// Name in settings and `info`.
    pub name: &'static str,
    /// Default weight.
    pub weight: f64,
    /// State in which the term is 1, and where it is 0.
    pub doc: &'static str,
    value: Evaluate,
}

impl RewardTerm {
    /// A term of this `name` and default `weight`.
    pub const fn new(name: &'static str, weight: f64, value: Evaluate, doc: &'static str) -> Self {
        Self { name, weight, doc, value }
    }
}

/// Normal force of a firmly pressing pad (N).
const FIRM: f64 = 1.0;
/// Length scale of `reach` (m); tanh of 10 cm over it is 3/4.
const NEAR: f64 = 0.103;

/// 1 with the tool centre at the object's middle, 1/4 at 10 cm from it.
pub(super) fn reach(step: &StepState, _: &Progress, _: &TaskConfig) -> f64 {
    1.0 - (step.state.object_in_wrist().translation.vector.norm() / NEAR).tanh()
}

/// 1 when both pads press with 1 N or more, or with the trial grip if one sets the stress limit.
pub(super) fn grasp(step: &StepState, _: &Progress, _: &TaskConfig) -> f64 {
    let [a, b] = [0, 1].map(|k| step.state.fingers[k].object_force);
    let firm = step.episode.trial.map_or(FIRM, |trial| trial.grip);
    (a.min(b) / firm).clamp(0.0, 1.0)
}

/// 1 when both pads touch the object, however lightly.
pub(super) fn touch(step: &StepState, _: &Progress, _: &TaskConfig) -> f64 {
    f64::from(u8::from(step.both_touch()))
}

/// Rise of the grasped object relative to the lift height.
pub(super) fn lift(step: &StepState, _: &Progress, config: &TaskConfig) -> f64 {
    if step.both_touch() { (step.rise() / config.lift_height).clamp(0.0, 1.0) } else { 0.0 }
}

/// Time for which the object has stayed lifted, relative to the hold time.
pub(super) fn hold(_: &StepState, progress: &Progress, config: &TaskConfig) -> f64 {
    progress.held(config)
}

/// 1 without grip force, 0 at the largest; multiplied by `lift`, so that keeping the hand open
/// earns nothing.
pub(super) fn effort(step: &StepState, progress: &Progress, config: &TaskConfig) -> f64 {
    falling(step.grip.abs(), config.scene.gripper.max_force) * lift(step, progress, config)
}

/// 1 without stress, 0 at the episode's limit; multiplied by `lift`, so that leaving the object
/// alone earns nothing.
pub(super) fn gentle(step: &StepState, progress: &Progress, config: &TaskConfig) -> f64 {
    let limit = step.episode.stress_limit;
    let gentle = limit.map_or(1.0, |limit| falling(step.peak_stress, limit));
    gentle * lift(step, progress, config)
}

/// 1 at zero, 0 at `limit` and past it, linear between.
pub(super) fn falling(value: f64, limit: f64) -> f64 {
    (1.0 - value / limit).clamp(0.0, 1.0)
}

/// Values of a task's terms in one step, in its order, each in [0, 1].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RewardTerms([f64; MOST]);

impl RewardTerms {
    /// Evaluates the terms at `step`.
    pub fn of(step: &StepState, progress: &Progress, config: &TaskConfig) -> Self {
        let mut values = Self::default();
        for (value, term) in values.0.iter_mut().zip(config.task.terms()) {
            *value = (term.value)(step, progress, config);
        }
        values
    }

    /// Value of the term of `task` called `name`.
    ///
    /// # Panics
    /// If `task` has no such term.
    pub fn get(&self, task: &Task, name: &str) -> f64 {
        let place = task.terms().iter().position(|term| term.name == name);
        self.0[place.expect("a term of the task")]
    }

    /// Values of the terms of `task`, in its order.
    pub fn values(&self, task: &Task) -> &[f64] {
        &self.0[..task.terms().len()]
    }

    /// Weighted mean of the terms.
    pub fn reward(&self, weights: &RewardWeights) -> f64 {
        let sum: f64 = self.0.iter().zip(&weights.0).map(|(value, weight)| value * weight).sum();
        sum / weights.0.iter().sum::<f64>()
    }
}
