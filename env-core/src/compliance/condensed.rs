//! Condensation of a body to its skin, done once.
//!
//! The compliance C is the displacement of every skin node under a unit force on every other: the
//! inverse of the stiffness K at rest, restricted to skin nodes. It is symmetric.
//!
//! Shapes: V nodes, M skin nodes (free nodes that a surface point is interpolated from), C surface
//! points.

use std::{path::Path, sync::Arc};

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::cache::Stored;
use crate::{
    Result,
    contact::{Backing, SurfacePoint},
    deformation::{ModelIdentity, Numbering, Press, SoftBody},
    fem::{Linearised, held_all_round},
    simd::vectorised,
};

/// Rank of a node that is not a skin node.
pub(super) const INSIDE: u32 = u32::MAX;

/// Data shared by all presses of a body. Copies may differ in their contact points.
#[derive(Clone)]
pub(super) struct Condensed {
    pub(super) body: SoftBody,
    pub(super) identity: ModelIdentity,
    pub(super) rest: Arc<Linearised>,
    /// Rank of each node among the skin nodes, or [`INSIDE`] (V).
    pub(super) rank: Arc<[u32]>,
    /// The skin nodes (M).
    pub(super) skin: Arc<[u32]>,
    /// Compliance C, three rows for each skin node (3M, 3M) in m/N.
    compliance: Arc<Vec<f64>>,
    /// Points at which contact is evaluated (C).
    pub(super) surface: Arc<[SurfacePoint]>,
    /// Points on the held faces, which shapes must not enter.
    pub(super) backing: Arc<Backing>,
    pub(super) facets: Arc<[SkinFacet]>,
}

/// Face of the surface at rest.
pub(super) struct SkinFacet {
    pub(super) centre: Point3<f64>,
    /// Distance of its farthest surface point from the centre (m).
    pub(super) radius: f64,
    /// Largest sum of the absolute weights of one of its points; at least 1.
    pub(super) gain: f64,
    pub(super) nodes: Vec<u32>,
    /// Indices of its surface points.
    pub(super) points: std::ops::Range<u32>,
}

impl Condensed {
    /// Condenses `body`. With a `directory`, the result is read from there if it was stored before,
    /// and stored there if not.
    pub(super) fn new(body: SoftBody, directory: Option<&Path>) -> Result<Self> {
        let rest = Linearised::new(&body)?;
        Self::of(body, rest, directory, Numbering::Vertices)
    }

    /// Condenses a `body` without fixed nodes.
    pub(super) fn free(body: SoftBody) -> Result<Self> {
        let rest = Linearised::free(&body)?;
        Self::of(body, rest, None, Numbering::Free)
    }

    fn of(
        body: SoftBody,
        rest: Linearised,
        directory: Option<&Path>,
        numbering: Numbering,
    ) -> Result<Self> {
        let (surface, backing) = rest.surface(&body);
        if surface.is_empty() {
            return Err(held_all_round(&body));
        }
        let mut skin: Vec<u32> = surface.iter().flat_map(carriers).collect();
        skin.sort_unstable();
        skin.dedup();
        skin.retain(|&node| rest.is_free(node));
        let mut rank = vec![INSIDE; rest.places().len()];
        for (i, &node) in skin.iter().enumerate() {
            rank[node as usize] = i as u32;
        }
        let compliance = match directory {
            None => condense(&rest, &skin),
            Some(directory) => {
                let stored = Stored::of(&body, directory);
                stored.read_or_compute(9 * skin.len() * skin.len(), || condense(&rest, &skin))?
            }
        };
        let facets = facets(&surface, rest.places()).into();
        let (rank, skin, surface) = (rank.into(), skin.into(), surface.into());
        let (rest, compliance, backing) = (Arc::new(rest), Arc::new(compliance), Arc::new(backing));
        let identity = ModelIdentity::new(numbering, &body, rest.places());
        Ok(Self { body, identity, rest, rank, skin, compliance, surface, backing, facets })
    }

    /// Returns the body with contact points as close together as the thin shapes of `press`
    /// require.
    pub(super) fn suited(self: &Arc<Self>, press: &Press) -> Result<Arc<Self>> {
        let Some((surface, backing)) = self.rest.closer_surface(&self.body, press)? else {
            return Ok(Arc::clone(self));
        };
        let facets = facets(&surface, self.rest.places()).into();
        let (surface, backing) = (surface.into(), backing.into());
        Ok(Arc::new(Self { surface, backing, facets, ..(**self).clone() }))
    }

