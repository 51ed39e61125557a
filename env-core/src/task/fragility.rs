//! Fragile grasps: how the grip changes, and what force the limit allows.

use serde::{Deserialize, Serialize};

use super::{Config, Range};
use crate::{Error, Result};

/// Settings of a grasp that must not be too hard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Fragility {
    /// Grip force at the start, which is the least (N).
    pub start_grip: f64,
    /// Relative rate at which the grip force grows or falls under the largest action (1/s).
    pub grip_rate: f64,
    /// Grip force of the trial over the least that holds the object.
    pub spare: f64,
    /// The limit over the stress of the trial.
    pub margin: Range,
}

/// The grip whose stress sets an episode's limit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Grip force (N).
    pub grip: f64,
    /// The limit over the stress of this grip.
    pub margin: f64,
}

impl Default for Fragility {
    fn default() -> Self {
        Self { start_grip: 0.4, grip_rate: 10.0, spare: 2.0, margin: [1.1, 1.25] }
    }
}

impl Fragility {
    /// Grip force (N) after `action`, from −1 to 1, has changed that of `before` for `time` (s).
    pub fn changed(&self, before: f64, action: f64, time: f64, most: f64) -> f64 {
        (before * (self.grip_rate * action * time).exp()).clamp(self.start_grip, most)
    }
}

/// Least grip force with which two pads hold an object of `mass` (kg) and `friction` by Coulomb's law (N).
pub fn least_grip(mass: f64, friction: f64, gravity: f64) -> f64 {
    0.5 * mass * gravity / friction
}

impl Config {
    /// An error if some object would have to be tried with more force than the gripper has.
    pub(super) fn validate_trials(&self, fragility: &Fragility) -> Result<()> {
        let gravity = self.scene.physics.gravity;
        let hardest = fragility.spare * least_grip(self.mass[1], self.friction[0], gravity);
        let most = self.scene.gripper.max_force;
        if hardest <= most {
            return Ok(());
        }
        let found = format!("{}, a grip of {hardest:.1} N on the heaviest object", fragility.spare);
        let expected = format!("{most} N at most: less spare or mass, more friction or max_force");
        Err(Error::invalid("spare", found, expected))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn actions_multiply_the_grip_within_its_range() {
        let fragility = Fragility { start_grip: 0.2, grip_rate: 5.0, ..Fragility::default() };
        let grown = fragility.changed(1.0, 1.0, 0.04, 10.0);
        assert!((grown - 0.2f64.exp()).abs() < 1e-15, "{grown} N");
        let back = fragility.changed(grown, -1.0, 0.04, 10.0);
        assert!((back - 1.0).abs() < 1e-15, "{back} N");
        assert_eq!(fragility.changed(0.21, -1.0, 0.04, 10.0), 0.2);
        assert_eq!(fragility.changed(9.9, 1.0, 0.04, 10.0), 10.0);
    }
}
