//! What the agent sees, does and is paid for: pure functions of the rigid world's state.

mod action;
mod config;
mod objects;
mod observation;
mod reward;

pub use action::{ACTION_SIZE, command};
pub use config::{Config, Range};
pub use objects::ObjectSpec;
pub use observation::{CHANNELS, Component, Layout, TACTILE_CHANNELS};
pub use reward::{Progress, RewardTerms, TERMS, Weights};

use crate::{scene::SceneState, tactile::Feeling};

/// What an episode drew at its reset.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Draw {
    /// Index into the configured objects.
    pub object: usize,
    /// Size relative to the configured object.
    pub scale: f64,
    /// Mass (kg).
    pub mass: f64,
    /// Coulomb coefficient.
    pub friction: f64,
    /// Half of the bounding box's edges, in the object's frame (m).
    pub half_extents: [f64; 3],
    /// Height of the object's frame when it rests on the table (m).
    pub rest_height: f64,
}

/// Everything that observation and reward are functions of.
#[derive(Clone, Copy, Debug)]
pub struct Moment<'a> {
    /// The rigid world.
    pub state: &'a SceneState,
    /// The episode's object.
    pub draw: &'a Draw,
    /// Grip force that was commanded (N).
    pub grip: f64,
    /// Time since the start of the episode (s).
    pub time: f64,
    /// What the fingers feel, if they do.
    pub feeling: Option<Feeling<'a>>,
}

impl Moment<'_> {
    /// Rise of the object over its rest on the table (m).
    pub fn rise(&self) -> f64 {
        self.state.object.pose.translation.z - self.draw.rest_height
    }
}

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
}

impl Ending {
    /// Every ending, in the order of [`Ending::code`].
    pub const ALL: [Self; 5] =
        [Self::ObjectLost, Self::NonFinite, Self::OutOfRange, Self::EngineError, Self::PressFailed];

    /// Name in `info["ending"]`.
    pub fn name(self) -> &'static str {
        match self {
            Self::ObjectLost => "object_lost",
            Self::NonFinite => "non_finite",
            Self::OutOfRange => "out_of_range",
            Self::EngineError => "engine_error",
            Self::PressFailed => "press_failed",
        }
    }

    /// Number from 1; 0 stands for none.
    pub fn code(self) -> u8 {
        self as u8 + 1
    }

    /// Whether and why the state ends the episode.
    pub fn of(state: &SceneState) -> Option<Self> {
        /// Half of the table's edge (m).
        const TABLE: f64 = 0.5;
        if state.failure.is_some() {
            return Some(Self::NonFinite);
        }
        let p = state.object.pose.translation.vector;
        (p.z < -0.05 || p.z > 1.0 || p.xy().amax() > TABLE).then_some(Self::ObjectLost)
    }
}
