//! Grasps of known and novel objects by two soft pads, solved by finite elements: what networks
//! learn from and every answerer is judged by.
//!
//! A grasp closes two pads on a rigid object that settles between them, frame by frame with growing
//! force ([`ramp`]), with or without its weight ([`weight`]); or two rigid fingers squeeze a soft
//! object ([`squeeze`]). It is solved on a finer mesh than the one its fields are stored on: the truth
//! mesh and the model mesh of [`Config`]. Grasps are stored in shards (safetensors), ten of an
//! object each, which a [`Manifest`] lists with their hashes, failures and splits. The same
//! configuration gives the same bytes, whatever the number of threads and however often it was
//! interrupted: every solved grasp is kept in a file of its own until its shard is packed.

mod config;
mod generate;
mod job;
mod manifest;
mod plan;
mod ramp;
mod read;
mod record;
mod setup;
mod squeeze;
mod squeezes;
mod tensor;
mod weight;

pub use config::{Config, Gel, SOFT, Scenario};
pub use generate::{Obstacle, Orders, Progress, generate, shards};
pub use manifest::{FORMAT, Manifest, Shard, Solved, Split, Unsolved};
pub use plan::{Plan, plans};
pub use read::{Dataset, PadFrames};
pub use squeezes::{SqueezeFrames, Squeezes};
pub(crate) use tensor::write_whole;
