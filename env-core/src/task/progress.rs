//! What an episode has come to.

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use super::{Config, Moment, Task};
use crate::scene::SceneState;

/// Share of the wanted rise that counts as lifted.
const LIFTED: f64 = 0.95;
/// Time from the start that a grip is given to settle (s).
const SETTLING: f64 = 1.0;
/// Lever at which a turn of the object counts as slip (m).
const LEVER: f64 = 0.01;

/// Where the object was in the hand, and how long it has been up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// Pose of the object in the wrist's frame at the start (m).
    start: Isometry3<f64>,
    /// Control steps for which it has been lifted without a break.
    held: u32,
    /// Whether both pads have ever pressed on it.
    gripped: bool,
    /// Control steps since the grip has had time to settle, and the sum of the grips commanded in them (N).
    grips: (u32, f64),
}

impl Progress {
    /// Of an episode that starts in `state`.
    pub fn new(state: &SceneState) -> Self {
        Self { start: state.object_in_wrist(), held: 0, gripped: false, grips: (0, 0.0) }
    }

    /// Counts one more step, and whether the object is up.
    pub fn advance(&mut self, moment: &Moment, config: &Config) {
        let lifted = moment.rise() >= LIFTED * config.lift_height && moment.both_touch();
        self.held = if lifted { self.held + 1 } else { 0 };
        self.gripped |= moment.both_touch();
        if moment.time > SETTLING {
            self.grips = (self.grips.0 + 1, self.grips.1 + moment.grip);
        }
    }

    /// Whether both pads have ever pressed on the object.
    pub fn gripped(&self) -> bool {
        self.gripped
    }

    /// How far the object has moved in the hand since the start, its turn taken at 1 cm (m).
    pub fn slip(&self, moment: &Moment) -> f64 {
        let now = moment.state.object_in_wrist();
        let moved = now.translation.vector - self.start.translation.vector;
        moved.norm() + LEVER * now.rotation.angle_to(&self.start.rotation)
    }

    /// Share of the wanted time for which the object has been up, at most 1.
    pub fn held(&self, config: &Config) -> f64 {
        let wanted = (config.hold_time / config.scene.physics.control_period).ceil().max(1.0);
        (f64::from(self.held) / wanted).min(1.0)
    }

    /// Mean grip force commanded since it has had time to settle (N).
    pub fn mean_grip(&self) -> f64 {
        self.grips.1 / f64::from(self.grips.0.max(1))
    }

    /// Whether the task is done: the object held up long enough, or still where it was in the hand, by
    /// little force.
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
