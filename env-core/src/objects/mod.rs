//! Objects of the dataset, and grasps of them by a parallel gripper.
//!
//! Families and counts are those of the paper's experiment: 49 objects for training, 14 novel ones,
//! and one soft fruit in addition. Every object is drawn from its own seed by arithmetic that IEEE
//! 754 rounds exactly, so its parameters are the same bits on every platform. All are of hand size:
//! each can be held at some width of at most 60 mm.

mod antipodal;
mod clearance;
mod draw;
mod family;
mod fruit;
mod textured;

pub use antipodal::{Antipodal, GraspSampler, Rejection, Sampling};
pub use clearance::Hand;
pub(crate) use clearance::{FINGER_DEPTH, FINGER_TOP, OPENING};
pub use family::{Family, FamilySplit};

use rand::{Rng, RngExt, SeedableRng};
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
    /// Kind of object; `None` for one from a mesh file.
    pub family: Option<Family>,
    /// Use of the object.
    pub split: FamilySplit,
    /// Seed of its parameters.
    pub seed: u64,
    /// Exact solid, z along its axis of symmetry if it has one.
    pub shape: Shape,
}

/// Edges round a circle, for mass properties and for solids that are meshes: a polygon of 128 sides
/// has 0.04 % less area than the disc.
const SEGMENTS: u32 = 128;

impl Object {
    /// Returns member `index` (from 0) of a family.
    pub fn new(family: Family, index: u32, seed: u64) -> Self {
        let name = format!("{family}-{}", index + 1);
        let (split, shape) = (family.split(), family.shape(index, seed));
        Self { name, family: Some(family), split, seed, shape }
    }

    /// Watertight triangulation with about `segments` edges round a circle.
    pub fn surface(&self, segments: u32) -> Surface {
        self.shape.surface(segments).expect("no family has a half-space")
    }

    /// Mass properties at `density` (kg/m³).
    pub fn mass_properties(&self, density: f64) -> MassProperties {
        self.surface(SEGMENTS).mass_properties(density)
    }

    /// Tetrahedral mesh with edges of about `spacing` (m); errors as for [`TetMesh::of_shape`].
    pub fn tets(&self, spacing: f64) -> Result<TetMesh> {
        TetMesh::of_shape(&self.shape, spacing)
    }

    /// Tetrahedral mesh of at most `nodes` nodes, about as fine as that allows; errors as for
    /// [`TetMesh::of_shape`].
    pub fn tets_within(&self, nodes: usize) -> Result<TetMesh> {
        tets_within(&self.shape, nodes)
    }
}

/// Returns [`Object::tets_within`] for any solid.
pub fn tets_within(shape: &Shape, nodes: usize) -> Result<TetMesh> {
    // A body-centred lattice has two points in a cube of the spacing.
    let surface = shape.surface(SEGMENTS);
    let surface = surface.ok_or_else(|| Error::invalid("shape", "a half-space", "a solid"))?;
    let volume = surface.mass_properties(1.0).mass;
    let mut spacing = (2.0 * volume / nodes as f64).cbrt();
    loop {
        let mesh = TetMesh::of_shape(shape, spacing)
            .map_err(|error| too_thin(shape, spacing).unwrap_or(error))?;
        if mesh.vertices.len() <= nodes {
            return Ok(mesh);
        }
        spacing *= (mesh.vertices.len() as f64 / nodes as f64).cbrt().max(1.005);
    }
}

/// The error of a solid with a wall that is thinner than the `spacing` of its tetrahedra (m).
fn too_thin(shape: &Shape, spacing: f64) -> Option<Error> {
    let wall = shape.thinnest_wall();
    (wall < spacing).then(|| {
        let found = format!("a wall {:.2} mm thick", 1e3 * wall);
        let expected = format!(
            "{:.2} mm or more everywhere, the length of the edges of its tetrahedra",
            1e3 * spacing
        );
        Error::invalid("shape", found, expected)
    })
}

/// All 64 objects: first those for training, then the novel ones, last the soft one.
pub fn catalogue(seed: u64) -> Vec<Object> {
    let members = Family::ALL.iter().flat_map(|&f| (0..f.count()).map(move |index| (f, index)));
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    members.map(|(family, index)| Object::new(family, index, random.next_u64())).collect()
}

/// Names of the [`catalogue`], in its order.
pub fn names() -> impl Iterator<Item = String> {
    Family::ALL.iter().flat_map(|f| (1..=f.count()).map(move |number| format!("{f}-{number}")))
}

/// Families of [`indenters`] that touch at a few places: those of the catalogue for training, and
/// two more.
const INDENTERS: [Family; 11] = [
    Family::Prism,
    Family::Sphere,
    Family::Cuboid,
    Family::Cylinder,
    Family::Cone,
    Family::Annulus,
    Family::Capsule,
    Family::Potato,
    Family::Cup,
    Family::Lemon,
    Family::Eggplant,
];

/// Families of [`indenters`] that touch at many small places.
const TEXTURED: [Family; 3] = [Family::Raspberry, Family::Ribbed, Family::Rasp];

/// Returns whether a family of drawn objects has this `name`.
pub fn is_family(name: &str) -> bool {
    let all = Family::ALL.iter().chain(&INDENTERS).chain(&TEXTURED);
    all.into_iter().any(|family| family.to_string() == name)
}

/// Least scale of every second indenter, relative to the largest.
const WIDE: f64 = 0.25;

/// Returns `count` solids of the families for training, scaled from hand size by factors from `low`
/// to `high` whose logarithm is uniform: 0.02 gives features of 0.3 mm. Every second is at
/// least [`WIDE`] `high`. The last `textured` of them touch at many small places.
pub fn indenters(seed: u64, count: usize, textured: usize, [low, high]: [f64; 2]) -> Vec<Object> {
    let one = |number: usize| {
        let families = if number + textured < count { &INDENTERS[..] } else { &TEXTURED };
        let family = families[number % families.len()];
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(number as u64);
        let (index, seed) = (random.next_u32() % 64, random.next_u64());
        let low = if number % 2 == 1 { f64::max(low, WIDE * high) } else { low };
        let scale = low * (high / low).powf(random.random::<f64>());
        let shape = family.indenter(index, seed).scaled(scale);
        Object {
            name: format!("{family}-{number:05}"),
            family: Some(family),
            split: FamilySplit::Train,
            seed,
            shape,
        }
    };
    (0..count).map(one).collect()
}
