//! Grip force that an action changes by a factor.
//!
//! In tasks that end at too high or too low a force, a grip force that is set directly goes wrong
//! before the agent has sensed the contact; a force that changes gradually is sensed on the way.

use serde::{Deserialize, Serialize};

/// Settings of a grip force that changes by factors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Closing {
    /// Grip force at the start (N).
    pub start_grip: f64,
    /// Least grip force (N).
    pub least_grip: f64,
    /// Relative rate at which the grip force grows or falls under the largest action (1/s).
    pub grip_rate: f64,
}

impl Default for Closing {
    fn default() -> Self {
        Self { start_grip: 0.2, least_grip: 0.2, grip_rate: 10.0 }
    }
}

impl Closing {
    /// Grip force (N) after `action`, from −1 to 1, has changed the force `before` (N) for `time`
    /// (s), at most `most` (N).
    pub fn changed(&self, before: f64, action: f64, time: f64, most: f64) -> f64 {
        (before * (self.grip_rate * action * time).exp()).clamp(self.least_grip, most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn actions_multiply_the_grip_within_its_range() {
        let closing = Closing { start_grip: 2.0, least_grip: 0.2, grip_rate: 5.0 };
        let grown = closing.changed(1.0, 1.0, 0.04, 10.0);
        assert!((grown - 0.2f64.exp()).abs() < 1e-15, "{grown} N");
        let back = closing.changed(grown, -1.0, 0.04, 10.0);
        assert!((back - 1.0).abs() < 1e-15, "{back} N");
        assert_eq!(closing.changed(0.21, -1.0, 0.04, 10.0), 0.2);
        assert_eq!(closing.changed(9.9, 1.0, 0.04, 10.0), 10.0);
    }
}
