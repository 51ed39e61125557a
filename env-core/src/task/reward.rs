//! Reward: a weighted mean of named terms, each in [0, 1].

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Config, Moment, Progress, Task};
use crate::{Error, Result};

/// Term of the reward. Each variant states where the term is 1 and where it is 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Term {
    /// 1 with the tool centre at the object's middle, 1/4 at 10 cm from it.
    Reach,
    /// 1 when both pads press with 1 N or more, or with the trial grip if one sets the stress
    /// limit.
    Grasp,
    /// 1 when both pads touch the object, however lightly.
    Touch,
    /// Rise of the grasped object relative to the lift height.
    Lift,
    /// Time for which the object has stayed lifted, relative to the hold time.
    Hold,
    /// 1 without grip force, 0 at the largest; multiplied by `lift`, so that keeping the hand open
    /// earns nothing.
    Effort,
    /// 1 without stress in the object, 0 at the episode's limit; multiplied by `lift`, so that
    /// leaving the object alone earns nothing.
    Gentle,
    /// 1 without grip force, 0 at twice [`Moment::thrifty_grip`], linear between.
    Thrift,
    /// 1 with the object where it was in the hand at the start, 0 at the slip limit.
    Still,
}

/// Normal force of a firmly pressing pad (N).
const FIRM: f64 = 1.0;
/// Length scale of `reach` (m); tanh of 10 cm over it is 3/4.
const NEAR: f64 = 0.103;

impl Term {
    /// All terms.
    pub const ALL: [Self; 9] = [
        Self::Reach,
        Self::Grasp,
        Self::Touch,
        Self::Lift,
        Self::Hold,
        Self::Effort,
        Self::Gentle,
        Self::Thrift,
        Self::Still,
    ];

    /// Name in settings and `info`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Reach => "reach",
            Self::Grasp => "grasp",
            Self::Touch => "touch",
            Self::Lift => "lift",
            Self::Hold => "hold",
            Self::Effort => "effort",
            Self::Gentle => "gentle",
            Self::Thrift => "thrift",
            Self::Still => "still",
        }
    }

    /// Value at `moment`.
    fn value(self, moment: &Moment, progress: &Progress, config: &Config) -> f64 {
        match self {
            Self::Reach => {
                1.0 - (moment.state.object_in_wrist().translation.vector.norm() / NEAR).tanh()
            }
            Self::Grasp => {
                let [a, b] = [0, 1].map(|k| moment.state.fingers[k].normal_force());
                let firm = moment.draw.trial.map_or(FIRM, |trial| trial.grip);
                (a.min(b) / firm).clamp(0.0, 1.0)
            }
            Self::Touch => f64::from(u8::from(moment.both_touch())),
            Self::Lift if moment.both_touch() => {
                (moment.rise() / config.lift_height).clamp(0.0, 1.0)
            }
            Self::Lift => 0.0,
            Self::Hold => progress.held(config),
            Self::Effort => {
                let spared = within(moment.grip.abs(), config.scene.gripper.max_force);
                spared * Self::Lift.value(moment, progress, config)
            }
            Self::Gentle => {
                let limit = moment.draw.stress_limit;
                let gentle = limit.map_or(1.0, |limit| within(moment.peak_stress, limit));
                gentle * Self::Lift.value(moment, progress, config)
            }
            Self::Thrift => within(moment.grip, 2.0 * moment.thrifty_grip(config)),
            Self::Still => {
                let limit = config.holding.as_ref().map(|holding| holding.slip_limit);
                limit.map_or(1.0, |limit| within(progress.slip(moment), limit))
            }
        }
    }
}

/// 1 at zero, 0 at `limit` and past it.
fn within(value: f64, limit: f64) -> f64 {
    (1.0 - value / limit).clamp(0.0, 1.0)
}

/// Values of the terms in one step, each in [0, 1]; those that the task does not use are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RewardTerms([f64; Term::ALL.len()]);

impl RewardTerms {
    /// Evaluates the terms at `moment`.
    pub fn of(moment: &Moment, progress: &Progress, config: &Config) -> Self {
        let mut terms = Self::default();
        for &(term, _) in config.task.terms() {
            terms.0[term as usize] = term.value(moment, progress, config);
        }
        terms
    }

    /// Value of one term.
    pub fn get(&self, term: Term) -> f64 {
        self.0[term as usize]
    }

    /// Values of the terms of `task`, in its order.
    pub fn values(&self, task: Task) -> impl Iterator<Item = f64> + '_ {
        task.terms().iter().map(|&(term, _)| self.get(term))
    }

    /// Weighted mean of the terms.
    pub fn reward(&self, weights: &Weights) -> f64 {
        let weights = &weights.0;
        let sum: f64 = weights.iter().map(|(&term, weight)| self.get(term) * weight).sum();
        sum / weights.values().sum::<f64>()
    }
}

/// Relative weights of the terms; a term without one has weight 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Weights(BTreeMap<Term, f64>);

impl Weights {
    /// Default weights of `task`.
    pub fn of(task: Task) -> Self {
        Self(task.terms().iter().copied().collect())
    }

    /// Returns an error unless the weights are finite and not negative, one is above zero, and all
    /// belong to terms of `task`.
    pub(super) fn validate(&self, task: Task) -> Result<()> {
        let terms = || task.terms().iter().map(|&(term, _)| term);
        if let Some(other) = self.0.keys().find(|&&term| terms().all(|own| own != term)) {
            let own = terms().map(Term::name).collect::<Vec<_>>().join(", ");
            let expected = format!("terms of {}: {own}", task.name());
            return Err(Error::invalid("reward", other.name(), expected));
        }
        let sound = self.0.values().all(|w| (0.0..=1e6).contains(w));
        if sound && self.0.values().sum::<f64>() > 0.0 {
            return Ok(());
        }
        let found = format!("{:?}", self.0.values().collect::<Vec<_>>());
        Err(Error::invalid("reward", found, "weights of 0 to 1e6, not all 0"))
    }
}
