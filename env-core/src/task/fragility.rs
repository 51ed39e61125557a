//! Fragile grasps: the trial grip that sets the stress limit.

use serde::{Deserialize, Serialize};

use super::{Config, Range};
use crate::{Error, Result};

/// Settings of a grasp with a stress limit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Fragility {
    /// Grip force of the trial, relative to the least that holds the object.
    pub spare: f64,
    /// Stress limit relative to the peak stress of the trial.
    pub margin: Range,
}

/// Trial grip whose stress sets the limit of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Grip force (N).
    pub grip: f64,
    /// Stress limit relative to the peak stress of this grip.
    pub margin: f64,
}

impl Default for Fragility {
    fn default() -> Self {
        Self { spare: 2.0, margin: [1.1, 1.25] }
    }
}

/// Least grip force with which two pads hold against a tangential `force` (N) by Coulomb's law, in
/// N.
pub fn least_grip(force: f64, friction: f64) -> f64 {
    0.5 * force / friction
}

impl Config {
    /// Returns an error if the trial grip of some object would exceed the force of the gripper.
    pub(super) fn validate_trials(&self, fragility: &Fragility) -> Result<()> {
        let heaviest = self.mass[1] * self.scene.physics.gravity;
        let hardest = fragility.spare * least_grip(heaviest, self.friction[0]);
        let most = self.scene.gripper.max_force;
        if hardest <= most {
            return Ok(());
        }
        let found = format!("{}, a grip of {hardest:.1} N on the heaviest object", fragility.spare);
        let expected = format!("{most} N at most: less spare or mass, more friction or max_force");
        Err(Error::invalid("spare", found, expected))
    }
}
