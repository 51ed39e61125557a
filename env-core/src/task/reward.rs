//! The reward: a weighted mean of named terms, each in [0, 1].

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Config, Moment, Progress, Task};
use crate::{Error, Result};

/// A term of the reward. What 1 and 0 stand for is said at each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Term {
    /// 1 at the object's middle, 1/4 at 10 cm from it.
    Reach,
    /// 1 when both pads press with 1 N or more, or with the grip of the trial that set the limit.
    Grasp,
    /// 1 when both pads touch the object, however lightly.
    Touch,
    /// Rise of the grasped object over the wanted rise.
    Lift,
    /// Time for which it has stayed lifted over the wanted time.
    Hold,
    /// 1 without grip force on the lifted object, 0 at the largest; on the way up as much of it as of
    /// `lift`, so that it does not pay to keep the hand open.
    Effort,
    /// 1 without stress in the lifted object, 0 at the episode's limit; on the way up as much of it as
    /// of `lift`, so that it does not pay to leave the object alone.
    Gentle,
    /// 1 without grip force, 0 at twice what counts as little for this object, linear between.
    Thrift,
    /// 1 where the object was in the hand at the start, 0 at the largest slip that counts as still.
    Still,
}

/// Normal force of a firm pad (N).
const FIRM: f64 = 1.0;
/// Distance over which reaching matters (m); tanh of 10 cm over it is 3/4.
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

    /// Its name in settings and `info`.
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

    /// Its value at `moment`.
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

/// The terms of one step, each in [0, 1]; those that the task does not pay for are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RewardTerms([f64; Term::ALL.len()]);

impl RewardTerms {
    /// The terms at `moment`.
    pub fn of(moment: &Moment, progress: &Progress, config: &Config) -> Self {
        let mut terms = Self::default();
        for &(term, _) in config.task.terms() {
            terms.0[term as usize] = term.value(moment, progress, config);
        }
        terms
    }

    /// The value of one term.
    pub fn get(&self, term: Term) -> f64 {
        self.0[term as usize]
    }

    /// The terms of `task`, in its order.
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

/// Relative weights of the terms; a term without one weighs nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Weights(BTreeMap<Term, f64>);

impl Weights {
    /// The usual weights of `task`.
    pub fn of(task: Task) -> Self {
        Self(task.terms().iter().copied().collect())
    }

    /// Weights are finite and not negative, one is above zero, and all are of terms of `task`.
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
