//! Why an episode ends before its time.

use super::{Config, Moment, Progress, Task};

/// Why an episode ended before its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Ending {
    /// The object left the table or the workspace.
    ObjectLost,
    /// A pose or velocity became infinite or not a number.
    NonFinite,
    /// A quantity left the range that its observation declares.
    OutOfRange,
    /// The rigid-body engine stopped on an internal error.
    EngineError,
    /// No model's answer to what presses a finger.
    PressFailed,
    /// The stress in a pad, or in a soft object, exceeded the episode's limit.
    StressExceeded,
    /// The object slipped out of the hand.
    Dropped,
}

/// Half of the table's edge (m).
const TABLE: f64 = 0.25;
/// Slip after which an object is no longer held (m): most of a pad.
const OUT_OF_HAND: f64 = 0.02;

impl Ending {
    /// Every ending, in the order of [`Ending::code`].
    pub const ALL: [Self; 7] = [
        Self::ObjectLost,
        Self::NonFinite,
        Self::OutOfRange,
        Self::EngineError,
        Self::PressFailed,
        Self::StressExceeded,
        Self::Dropped,
    ];

    /// Name in `info["ending"]`.
    pub fn name(self) -> &'static str {
        match self {
            Self::ObjectLost => "object_lost",
            Self::NonFinite => "non_finite",
            Self::OutOfRange => "out_of_range",
            Self::EngineError => "engine_error",
            Self::PressFailed => "press_failed",
            Self::StressExceeded => "stress_exceeded",
            Self::Dropped => "dropped",
        }
    }

    /// Number from 1; 0 stands for none.
    pub fn code(self) -> u8 {
        self as u8 + 1
    }

    /// Whether the task itself ended the episode, and not what computes it: such a step is paid.
    pub fn is_of_the_task(self) -> bool {
        matches!(self, Self::ObjectLost | Self::StressExceeded | Self::Dropped)
    }

    /// Whether and why `moment` ends the episode.
    pub fn of(moment: &Moment, progress: &Progress, config: &Config) -> Option<Self> {
        let state = moment.state;
        if state.failure.is_some() {
            return Some(Self::NonFinite);
        }
        let p = state.object.pose.translation.vector;
        if p.z < -0.05 || p.z > 1.0 || p.xy().amax() > TABLE {
            return Some(Self::ObjectLost);
        }
        let exceeded = moment.draw.stress_limit.is_some_and(|limit| moment.peak_stress > limit);
        let dropped = match config.task {
            Task::HoldStill => !moment.any_touches() || progress.slip(moment) > OUT_OF_HAND,
            Task::GraspFragile | Task::GraspSoft => progress.gripped() && !moment.any_touches(),
            Task::GraspLift => false,
        };
        if exceeded {
            Some(Self::StressExceeded)
        } else if dropped {
            Some(Self::Dropped)
        } else {
            None
        }
    }
}
