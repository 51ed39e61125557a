//! A soft object's mesh as a graph of three scales.
//!
//! Edges of the finest scale are those of the tetrahedra. Coarser scales keep nodes far from each
//! other. Each of these receives messages from the nearest others, and values are interpolated to
//! the finer scale by weights that fall with the squared distance. Lengths are in units of the cube
//! root of the object's volume.
//!
//! Shapes: V nodes, T tetrahedra, E directed edges of a scale.

use std::{collections::BTreeSet, sync::Arc};

use nalgebra::{Matrix3, Point3, Vector3};

use crate::{
    geometry::{TetMesh, vertex_normals},
    surrogate::{
        graph::{Level, SCALES},
        ops::{Edges, ShapeGradients, Sparse},
    },
};

/// Number of nodes of a scale for each of the next coarser one.
const COARSER: usize = 5;
/// Number of nodes from which one of a coarse scale receives messages.
const HEARD: usize = 12;
/// Number of coarse nodes that a fine one is interpolated from.
const JOINED: usize = 4;

/// Data shared by all presses of one object.
pub(super) struct ObjectGraph {
    /// Unit of length (m).
    pub(super) length: f64,
    /// Places at rest (V) in m.
    pub(super) places: Vec<Point3<f64>>,
    /// Outward normals of the surface, of unit length, zero inside (V).
    pub(super) normals: Vec<Vector3<f64>>,
    /// Scales from fine to coarse.
    pub(super) levels: [Level; SCALES],
    /// Vectors along the edges of each scale (E).
    offsets: [Vec<Vector3<f64>>; SCALES],
    /// Operator from displacement to stress.
    pub(super) gradients: Arc<ShapeGradients>,
    /// Matrix that sums over the corners of each tetrahedron (T, V).
    pub(super) corners: Arc<Sparse>,
}

impl ObjectGraph {
    pub(super) fn new(mesh: &TetMesh) -> Self {
        let (length, count) = (mesh.volume().cbrt(), mesh.vertices.len());
        let mut places: Vec<_> = mesh.vertices.iter().map(|p| p.coords / length).collect();
        let mut pairs = BTreeSet::new();
        for [a, b] in mesh.edges() {
            pairs.extend([(a, b), (b, a)]);
        }
        let mut scale = |level: usize| {
            let here = if level == 0 { std::mem::take(&mut pairs) } else { heard(&places) };
            let (edges, offsets) = edges(&here, &places);
            let links = (level + 1 < SCALES).then(|| {
                let coarse = spread_out(&places, places.len().div_ceil(COARSER));
                let up = interpolation(&places, &coarse);
                let down = up.pooling();
                places = coarse;
                [Arc::new(up), Arc::new(down)]
            });
            (Level { edges: Arc::new(edges), links }, offsets)
        };
        let [fine, middle, coarse] = [scale(0), scale(1), scale(2)];
        let corner = |tet: &[u32; 4]| tet.iter().map(|&node| (node, 1.0)).collect();
        let corners: Vec<Vec<_>> = mesh.tets.iter().map(corner).collect();
        Self {
            length,
            levels: [fine.0, middle.0, coarse.0],
            offsets: [fine.1, middle.1, coarse.1],
            places: mesh.vertices.clone(),
            normals: vertex_normals(&mesh.vertices, &mesh.boundary()),
            gradients: Arc::new(ShapeGradients::new(mesh, length)),
            corners: Arc::new(Sparse::new(&corners, count)),
        }
    }
}

impl ObjectGraph {
    /// Features of the edges of a scale (E, 4) in a frame, given by the rotation `turn` to it.
    pub(super) fn edges(&self, scale: usize, turn: &Matrix3<f64>) -> Vec<f32> {
        let row = |offset: &Vector3<f64>| {
            let seen = turn * offset;
            [seen.x, seen.y, seen.z, offset.norm()].map(|x| x as f32)
        };
        self.offsets[scale].iter().flat_map(row).collect()
    }
}

/// Edges between sorted pairs of receiver and sender, and the vectors along them.
fn edges(pairs: &BTreeSet<(u32, u32)>, places: &[Vector3<f64>]) -> (Edges, Vec<Vector3<f64>>) {
    let mut starts = vec![0; places.len() + 1];
    for &(receiver, _) in pairs {
        starts[receiver as usize + 1] += 1;
    }
    for i in 0..places.len() {
        starts[i + 1] += starts[i];
    }
    let offset = |&(r, s): &(u32, u32)| places[r as usize] - places[s as usize];
    let senders = pairs.iter().map(|pair| pair.1).collect();
    (Edges { senders, starts }, pairs.iter().map(offset).collect())
}

/// Pairs of receiver and sender: every node with the nearest others.
fn heard(places: &[Vector3<f64>]) -> BTreeSet<(u32, u32)> {
    let of = |(i, place): (usize, &Vector3<f64>)| {
        let near = nearest(places, place, HEARD + 1).into_iter().filter(move |&j| j != i as u32);
        near.map(move |j| (i as u32, j)).collect::<Vec<_>>()
    };
    places.iter().enumerate().flat_map(of).collect()
}

/// Numbers of the `count` places nearest to `place`, the nearest first.
fn nearest(places: &[Vector3<f64>], place: &Vector3<f64>, count: usize) -> Vec<u32> {
    let mut order: Vec<u32> = (0..places.len() as u32).collect();
    let distance = |&i: &u32| (places[i as usize] - place).norm_squared();
    order.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    order.truncate(count);
    order
}

/// `count` of the places, each as far as possible from those before it.
fn spread_out(places: &[Vector3<f64>], count: usize) -> Vec<Vector3<f64>> {
    let mut gaps = vec![f64::INFINITY; places.len()];
    let mut chosen = Vec::with_capacity(count);
    let mut next = 0;
    while chosen.len() < count {
        chosen.push(places[next]);
        for (gap, place) in gaps.iter_mut().zip(places) {
            *gap = gap.min((place - places[next]).norm_squared());
        }
        next = (0..places.len()).max_by(|&a, &b| gaps[a].total_cmp(&gaps[b])).unwrap_or_default();
    }
    chosen
}

/// Matrix of interpolation from `coarse` places to `fine` ones, by weights that fall with the
/// squared distance.
fn interpolation(fine: &[Vector3<f64>], coarse: &[Vector3<f64>]) -> Sparse {
    let row = |place: &Vector3<f64>| {
        let near = nearest(coarse, place, JOINED);
        let weight = |&i: &u32| 1.0 / ((coarse[i as usize] - place).norm_squared() + 1e-6);
        let all: f64 = near.iter().map(weight).sum();
        near.iter().map(|i| (*i, (weight(i) / all) as f32)).collect()
    };
    let rows: Vec<Vec<_>> = fine.iter().map(row).collect();
    Sparse::new(&rows, coarse.len())
}
