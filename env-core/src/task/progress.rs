//! Progress of an episode.

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use super::{Config, Moment, Task};
use crate::scene::SceneState;

/// Fraction of the lift height from which an object counts as lifted.
const LIFTED: f64 = 0.95;
/// Time from the start that does not count towards the mean grip force (s).
const SETTLING: f64 = 1.0;
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
    pub fn advance(&mut self, moment: &Moment, config: &Config) {
        let lifted = moment.rise() >= LIFTED * config.lift_height && moment.both_touch();
        self.held = if lifted { self.held + 1 } else { 0 };
        self.gripped |= moment.both_touch();
        if moment.time > SETTLING {
            self.grips = (self.grips.0 + 1, self.grips.1 + moment.grip);
        }
    }

    /// Returns whether both pads have ever pressed on the object.
    pub fn gripped(&self) -> bool {
        self.gripped
    }

    /// Distance that the object has moved in the hand since the start (m); a rotation counts with a
    /// lever arm of 1 cm.
    pub fn slip(&self, moment: &Moment) -> f64 {
        let now = moment.state.object_in_wrist();
        let moved = now.translation.vector - self.start.translation.vector;
        moved.norm() + LEVER * now.rotation.angle_to(&self.start.rotation)
    }

    /// Fraction of the hold time for which the object has been lifted, at most 1.
    pub fn held(&self, config: &Config) -> f64 {
        let wanted = (config.hold_time / config.scene.physics.control_period).ceil().max(1.0);
        (f64::from(self.held) / wanted).min(1.0)
    }

    /// Mean grip force commanded after the settling time (N).
    pub fn mean_grip(&self) -> f64 {
        self.grips.1 / f64::from(self.grips.0.max(1))
    }

    /// Returns whether the task is done: the object lifted for the hold time, or, in HoldStill,
    /// still in its place in the hand and held with little force.
    pub fn is_success(&self, moment: &Moment, config: &Config) -> bool {
        match (config.task, &config.holding) {
            (Task::HoldStill, Some(holding)) => {
                moment.both_touch()
                    && self.grips.0 > 0
                    && self.slip(moment) <= holding.slip_limit
                    && self.mean_grip() <= moment.thrifty_grip(config)
            }
            _ => self.held(config) >= 1.0,
        }
    }
}