    /// Rows of the compliance for a force on the skin node of this rank (3, 3M).
    pub(super) fn rows(&self, rank: u32) -> &[f64] {
        let size = 9 * self.skin.len();
        &self.compliance[rank as usize * size..][..size]
    }

    /// Compliance C, three rows for each skin node (3M, 3M) in m/N.
    pub(super) fn compliance(&self) -> &[f64] {
        &self.compliance
    }

    /// Rank of a node among the skin nodes; `None` if it is not one.
    pub(super) fn rank_of(&self, node: u32) -> Option<usize> {
        let rank = self.rank[node as usize];
        (rank != INSIDE).then_some(rank as usize)
    }

    /// Area that each skin node represents (M) in m².
    pub(super) fn areas(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.skin.len()];
        for point in self.surface.iter() {
            for &(node, share) in &point.shares {
                if let Some(rank) = self.rank_of(node) {
                    areas[rank] += share * point.area;
                }
            }
        }
        areas
    }

    /// Displacement (V) in m under `forces` on `nodes`, known on the skin and zero elsewhere.
    pub(super) fn response(&self, nodes: &[u32], forces: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut sum = vec![0.0; 3 * self.skin.len()];
        for (&node, force) in nodes.iter().zip(forces).filter(|(_, f)| **f != Vector3::zeros()) {
            add_rows(&mut sum, self.rows(self.rank[node as usize]), &(*force).into());
        }
        let mut displacement = vec![Vector3::zeros(); self.rank.len()];
        for (&node, u) in self.skin.iter().zip(sum.as_chunks::<3>().0) {
            displacement[node as usize] = Vector3::from(*u);
        }
        displacement
    }
}

/// Adds to `sum` the displacement under a `force`; `rows` are the rows of the compliance for its
/// three components.
pub(super) fn add_rows(sum: &mut [f64], rows: &[f64], force: &[f64; 3]) {
    let (x, rest) = rows.split_at(sum.len());
    let (y, z) = rest.split_at(sum.len());
    vectorised(
        #[inline(always)]
        || {
            for (((u, x), y), z) in sum.iter_mut().zip(x).zip(y).zip(z) {
                *u += force[0] * x + force[1] * y + force[2] * z;
            }
        },
    );
}

fn carriers(point: &SurfacePoint) -> impl Iterator<Item = u32> {
    point.shares.iter().map(|&(node, _)| node)
}

/// Number of skin nodes solved for in one task.
const BATCH: usize = 8;

fn condense(rest: &Linearised, skin: &[u32]) -> Vec<f64> {
    let row = 9 * skin.len();
    let mut compliance = vec![0.0; row * skin.len()];
    let batches = compliance.par_chunks_mut(BATCH * row).zip(skin.par_chunks(BATCH));
    batches.for_each_init(
        || rest.workspace(),
        |workspace, (rows, at)| {
            rows.copy_from_slice(&rest.unit_responses(at, skin, workspace));
        },
    );
    compliance
}

/// Groups consecutive surface points that are interpolated from the same nodes.
fn facets(surface: &[SurfacePoint], places: &[Point3<f64>]) -> Vec<SkinFacet> {
    let mut facets = Vec::new();
    let (mut first, still) = (0, vec![Vector3::zeros(); places.len()]);
    for run in surface.chunk_by(|a, b| carriers(a).eq(carriers(b))) {
        let place = |point: &SurfacePoint| point.place(places, &still);
        let sum: Vector3<f64> = run.iter().map(|point| place(point).coords).sum();
        let centre = Point3::from(sum / run.len() as f64);
        let away = |point: &SurfacePoint| (place(point) - centre).norm();
        let gain = |point: &SurfacePoint| point.shares.iter().map(|(_, s)| s.abs()).sum::<f64>();
        let last = first + run.len() as u32;
        facets.push(SkinFacet {
            centre,
            radius: run.iter().map(away).fold(0.0, f64::max),
            gain: run.iter().map(gain).fold(1.0, f64::max),
            nodes: carriers(&run[0]).collect(),
            points: first..last,
        });
        first = last;
    }
    facets
}
