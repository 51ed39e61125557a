//! A gel and an object as one graph.
//!
//! Lengths are in units of the gel's thickness, so moduli enter as Poisson's ratio only. The gel is
//! given at rest, so its current relative positions and those at rest are the same.
//!
//! Shapes: V gel nodes, then O object nodes, N = V + O, E directed edges of a kind, T tetrahedra.

use std::sync::Arc;

use candle_core::{Device, Tensor};
use nalgebra::{Isometry3, Point3, Vector3};

use super::{gels::Pad, patch::PaperPatch};
use crate::{
    Error, Result,
    surrogate::{
        ops::{Edges, Sparse},
        train::mirror_signs,
    },
};

/// Number of features of a node: kind (free, bonded, object), position, displacement since touch in
/// units of a typical press, direction in which the finger moves it, compressibility, friction.
pub(super) const NODE_FEATURES: usize = 3 + 3 + 3 + 3 + 2;
/// Number of features of a mesh edge: vector from sender to receiver, and its length.
pub(super) const MESH_FEATURES: usize = 4;
/// Number of features of a contact edge: those of a mesh edge, and the force over the number of
/// edges.
pub(super) const CONTACT_FEATURES: usize = 5;

/// Greatest length of a contact edge (m), as in `DefGraspNets`.
const RADIUS: f64 = 5e-3;
/// Most object nodes that a node of the face is joined to, the nearest ones; there are dozens
/// within the radius.
const NEAREST: usize = 4;
/// Distance by which a typical press moves the object, in units of thickness.
const MIDDLING: f64 = 0.05;
/// Force over the number of edges is about 1 in units of E L² over this many edges.
const SHARES: f64 = 1000.0;

/// Known quantity of an object that is pressed in.
#[derive(Clone, Copy)]
pub(super) enum PaperPush {
    /// Its motion since it touched, in the pad's frame.
    Moved(Isometry3<f64>),
    /// The normal force, in units of E L².
    Force(f64),
}

/// One press as a graph.
pub(super) struct PaperScene {
    /// Features of the nodes (N, `NODE_FEATURES`).
    pub(super) nodes: Tensor,
    pub(super) mesh: Links,
    /// Edges between face and object, in both directions.
    pub(super) contact: Links,
    /// 1 for a gel node that moves, 0 for a bonded one (V, 1).
    pub(super) free: Tensor,
    /// Matrix that sums over the corners of each tetrahedron (T, V).
    pub(super) corners: Arc<Sparse>,
}

/// Directed edges of a kind.
pub(super) struct Links {
    pub(super) edges: Arc<Edges>,
    /// Features of the edges (E, features).
    pub(super) features: Tensor,
    /// Matrix that sums over the edges to each node (N, E).
    pub(super) sums: Arc<Sparse>,
}

