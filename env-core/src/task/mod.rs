//! What the agent sees, does and is paid for: pure functions of the rigid world's state.

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
    /// Stress in the pads, or in a soft object, that ends the episode (Pa), where there is such a limit.
    pub stress_limit: Option<f64>,
    /// Where the limit comes from, if it comes from a trial grip.
    pub trial: Option<Trial>,
    /// Young's modulus of a soft object (Pa).
    pub young: Option<f64>,
    /// What shakes the object, where something does.
    pub shaking: Option<Shaking>,
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
    /// What a soft object feels, if it is squeezed.
    pub squeezed: Option<&'a Squeezed>,
    /// Highest von Mises stress in the pads, or in a soft object (Pa), where the task asks for it; 0
    /// without contact.
    pub peak_stress: f64,
}

impl Moment<'_> {
    /// Rise of the object over its rest on the table (m).
    pub fn rise(&self) -> f64 {
        self.state.object.pose.translation.z - self.draw.rest_height
    }

    /// Highest stress over what the episode allows; 0 where it allows any.
    pub fn share_of_limit(&self) -> f64 {
        self.draw.stress_limit.map_or(0.0, |limit| self.peak_stress / limit)
    }

    /// Mean grip up to which a held object counts as held by little force (N): so much more than the least
    /// that bears, by Coulomb's law, the largest of weight, load and shaking. Any force where nothing
    /// shakes.
    pub fn thrifty_grip(&self, config: &Config) -> f64 {
        let weight = self.draw.mass * config.scene.physics.gravity;
        let largest = self.draw.shaking.map(|shaking| shaking.largest(weight));
        let spared = config.holding.as_ref().map(|holding| holding.thrift).zip(largest);
        spared
            .map_or(f64::INFINITY, |(thrift, force)| thrift * least_grip(force, self.draw.friction))
    }

    /// Whether both pads press on the object.
    pub fn both_touch(&self) -> bool {
        self.state.fingers.iter().all(|finger| finger.normal_force() > 0.0)
    }

    /// Whether a pad presses on the object.
    pub fn any_touches(&self) -> bool {
        self.state.fingers.iter().any(|finger| finger.normal_force() > 0.0)
    }
}
