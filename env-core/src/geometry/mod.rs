//! Shapes, surfaces and mesh files.

mod bisection;
mod cached;
mod convex_hull;
mod distance;
#[cfg(test)]
mod examples;
mod field_file;
mod footprint;
mod graded_pad;
mod length;
mod mesh_file;
mod pad_mesh;
mod pad_outline;
mod parts;
mod rigid_fit;
mod rounded;
mod sampled;
mod shape;
mod shape_bytes;
mod star_shaped;
mod stuffing;
mod surface;
mod tet_file;
mod tet_mesh;
mod transfer;
mod walls;

pub use distance::Distance;
pub use field_file::{Field, FieldOn};
pub use footprint::Footprint;
pub(crate) use footprint::{COARSE, face, finer, gap};
pub use graded_pad::GradedPad;
pub use mesh_file::{read_solid, read_surface};
pub use pad_mesh::{Grading, PadMesh, plan_shares, under};
pub use pad_outline::PadOutline;
pub use rigid_fit::RigidFit;
pub use rounded::Rounded;
pub use sampled::Sampled;
pub use shape::{Parameter, Shape};
pub use star_shaped::{Bump, Hollow, StarShaped, Wave};
pub(crate) use surface::simplify;
pub(crate) use surface::vertex_normals;
pub use surface::{MassProperties, Surface};
pub(crate) use tet_mesh::{EDGES, FACES};
pub use tet_mesh::{Incidence, MeshQuality, TetMesh};
pub use transfer::Transfer;
pub(crate) use transfer::{Site, sample_shares, samples, sites};
