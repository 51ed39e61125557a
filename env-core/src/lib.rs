//! Grasping with soft tactile fingertips: shapes and meshes, finite elements and linear elasticity of
//! soft bodies, networks that learn from them, touch, the rigid scene, tasks, and batches of
//! environments.
//!
//! Modules are layers, declared from the lowest to the highest: a module imports only from modules
//! declared before it in this list. SI units everywhere; only `scene` converts, at its interface
//! with Rapier.

#![forbid(unsafe_code)]

mod simd;
mod responses;
pub mod error;
pub mod interrupt;
mod recent;
mod saved;
pub mod tensor_file;
pub mod geometry;
pub mod sensor;
pub mod objects;
pub mod deformation;
pub mod contact;
pub mod fem;
pub mod compliance;
pub mod dataset;
pub mod surrogate;
pub mod tactile;
pub mod scene;
pub mod task;
pub mod render;
pub mod env;

pub use error::{Error, Result};
