//! Tasks: what an action means, what is observed and rewarded, and when an episode ends; pure
//! functions of the state of the simulation.
//!
//! A task is one file that implements [`Rules`] and stands in the list of [`Task`].

mod action;
mod checks;
mod config;
mod ending;
mod faulty_sensors;
mod grasp_fragile;
mod grasp_lift;
mod grasp_soft;
mod grip;
mod hold_still;
mod insert_peg;
mod objects;
mod observation;
mod progress;
mod read;
mod reward;
mod reward_weights;
mod schema;
mod sensor_errors;
mod setting;
mod start_quantity;
mod state_channel;

pub use action::{ACTION_SIZE, command};
pub use config::TaskConfig;
pub use ending::Ending;
pub use faulty_sensors::FaultySensors;
pub use grasp_fragile::GraspFragile;
pub use grasp_lift::GraspLift;
pub use grasp_soft::{GraspSoft, SoftMaterial};
pub use grip::GradualGrip;
pub use hold_still::{HoldStill, Shaking};
pub use insert_peg::{InsertPeg, Insertion};
pub use objects::{ObjectSpec, ShapeSpec};
pub use observation::{Component, ObservationLayout, TACTILE_CHANNELS};
pub use progress::Progress;
pub use reward::{RewardTerm, RewardTerms};
pub use reward_weights::RewardWeights;
pub use schema::schema;
pub use sensor_errors::{ErrorRange, SensorError, SensorErrors};
pub use setting::{Range, Setting, SettingValue};
pub use start_quantity::StartQuantity;
pub use state_channel::StateChannel;

use std::ops::{Deref, DerefMut};

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use crate::{
    Result,
    geometry::Shape,
    scene::{Fixture, MOST_DISTRACTORS, SceneState},
    tactile::{PadDeformations, Squeezed},
};

/// Rules of a task, and its settings. A method that is not written leaves a task as GraspLift is.
pub trait Rules {
    /// Name, as in the environment's id.
    fn name(&self) -> &'static str;

    /// Specification in Markdown, the docstring of the environment. Lines `{channels}`,
    /// `{tactile_channels}`, `{terms}` and `{settings}` stand for the tables of the task's
    /// channels, those of tactile fingers, reward terms and settings.
    fn doc(&self) -> &'static str;

    /// Terms of the reward.
    fn terms(&self) -> &'static [RewardTerm];

    /// Channels that only this task has.
    fn channels(&self) -> &'static [StateChannel] {
        &[]
    }

    /// Names of the default channels; `tactile` is `true` for tactile fingers.
    fn usual_channels(&self, tactile: bool) -> &'static [&'static str];

    /// Settings that only this task, or only some tasks have.
    fn settings(&mut self) -> Vec<Setting<'_>> {
        Vec::new()
    }

    /// Names of the common settings that would have no effect; the task refuses them.
    fn unused_settings(&self) -> &'static [&'static str] {
        &[]
    }

    /// Changes the settings that all tasks have to the defaults of this one.
    fn adapt(&self, _config: &mut TaskConfig) {}

    /// Returns an error unless the settings fit together; each is within its own bounds.
    fn validate(&self, _config: &TaskConfig) -> Result<()> {
        Ok(())
    }

    /// Place of hand and object at the start of an episode.
    fn start(&self) -> Start {
        Start::OverTable
    }

    /// Settings of a grip force that the action changes by a factor; `None` where it sets the
    /// force.
    fn gradual_grip(&self) -> Option<&GradualGrip> {
        None
    }

    /// Material of the object if it is soft; the fingers are then rigid.
    fn soft_material(&self) -> Option<&SoftMaterial> {
        None
    }

    /// Returns whether the stress in the pads ends an episode.
    fn limits_pad_stress(&self) -> bool {
        false
    }

    /// Coulomb coefficient at `share` (0 to 1) of its range.
    fn friction(&self, [low, high]: Range, share: f64) -> f64 {
        low + (high - low) * share
    }

    /// Adds to the parameters of an `episode` what this task draws with `uniform`.
    fn draw(
        &self,
        _config: &TaskConfig,
        _episode: &mut EpisodeParameters,
        _uniform: &mut dyn FnMut(Range) -> f64,
    ) {
    }

    /// Number of other objects on the table.
    fn distractors(&self) -> usize {
        0
    }

    /// Fixture on the table for an object of this shape and size, if the task has one.
    fn fixture(&self, _object: &Shape, _episode: &EpisodeParameters) -> Result<Option<Fixture>> {
        Ok(None)
    }

    /// Pose in the wrist's frame (m) of an object that starts in the hand; `None` for its frame
    /// between the pads, oriented as it rests on the table, with its narrower side across.
    fn pose_in_hand(&self, _episode: &EpisodeParameters) -> Option<Isometry3<f64>> {
        None
    }

    /// Reason for which a rule of this task alone ends the episode in `step`.
    fn ending(&self, _step: &StepState, _progress: &Progress) -> Option<Ending> {
        None
    }

    /// Returns whether the task is done in `step`: by default, with the object lifted for the hold
    /// time.
    fn is_success(&self, _step: &StepState, progress: &Progress, config: &TaskConfig) -> bool {
        progress.held(config) >= 1.0
    }
}

