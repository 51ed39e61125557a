//! The objects of the dataset, and where a parallel gripper can hold them.
//!
//! Families and counts are those of the paper's experiment: 49 objects to train on, 14 novel ones,
//! and one soft fruit besides. Every object is drawn from its own seed by arithmetic that IEEE 754
//! rounds exactly, so its parameters are the same bits on every platform. All are of hand size: some
//! way of holding them is at most 60 mm wide.

mod antipodal;
mod clearance;
mod draw;
mod family;
mod fruit;

pub use antipodal::{Antipodal, GraspSampler, Rejection, Sampling};
pub use clearance::Hand;
pub use family::{Family, Split};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::{
    Error, Result,
    geometry::{MassProperties, Shape, Surface, TetMesh},
};

/// One object of the dataset.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Family and number, such as `cup-2`.
    pub name: String,
    /// What kind of thing it is.
    pub family: Family,
    /// What it is for.
    pub split: Split,
    /// What its parameters were drawn from.
    pub seed: u64,
    /// The exact solid, z along its axis of symmetry if it has one.
    pub shape: Shape,
}

/// Edges round a circle for mass properties: polygons of 128 sides miss 0.04 % of a disc.
const SEGMENTS: u32 = 128;

impl Object {
    /// Member `index` (from 0) of a family.
    pub fn new(family: Family, index: u32, seed: u64) -> Self {
        let name = format!("{family}-{}", index + 1);
        Self { name, family, split: family.split(), seed, shape: family.shape(index, seed) }
    }

    /// Watertight triangles with about `segments` edges round a circle.
    pub fn surface(&self, segments: u32) -> Surface {
        self.shape.surface(segments).expect("no family has a half-space")
    }

    /// Mass properties at `density` (kg/m³).
    pub fn mass_properties(&self, density: f64) -> MassProperties {
        self.surface(SEGMENTS).mass_properties(density)
    }

    /// Tetrahedra with edges of about `spacing` (m); errors as for [`TetMesh::of_shape`].
    pub fn tets(&self, spacing: f64) -> Result<TetMesh> {
        TetMesh::of_shape(&self.shape, spacing)
    }

    /// The finest tetrahedra of at most `nodes` nodes, or about so; errors as for
    /// [`TetMesh::of_shape`].
    pub fn tets_within(&self, nodes: usize) -> Result<TetMesh> {
        tets_within(&self.shape, nodes)
    }
}

/// As [`Object::tets_within`], of any solid.
pub fn tets_within(shape: &Shape, nodes: usize) -> Result<TetMesh> {
    // A body-centred lattice has two points in a cube of the spacing.
    let surface = shape.surface(SEGMENTS);
    let surface = surface.ok_or_else(|| Error::invalid("shape", "a half-space", "a solid"))?;
    let volume = surface.mass_properties(1.0).mass;
    let mut spacing = (2.0 * volume / nodes as f64).cbrt();
    loop {
        let mesh = TetMesh::of_shape(shape, spacing)?;
        if mesh.vertices.len() <= nodes {
            return Ok(mesh);
        }
        spacing *= (mesh.vertices.len() as f64 / nodes as f64).cbrt().max(1.005);
    }
}

/// All 64 objects: those to train on, the novel ones, the soft one.
pub fn catalogue(seed: u64) -> Vec<Object> {
    let members = Family::ALL.iter().flat_map(|&f| (0..f.count()).map(move |index| (f, index)));
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    members.map(|(family, index)| Object::new(family, index, random.next_u64())).collect()
}
