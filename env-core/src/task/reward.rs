//! The reward: a weighted mean of named terms, each in [0, 1].

use serde::{Deserialize, Serialize};

use super::{Config, Moment};
use crate::{Error, Result};

/// Names of the terms, in the order of [`RewardTerms`].
pub const TERMS: [&str; 5] = ["reach", "grasp", "lift", "hold", "effort"];

/// The terms of one step, each in [0, 1].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RewardTerms {
    /// 1 at the object's middle, 1/4 at 10 cm from it.
    pub reach: f64,
    /// 1 when both pads press with 1 N or more.
    pub grasp: f64,
    /// Rise of the grasped object over the wanted rise.
    pub lift: f64,
    /// Time for which it has stayed lifted over the wanted time.
    pub hold: f64,
    /// 1 without grip force, 0 at the largest.
    pub effort: f64,
}

/// Relative weights of the terms.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[allow(missing_docs)] // Named like the terms.
pub struct Weights {
    pub reach: f64,
    pub grasp: f64,
    pub lift: f64,
    pub hold: f64,
    pub effort: f64,
}

impl Default for Weights {
    fn default() -> Self {
        Self { reach: 0.2, grasp: 0.2, lift: 0.3, hold: 0.25, effort: 0.05 }
    }
}

/// How long the object has been up without a break (control steps).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    held: u32,
}

/// Normal force of a firm pad (N).
const FIRM: f64 = 1.0;
/// Share of the wanted rise that counts as lifted.
const LIFTED: f64 = 0.95;

impl Progress {
    /// Counts one more step, and whether the object is up.
    pub fn advance(&mut self, moment: &Moment, config: &Config) {
        let lifted = moment.rise() >= LIFTED * config.lift_height && both_touch(moment);
        self.held = if lifted { self.held + 1 } else { 0 };
    }

    /// Whether the object has been held up long enough.
    pub fn is_success(&self, config: &Config) -> bool {
        self.held >= wanted_steps(config)
    }
}

fn wanted_steps(config: &Config) -> u32 {
    (config.hold_time / config.scene.physics.control_period).ceil().max(1.0) as u32
}

fn both_touch(moment: &Moment) -> bool {
    moment.state.fingers.iter().all(|finger| finger.normal_force() > 0.0)
}

impl RewardTerms {
    /// The terms at `moment`.
    pub fn of(moment: &Moment, progress: &Progress, config: &Config) -> Self {
        /// Distance over which reaching matters (m); tanh of 10 cm over it is 3/4.
        const NEAR: f64 = 0.103;
        let [a, b] = [0, 1].map(|k| moment.state.fingers[k].normal_force());
        let distance = moment.state.object_in_wrist().translation.vector.norm();
        let rise = (moment.rise() / config.lift_height).clamp(0.0, 1.0);
        Self {
            reach: 1.0 - (distance / NEAR).tanh(),
            grasp: (a.min(b) / FIRM).clamp(0.0, 1.0),
            lift: if both_touch(moment) { rise } else { 0.0 },
            hold: (f64::from(progress.held) / f64::from(wanted_steps(config))).min(1.0),
            effort: 1.0 - (moment.grip.abs() / config.scene.gripper.max_force).min(1.0),
        }
    }

    /// The terms in the order of [`TERMS`].
    pub fn values(&self) -> [f64; TERMS.len()] {
        [self.reach, self.grasp, self.lift, self.hold, self.effort]
    }

    /// Weighted mean of the terms.
    pub fn reward(&self, weights: &Weights) -> f64 {
        let weights = weights.values();
        let sum: f64 = self.values().iter().zip(weights).map(|(term, w)| term * w).sum();
        sum / weights.iter().sum::<f64>()
    }
}

impl Weights {
    fn values(self) -> [f64; TERMS.len()] {
        [self.reach, self.grasp, self.lift, self.hold, self.effort]
    }

    /// Weights are finite and not negative, and one is above zero.
    pub(super) fn validate(self) -> Result<()> {
        let values = self.values();
        let sound = values.iter().all(|w| (0.0..=1e6).contains(w));
        if sound && values.iter().sum::<f64>() > 0.0 {
            return Ok(());
        }
        let found = format!("{values:?}");
        Err(Error::invalid("reward", found, "weights of 0 to 1e6, not all 0"))
    }
}
