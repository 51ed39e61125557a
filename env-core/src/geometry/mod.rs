//! Shapes, surfaces and mesh files.

mod distance;
mod mesh_file;
mod shape;
mod surface;
mod tet_mesh;

pub use distance::Distance;
pub use mesh_file::read_surface;
pub use shape::{Shape, StarShaped, Wave};
pub use surface::{MassProperties, Surface};
pub use tet_mesh::TetMesh;
