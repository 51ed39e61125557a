//! Action, observation and reward of the tasks: pure functions of the state of the simulation.

mod action;
mod closing;
mod config;
mod ending;
mod fragility;
mod holding;
mod json;
mod kind;
mod objects;
mod observation;
mod progress;
mod reward;
mod softness;

pub use action::{ACTION_SIZE, command};
pub use closing::Closing;
pub use config::{Config, Range};
pub use ending::Ending;
pub use fragility::{Fragility, Trial, least_grip};
pub use holding::{Holding, Shaking};
pub use kind::Task;
pub use objects::{ObjectSpec, ShapeSpec};
pub use observation::{CHANNELS, Component, Layout, TACTILE_CHANNELS};
pub use progress::Progress;
pub use reward::{RewardTerms, Term, Weights};
pub use softness::Softness;

use crate::{
    scene::SceneState,
    tactile::{Feeling, Squeezed},
};

/// Quantities drawn at the reset of an episode.
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
    /// Stress in the pads, or in a soft object, above which the episode ends (Pa), if there is a
    /// limit.
    pub stress_limit: Option<f64>,
    /// Trial grip that sets the limit, if one does.
    pub trial: Option<Trial>,
    /// Young's modulus of a soft object (Pa).
    pub young: Option<f64>,
    /// Disturbing force on the object, if there is one.
    pub shaking: Option<Shaking>,
}

/// State of an episode from which observation and reward are computed.
#[derive(Clone, Copy, Debug)]
pub struct Moment<'a> {
    /// State of the rigid bodies.
    pub state: &'a SceneState,
    /// Quantities drawn at the reset.
    pub draw: &'a Draw,
    /// Commanded grip force (N).
    pub grip: f64,
    /// Time since the start of the episode (s).
    pub time: f64,
    /// Contact of the fingers, if they are tactile.
    pub feeling: Option<Feeling<'a>>,
    /// Deformation of a soft object, if it is squeezed.
    pub squeezed: Option<&'a Squeezed>,
    /// Highest von Mises stress in the pads, or in a soft object (Pa), if the task needs it; 0
    /// without contact.
    pub peak_stress: f64,
}

impl Moment<'_> {
    /// Rise of the object over its rest on the table (m).
    pub fn rise(&self) -> f64 {
        self.state.object.pose.translation.z - self.draw.rest_height
    }

    /// Highest stress relative to the limit of the episode; 0 without a limit.
    pub fn share_of_limit(&self) -> f64 {
        self.draw.stress_limit.map_or(0.0, |limit| self.peak_stress / limit)
    }

    /// Largest mean grip force of a success (N): [`Holding::thrift`] times the least that holds, by
    /// Coulomb's law, against the largest sum of weight, load and shaking. Infinite without
    /// shaking.
    pub fn thrifty_grip(&self, config: &Config) -> f64 {
        let weight = self.draw.mass * config.scene.physics.gravity;
        let largest = self.draw.shaking.map(|shaking| shaking.largest(weight));
        let spared = config.holding.as_ref().map(|holding| holding.thrift).zip(largest);
        spared
            .map_or(f64::INFINITY, |(thrift, force)| thrift * least_grip(force, self.draw.friction))
    }

    /// Returns whether both pads press on the object.
    pub fn both_touch(&self) -> bool {
        self.state.fingers.iter().all(|finger| finger.normal_force() > 0.0)
    }

    /// Returns whether a pad presses on the object.
    pub fn any_touches(&self) -> bool {
        self.state.fingers.iter().any(|finger| finger.normal_force() > 0.0)
    }
}
