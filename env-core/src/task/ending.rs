//! Reasons for which an episode terminates.

use super::{Progress, StepState, TaskConfig};

/// Reason for which an episode terminated.
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
    /// The press of a finger or of a soft object could not be solved.
    PressFailed,
    /// The stress in a pad, or in a soft object, exceeded the episode's limit.
    StressExceeded,
    /// The object slipped out of the hand.
    Dropped,
    /// A peg was pressed too hard against a fixture, beside its hole.
    Overloaded,
    /// A peg was pressed too hard in its hole, where other forces would let it slide on.
    Jammed,
    /// A peg was pressed too hard in its hole, so near the mouth that two contacts can hold it by
    /// friction alone.
    Wedged,
}

/// Half of the table's edge (m).
const TABLE: f64 = 0.25;

impl Ending {
    /// Every ending, in the order of [`Ending::code`].
    pub const ALL: [Self; 10] = [
        Self::ObjectLost,
        Self::NonFinite,
        Self::OutOfRange,
        Self::EngineError,
        Self::PressFailed,
        Self::StressExceeded,
        Self::Dropped,
        Self::Overloaded,
        Self::Jammed,
        Self::Wedged,
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
            Self::Overloaded => "overloaded",
            Self::Jammed => "jammed",
            Self::Wedged => "wedged",
        }
    }

    /// Number from 1; 0 stands for no ending.
    pub fn code(self) -> u8 {
        self as u8 + 1
    }

    /// Returns whether a rule of the task ended the episode, and not a failed computation; only
    /// then does the last step earn a reward.
    pub fn is_of_the_task(self) -> bool {
        match self {
            Self::NonFinite | Self::OutOfRange | Self::EngineError | Self::PressFailed => false,
            Self::ObjectLost
            | Self::StressExceeded
            | Self::Dropped
            | Self::Overloaded
            | Self::Jammed
            | Self::Wedged => true,
        }
    }

    /// Returns the reason for which `step` ends the episode, if it does.
    pub fn of(step: &StepState, progress: &Progress, config: &TaskConfig) -> Option<Self> {
        if step.state.failure.is_some() {
            return Some(Self::NonFinite);
        }
        let p = step.state.object.pose.translation.vector;
        if p.z < -0.05 || p.z > 1.0 || p.xy().amax() > TABLE {
            return Some(Self::ObjectLost);
        }
        if step.episode.stress_limit.is_some_and(|limit| step.peak_stress > limit) {
            return Some(Self::StressExceeded);
        }
        config.task.ending(step, progress)
    }
}
