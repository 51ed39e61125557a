//! Grip force that an action changes by a factor.
//!
//! In tasks that end at too high or too low a force, a grip force that is set directly goes wrong
//! before the agent has sensed the contact; a force that changes gradually is sensed in time.

use serde::Serialize;

use super::Setting;
use crate::{Result, task::setting::within};

/// Settings of a grip force that changes by factors.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GradualGrip {
    /// Grip force at the start (N).
    pub start: f64,
    /// Least grip force (N).
    pub least: f64,
    /// Relative rate at which the grip force grows or falls under the largest action (1/s).
    pub rate: f64,
}

impl GradualGrip {
    /// The settings in a table.
    pub(super) fn settings(&mut self) -> [Setting<'_>; 3] {
        let Self { start, least, rate } = self;
        [
            Setting::number("start_grip", start, [0.01, 200.0], "N", "grip force at the start"),
            Setting::number("least_grip", least, [0.01, 200.0], "N", "least grip force"),
            Setting::number(
                "grip_rate",
                rate,
                [0.01, 100.0],
                "1/s",
                "relative rate at which the largest action changes the grip force",
            ),
        ]
    }

    /// Returns an error unless least ≤ start ≤ `most` (N).
    pub(super) fn validate(&self, most: f64) -> Result<()> {
        within("least_grip", self.least, [0.01, most])?;
        within("start_grip", self.start, [self.least, most])
    }

    /// Grip force (N) after `action`, from −1 to 1, has changed the force `before` (N) for `time`
    /// (s), at most `most` (N).
    pub fn changed(&self, before: f64, action: f64, time: f64, most: f64) -> f64 {
        (before * (self.rate * action * time).exp()).clamp(self.least, most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn actions_multiply_the_grip_within_its_range() {
        let grip = GradualGrip { start: 2.0, least: 0.2, rate: 5.0 };
        let grown = grip.changed(1.0, 1.0, 0.04, 10.0);
        assert!((grown - 0.2f64.exp()).abs() < 1e-15, "{grown} N");
        let back = grip.changed(grown, -1.0, 0.04, 10.0);
        assert!((back - 1.0).abs() < 1e-15, "{back} N");
        assert_eq!(grip.changed(0.21, -1.0, 0.04, 10.0), 0.2);
        assert_eq!(grip.changed(9.9, 1.0, 0.04, 10.0), 10.0);
    }
}
