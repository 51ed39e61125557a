//! Grasps of known and novel objects by two soft pads, solved by finite elements: training data for
//! the networks and reference for all models.
//!
//! A grasp closes two pads on a rigid object that comes to equilibrium between them, frame by frame
//! with growing force ([`ramp`]), with or without its weight ([`weight`]); or two rigid fingers
//! squeeze a soft object ([`squeeze`]); or an indenter moves through given poses into one pad
//! ([`press`]). Grasps are solved on a finer mesh than the one on which their fields are
//! stored: the truth mesh and the model mesh of [`DatasetConfig`]. Grasps are stored in shards
//! (safetensors), ten of one object each, which a [`Manifest`] lists with their hashes,
//! failures and splits. The same configuration gives the same bytes for any number of threads and
//! interruptions: every solved grasp is stored in a file of its own until its shard is packed. Of
//! meshes of one's own ([`MeshObject`]) it has copies.

mod config;
mod file;
mod generate;
mod indentation;
mod job;
mod manifest;
mod mesh_object;
mod plan;
mod press;
mod ramp;
mod read;
mod record;
mod setup;
mod squeeze;
mod squeezes;
mod tensor;
mod weight;

pub use config::{DatasetConfig, GelConfig, SOFT, Scenario};
pub(crate) use file::{sha256, write_whole};
pub use generate::{Estimate, GenerationProgress, Obstacle, Orders, estimate, generate, shards};
pub use indentation::Indentation;
pub use manifest::{FORMAT, Manifest, Shard, Solved, Split, Unsolved};
pub use mesh_object::MeshObject;
pub use plan::{Plan, plans};
pub use press::solve_press;
pub(crate) use press::steps;
pub use read::{Dataset, PadFrames};
pub use record::BodyFields;
pub use squeezes::{SqueezeFrames, Squeezes};