impl PaperScene {
    /// Builds the graph of `push` by the surface in `patch`, which touches `pad`, seen in a mirror;
    /// an error if nothing is near the gel.
    pub(super) fn new(
        pad: &Pad,
        patch: &PaperPatch,
        push: PaperPush,
        mirror: usize,
    ) -> Result<Self> {
        let Pad { gel, graph } = pad;
        let (length, gel_nodes) = (gel.thickness, graph.places.len());
        let at_touch = patch.places.iter().map(|p| Point3::from(*p));
        let object: Vec<Point3<f64>> = match push {
            PaperPush::Moved(moved) => at_touch.map(|p| moved * p).collect(),
            PaperPush::Force(_) => at_touch.collect(),
        };
        let places: Vec<_> = graph.places.iter().chain(&object).copied().collect();
        let signs = Vector3::from(mirror_signs(mirror));
        let offset = |a: u32, b: u32| {
            (places[a as usize] - places[b as usize]).component_mul(&signs) / length
        };
        let joined = contacts(&graph.places[..graph.columns], &object, gel_nodes);
        if joined.is_empty() {
            let reason = format!("no node of the object within {RADIUS} m of the pad's face");
            return Err(Error::Network { reason });
        }
        let force = match push {
            PaperPush::Moved(_) => 0.0,
            PaperPush::Force(force) => force * SHARES / joined.len() as f64,
        };
        let on_object = patch.pairs.iter();
        let shift = gel_nodes as u32;
        let on_object = on_object.map(|&(a, b)| (a + shift, b + shift));
        let pairs: Vec<_> = graph.pairs.iter().copied().chain(on_object).collect();
        let row = |a, b| [offset(a, b).x, offset(a, b).y, offset(a, b).z, offset(a, b).norm()];
        let mesh = Links::between(&pairs, places.len(), |a, b| row(a, b).to_vec())?;
        let contact = Links::between(&joined, places.len(), |a, b| {
            row(a, b).into_iter().chain([force]).collect()
        })?;
        let material = [10.0 * (0.5 - gel.moduli.poisson), gel.friction];
        let node = |i: usize| {
            let place = places[i].coords.component_mul(&signs) / length;
            let (kind, moved, motion) = if i >= gel_nodes {
                let moved = object[i - gel_nodes].coords - patch.places[i - gel_nodes];
                (2, moved.component_mul(&signs) / (MIDDLING * length), -Vector3::z())
            } else {
                (usize::from(graph.free[i] == 0.0), Vector3::zeros(), Vector3::zeros())
            };
            let kinds = [0, 1, 2].map(|k| if k == kind { 1.0 } else { 0.0 });
            let vectors = [place, moved, motion].map(|v| [v.x, v.y, v.z]);
            kinds.into_iter().chain(vectors.into_iter().flatten()).chain(material)
        };
        let nodes: Vec<f32> = (0..places.len()).flat_map(node).map(|x| x as f32).collect();
        Ok(Self {
            nodes: Tensor::from_vec(nodes, (places.len(), NODE_FEATURES), &Device::Cpu)?,
            mesh,
            contact,
            free: Tensor::from_slice(&graph.free, (gel_nodes, 1), &Device::Cpu)?,
            corners: Arc::clone(&graph.corners),
        })
    }
}

/// Receiver and sender of the edges between the nodes of a face and the nearest of an object, whose
/// nodes are numbered from `first`, in both directions and sorted.
fn contacts(face: &[Point3<f64>], object: &[Point3<f64>], first: usize) -> Vec<(u32, u32)> {
    let near = face.iter().map(|place| PaperPatch::nearest(object, place, RADIUS, NEAREST));
    let both = near.zip(0..).flat_map(|(near, a)| {
        let pairs = near.into_iter().map(move |b| (a, first as u32 + b));
        pairs.flat_map(|(a, b)| [(a, b), (b, a)])
    });
    let mut pairs: Vec<_> = both.collect();
    pairs.sort_unstable();
    pairs
}

impl Links {
    pub(super) fn new(edges: Edges, features: Tensor) -> Self {
        let rows: Vec<Vec<_>> = edges
            .starts
            .windows(2)
            .map(|pair| (pair[0]..pair[1]).map(|e| (e, 1.0)).collect())
            .collect();
        let sums = Arc::new(Sparse::new(&rows, edges.senders.len()));
        Self { edges: Arc::new(edges), features, sums }
    }

    /// Edges between sorted pairs of receiver and sender among `nodes` nodes.
    fn between(
        pairs: &[(u32, u32)],
        nodes: usize,
        features: impl Fn(u32, u32) -> Vec<f64>,
    ) -> Result<Self> {
        let starts = (0..=nodes as u32).map(|i| pairs.partition_point(|(r, _)| *r < i) as u32);
        let edges =
            Edges { senders: pairs.iter().map(|pair| pair.1).collect(), starts: starts.collect() };
        let numbers: Vec<f32> =
            pairs.iter().flat_map(|&(a, b)| features(a, b)).map(|x| x as f32).collect();
        let shape = (pairs.len(), numbers.len() / pairs.len().max(1));
        Ok(Self::new(edges, Tensor::from_vec(numbers, shape, &Device::Cpu)?))
    }
}