/// Place of hand and object at the start of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// The object lies on the table, the hand is over it.
    OverTable,
    /// The open fingers are around the object where it lies, about to touch it.
    AroundObject,
    /// The hand has gripped the object in the air.
    InHand,
}

/// Defines [`Task`] from the list of its kinds.
macro_rules! tasks {
    ($first:ident, $($other:ident),*) => {
        /// A task with its settings.
        #[derive(Clone, Debug, PartialEq, Serialize)]
        #[allow(missing_docs)] // Each variant holds the rules of the same name.
        pub enum Task {
            $first($first),
            $($other($other)),*
        }

        impl Task {
            /// All tasks with their default settings; the first is the default task.
            pub fn all() -> Vec<Self> {
                vec![Self::$first($first::default()), $(Self::$other($other::default())),*]
            }
        }

        impl Deref for Task {
            type Target = dyn Rules;

            fn deref(&self) -> &Self::Target {
                match self {
                    Self::$first(rules) => rules,
                    $(Self::$other(rules) => rules),*
                }
            }
        }

        impl DerefMut for Task {
            fn deref_mut(&mut self) -> &mut Self::Target {
                match self {
                    Self::$first(rules) => rules,
                    $(Self::$other(rules) => rules),*
                }
            }
        }
    };
}

tasks!(GraspLift, GraspFragile, GraspSoft, HoldStill, InsertPeg);

impl Default for Task {
    fn default() -> Self {
        Self::all().swap_remove(0)
    }
}

impl Task {
    /// The task called `name`, with its default settings.
    pub fn named(name: &str) -> Result<Self> {
        let all = Self::all();
        let known: Vec<_> = all.iter().map(|task| task.name()).collect();
        let expected = format!("one of {}", known.join(", "));
        let found = all.into_iter().find(|task| task.name() == name);
        found.ok_or_else(|| crate::Error::invalid("task", name, expected))
    }
}

/// Quantities drawn at the reset of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeParameters {
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
    pub trial: Option<TrialGrip>,
    /// Young's modulus of a soft object (Pa).
    pub young: Option<f64>,
    /// Young's modulus of the pads' gel relative to that of its material.
    pub gel_stiffness: f64,
    /// Disturbing force on the object, if there is one.
    pub shaking: Option<Shaking>,
    /// Hole, and place of the peg in the hand, if the object is a peg.
    pub insertion: Option<Insertion>,
    /// Other objects on the table, if there are any, with the friction of the object.
    pub distractors: [Option<Distractor>; MOST_DISTRACTORS],
}

impl EpisodeParameters {
    /// Index and relative size of the object and then of each distractor.
    pub fn bodies(&self) -> impl Iterator<Item = (usize, f64)> {
        let distractors = self.distractors.iter().flatten().map(|body| (body.object, body.scale));
        [(self.object, self.scale)].into_iter().chain(distractors)
    }
}

/// Object on the table that is not to be grasped.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Distractor {
    /// Index into the configured objects.
    pub object: usize,
    /// Size relative to the configured object.
    pub scale: f64,
    /// Mass (kg).
    pub mass: f64,
    /// Pose at the start (m).
    pub pose: Isometry3<f64>,
}

/// Trial grip whose stress sets the limit of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialGrip {
    /// Grip force (N).
    pub grip: f64,
    /// Stress limit relative to the peak stress of this grip.
    pub margin: f64,
}

/// Least grip force with which two pads hold against a tangential `force` (N) by Coulomb's law, in
/// N.
pub fn least_grip(force: f64, friction: f64) -> f64 {
    0.5 * force / friction
}

/// State of an episode after a step, from which observation and reward are computed.
#[derive(Clone, Copy, Debug)]
pub struct StepState<'a> {
    /// State of the rigid bodies.
    pub state: &'a SceneState,
    /// Quantities drawn at the reset.
    pub episode: &'a EpisodeParameters,
    /// Commanded grip force (N).
    pub grip: f64,
    /// Time since the start of the episode (s).
    pub time: f64,
    /// Contact of the fingers, if they are tactile.
    pub pads: Option<PadDeformations<'a>>,
    /// Deformation of a soft object, if it is squeezed.
    pub squeezed: Option<&'a Squeezed>,
    /// Highest von Mises stress in the pads, or in a soft object (Pa), if the task needs it; 0
    /// without contact.
    pub peak_stress: f64,
}

impl StepState<'_> {
    /// Rise of the object over its rest on the table (m).
    pub fn rise(&self) -> f64 {
        self.state.object.pose.translation.z - self.episode.rest_height
    }

    /// Highest stress relative to the limit of the episode; 0 without a limit.
    pub fn stress_ratio(&self) -> f64 {
        self.episode.stress_limit.map_or(0.0, |limit| self.peak_stress / limit)
    }

    /// Returns whether both pads press on the object.
    pub fn both_touch(&self) -> bool {
        self.state.fingers.iter().all(|finger| finger.object_force > 0.0)
    }

    /// Returns whether a pad presses on the object.
    pub fn any_touches(&self) -> bool {
        self.state.fingers.iter().any(|finger| finger.object_force > 0.0)
    }
}
