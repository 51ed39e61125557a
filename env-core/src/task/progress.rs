//! Progress of an episode.

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use super::{StepState, TaskConfig};
use crate::scene::SceneState;

/// Fraction of the lift height from which an object counts as lifted.
const LIFTED: f64 = 0.95;
/// Time from the start that does not count towards the mean grip force (s).
const SETTLING: f64 = 1.0;
/// Slip above which an object that starts in the hand counts as dropped (m): most of a pad's
/// extent.
pub(super) const OUT_OF_HAND: f64 = 0.02;
/// Lever arm by which a rotation of the object counts as slip (m).
const LEVER: f64 = 0.01;

/// Start pose of the object in the hand, and records of lifting and grip force.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// Pose of the object in the wrist's frame at the start (m).
    start: Isometry3<f64>,
    /// Number of control steps for which the object has been lifted without a break.
    held: u32,
    /// `true` once both pads have pressed on the object.
    gripped: bool,
    /// Number of control steps after the settling time, and the sum of the grip forces commanded in
    /// them (N).
    grips: (u32, f64),
}

impl Progress {
    /// Progress of an episode that starts in `state`.
    pub fn new(state: &SceneState) -> Self {
        Self { start: state.object_in_wrist(), held: 0, gripped: false, grips: (0, 0.0) }
    }

    /// Records one more step.
    pub fn advance(&mut self, step: &StepState, config: &TaskConfig) {
        let lifted = step.rise() >= LIFTED * config.lift_height && step.both_touch();
        self.held = if lifted { self.held + 1 } else { 0 };
        self.gripped |= step.both_touch();
        if step.time > SETTLING {
            self.grips = (self.grips.0 + 1, self.grips.1 + step.grip);
        }
    }

    /// Distance that the object has moved in the hand since the start (m); a rotation counts with a
    /// lever arm of 1 cm.
    pub fn slip(&self, step: &StepState) -> f64 {
        let now = step.state.object_in_wrist();
        let moved = now.translation.vector - self.start.translation.vector;
        moved.norm() + LEVER * now.rotation.angle_to(&self.start.rotation)
    }

    /// Returns whether no pad presses on the object any more, after both have.
    pub fn is_let_go(&self, step: &StepState) -> bool {
        self.gripped && !step.any_touches()
    }

    /// Returns whether an object that starts in the hand has left it: no pad presses on it, or it
    /// has slipped by most of a pad's extent.
    pub fn is_out_of_hand(&self, step: &StepState) -> bool {
        !step.any_touches() || self.slip(step) > OUT_OF_HAND
    }

    /// Fraction of the hold time for which the object has been lifted, at most 1.
    pub fn held(&self, config: &TaskConfig) -> f64 {
        let steps = config.hold_time / config.scene.physics.control_period;
        // 0.28 s over 0.04 s is a little more than 7 in floating point.
        let wanted = (steps - 1e-9).ceil().max(1.0);
        (f64::from(self.held) / wanted).min(1.0)
    }

    /// Mean grip force commanded after the settling time (N); `None` before.
    pub fn mean_grip(&self) -> Option<f64> {
        let (steps, sum) = self.grips;
        (steps > 0).then(|| sum / f64::from(steps))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hold_time_of_whole_control_periods_is_held_after_as_many_steps() {
        for (hold_time, steps) in [(0.28, 7), (0.56, 14), (1.12, 28), (0.5, 13)] {
            let config = TaskConfig { hold_time, ..TaskConfig::default() };
            let (start, grips) = (Isometry3::identity(), (0, 0.0));
            let after = |held| Progress { start, held, gripped: true, grips }.held(&config);
            assert!(after(steps - 1) < 1.0, "{hold_time} s in {} steps", steps - 1);
            assert_eq!(after(steps), 1.0, "{hold_time} s in {steps} steps");
        }
    }
}
