//! Shapes, surfaces and mesh files.

mod mesh_file;
mod shape;
mod surface;

pub use mesh_file::read_surface;
pub use shape::{Shape, StarShaped, Wave};
pub use surface::{MassProperties, Surface};
