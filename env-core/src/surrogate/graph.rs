//! A pad as a graph: columns of nodes, three scales, tetrahedra.
//!
//! A pad's nodes lie in layers with the same layout (`PadMesh`), so each node of the face
//! represents the column under it. Columns are joined to their eight neighbours in the grid;
//! coarser scales have half as many columns a side and are linked to the finer one by bilinear
//! interpolation. Lengths are in units of the pad's thickness.
//!
//! Shapes: C columns, K free layers of nodes and a fixed one, V = C (K + 1) nodes, T tetrahedra, E
//! directed edges of a scale.

use std::sync::Arc;

use candle_core::{Device, Tensor};

use super::ops::{Edges, ShapeGradients, Sparse};
use crate::{Error, Result, geometry::PadMesh};

/// Number of free layers of nodes that the network requires.
pub(super) const LAYERS: usize = 3;
/// Number of scales.
pub(super) const SCALES: usize = 3;
/// Number of features of an edge: vector from sender to receiver, and its length.
pub(super) const EDGE_FEATURES: usize = 4;
/// Number of features of a column at rest.
pub(super) const PLACE_FEATURES: usize = 4;

/// One scale of a graph.
#[derive(Clone, Debug)]
pub(super) struct Level {
    pub(super) edges: Arc<Edges>,
    /// Interpolation from the next coarser scale to this one, and pooling back; `None` at the
    /// coarsest.
    pub(super) links: Option<[Arc<Sparse>; 2]>,
}

/// Data shared by all presses on one pad mesh.
#[derive(Clone, Debug)]
pub(super) struct PadGraph {
    /// Number of columns.
    pub(super) columns: usize,
    /// Columns of the grid along x and y.
    grid: [usize; 2],
    /// Positions of the columns along x and y (m), those of the rows of the grid.
    rows: [Vec<f64>; 2],
    /// Scales from fine to coarse.
    pub(super) levels: [Level; SCALES],
    /// Features of the edges of each scale (E, EDGE_FEATURES).
    pub(super) edges: [Tensor; SCALES],
    /// Position of each column: x and y over the half-extents, height of the face, distance to the
    /// nearest side (C, PLACE_FEATURES).
    pub(super) places: Vec<f32>,
    /// Operator from displacement to stress.
    pub(super) gradients: Arc<ShapeGradients>,
    /// Matrix that sums over the corners of each tetrahedron (T, V); its columns are ordered by
    /// column of nodes, then layer.
    pub(super) corners: Arc<Sparse>,
    /// Symmetries of the pad: identity, mirrored in x, in y, in both.
    pub(super) mirrors: [Mirror; 4],
}

/// A symmetry of the pad: image of each column and tetrahedron, and signs of the axes.
#[derive(Clone, Debug)]
pub(super) struct Mirror {
    pub(super) columns: Vec<u32>,
    pub(super) tets: Vec<u32>,
    pub(super) signs: [f32; 3],
}

impl PadGraph {
    /// Builds the graph of a pad mesh of `LAYERS` free layers; other meshes are an error.
    pub(super) fn new(pad: &PadMesh) -> Result<Self> {
        let [across, along, layers] = pad.cells.map(|cells| cells as usize + 1);
        if layers != LAYERS + 1 {
            let expected = format!(
                "a mesh of {} layers of nodes, as fewer or more `model_nodes` give",
                LAYERS + 1
            );
            return Err(Error::invalid("pad mesh", format!("{layers} layers"), expected));
        }
        let vertices = &pad.mesh.vertices;
        let thickness = pad.thickness();
        let faces: Vec<[f64; 3]> =
            pad.face.iter().map(|&i| (vertices[i as usize].coords / thickness).into()).collect();
        let (mut size, mut places) = ([across, along], faces.clone());
        let mut scale = |scale: usize| -> Result<(Level, Tensor)> {
            let coarse = size.map(|n| n.div_ceil(2));
            let links = (scale + 1 < SCALES).then(|| {
                let up = interpolation(size, coarse);
                let down = up.pooling();
                [Arc::new(up), Arc::new(down)]
            });
            let (edges, features) = neighbours(size, &places);
            if let Some([_, down]) = &links {
                places = pooled(down, &places);
            }
            size = coarse;
            let shape = (features.len() / EDGE_FEATURES, EDGE_FEATURES);
            let features = Tensor::from_vec(features, shape, &Device::Cpu)?;
            Ok((Level { edges: Arc::new(edges), links }, features))
        };
        let [fine, middle, coarse] = [scale(0)?, scale(1)?, scale(2)?];
        let columns = across * along;
        let corner = |&node: &u32| {
            let (layer, column) = (node as usize / columns, node as usize % columns);
            ((column * layers + layer) as u32, 1.0)
        };
        let corners: Vec<Vec<_>> =
            pad.mesh.tets.iter().map(|tet| tet.iter().map(corner).collect()).collect();
        let row = |step: usize, count: usize, axis: usize| {
            (0..count).map(|i| vertices[pad.face[i * step] as usize][axis]).collect()
        };
        Ok(Self {
            columns,
            grid: [across, along],
            rows: [row(1, across, 0), row(across, along, 1)],
            levels: [fine.0, middle.0, coarse.0],
            edges: [fine.1, middle.1, coarse.1],
            places: place_features(&faces),
            gradients: Arc::new(ShapeGradients::new(&pad.mesh, thickness)),
            corners: Arc::new(Sparse::new(&corners, vertices.len())),
            mirrors: [[false, false], [true, false], [false, true], [true, true]]
                .map(|flips| Mirror::new(pad, flips)),
        })
    }

    /// Derivatives along x and y of a field on the columns, by differences between neighbours (C).
    pub(super) fn slopes(&self, field: impl Fn(usize) -> f64) -> Vec<[f64; 2]> {
        let [across, _] = self.grid;
        let slope = |column: usize, axis: usize| {
            let (step, rows) = ([1, across][axis], &self.rows[axis]);
            let i = column / step % rows.len();
            let [before, after] = [i.saturating_sub(1), (i + 1).min(rows.len() - 1)];
            let at = |row: usize| field(column + row * step - i * step);
            (at(after) - at(before)) / (rows[after] - rows[before])
        };
        (0..self.columns).map(|column| [slope(column, 0), slope(column, 1)]).collect()
    }

    /// Number of tetrahedra.
    pub(super) fn tets(&self) -> usize {
        self.corners.height()
    }
}

/// Matrix of bilinear interpolation from a `coarse` grid over the same area, x fastest.
fn interpolation(fine: [usize; 2], coarse: [usize; 2]) -> Sparse {
    let along = |axis: usize, i: usize| {
        let place = (i * (coarse[axis] - 1)) as f32 / (fine[axis] - 1).max(1) as f32;
        let low = (place as usize).min(coarse[axis].saturating_sub(2));
        let share = place - low as f32;
        [(low, 1.0 - share), (low + 1, share)]
    };
    let row = |column: usize| {
        let (x, y) = (along(0, column % fine[0]), along(1, column / fine[0]));
        let pairs =
            y.iter().flat_map(|&(j, b)| x.map(|(i, a)| ((j * coarse[0] + i) as u32, a * b)));
        pairs.filter(|(_, share)| *share > 0.0).collect()
    };
    let rows: Vec<Vec<_>> = (0..fine[0] * fine[1]).map(row).collect();
    Sparse::new(&rows, coarse[0] * coarse[1])
}

/// Edges between each column and the eight around it, with their features.
fn neighbours(size: [usize; 2], places: &[[f64; 3]]) -> (Edges, Vec<f32>) {
    let (mut senders, mut starts, mut features) = (Vec::new(), vec![0], Vec::new());
    for (receiver, place) in places.iter().enumerate() {
        let (i, j) = (receiver % size[0], receiver / size[0]);
        for y in j.saturating_sub(1)..(j + 2).min(size[1]) {
            for x in i.saturating_sub(1)..(i + 2).min(size[0]) {
                let sender = y * size[0] + x;
                if sender == receiver {
                    continue;
                }
                senders.push(sender as u32);
                let offset: [f64; 3] =
                    std::array::from_fn(|axis| place[axis] - places[sender][axis]);
                let length = offset.iter().map(|x| x * x).sum::<f64>().sqrt();
                features.extend(offset.iter().chain([&length]).map(|&x| x as f32));
            }
        }
        starts.push(senders.len() as u32);
    }
    (Edges { senders, starts }, features)
}

fn pooled(pooling: &Sparse, places: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let flat: Vec<f32> = places.iter().flatten().map(|&x| x as f32).collect();
    let mut sums = vec![0.0; 3 * pooling.height()];
    pooling.add_product(&flat, &mut sums, 3);
    sums.as_chunks::<3>().0.iter().map(|place| place.map(f64::from)).collect()
}

fn place_features(faces: &[[f64; 3]]) -> Vec<f32> {
    let half = |axis: usize| faces.iter().map(|p| p[axis]).fold(0.0, f64::max);
    let (a, b) = (half(0), half(1));
    let describe = |&[x, y, z]: &[f64; 3]| {
        let side = (a - x.abs()).min(b - y.abs()).min(1.0);
        [x / a, y / b, z, side].map(|x| x as f32)
    };
    faces.iter().flat_map(describe).collect()
}

impl Mirror {
    fn new(pad: &PadMesh, flips: [bool; 2]) -> Self {
        let cells = pad.cells.map(|cells| cells as usize);
        let flipped = |flip: bool, i: usize, count: usize| if flip { count - 1 - i } else { i };
        let [nx, ny] = [cells[0] + 1, cells[1] + 1];
        let column = |c: usize| {
            let (i, j) = (flipped(flips[0], c % nx, nx), flipped(flips[1], c / nx, ny));
            (j * nx + i) as u32
        };
        let columns: Vec<u32> = (0..nx * ny).map(column).collect();
        let moved = |node: u32| {
            let (layer, c) = (node as usize / (nx * ny), node as usize % (nx * ny));
            (layer * nx * ny) as u32 + columns[c]
        };
        let tet = |t: usize| {
            let cell = t / 6;
            let (i, j) = (cell % cells[0], cell / cells[0] % cells[1]);
            let (i, j) = (flipped(flips[0], i, cells[0]), flipped(flips[1], j, cells[1]));
            let there = (cell / (cells[0] * cells[1]) * cells[1] + j) * cells[0] + i;
            let sorted = |tet: &[u32; 4], map: &dyn Fn(u32) -> u32| {
                let mut corners = tet.map(map);
                corners.sort_unstable();
                corners
            };
            let image = sorted(&pad.mesh.tets[t], &moved);
            let twins = (6 * there..6 * there + 6).map(|t| sorted(&pad.mesh.tets[t], &|i| i));
            let twin = twins.clone().position(|twin| twin == image);
            (6 * there + twin.expect("pad meshes are mirrored about their middle")) as u32
        };
        let tets = (0..pad.mesh.tets.len()).map(tet).collect();
        let sign = |flip| if flip { -1.0 } else { 1.0 };
        Self { columns, tets, signs: [sign(flips[0]), sign(flips[1]), 1.0] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::Sensor;

    #[test]
    fn mirrors_map_every_node_onto_its_image() {
        for name in Sensor::names() {
            let pad = Sensor::named(name).unwrap().pad(1000).unwrap();
            let graph = PadGraph::new(&pad).unwrap();
            for mirror in &graph.mirrors {
                for (column, &image) in mirror.columns.iter().enumerate() {
                    let (p, q) = (pad.mesh.vertices[column], pad.mesh.vertices[image as usize]);
                    let [x, y, z] = mirror.signs.map(f64::from);
                    let moved = nalgebra::Point3::new(x * p.x, y * p.y, z * p.z);
                    assert!((moved - q).norm() < 1e-12, "{name}: {moved} for {q}");
                }
                let mut tets = mirror.tets.clone();
                tets.sort_unstable();
                assert!(tets.iter().enumerate().all(|(i, &t)| i == t as usize), "{name}");
            }
        }
    }

    #[test]
    fn slopes_of_a_linear_field_are_its_own() {
        for name in Sensor::names() {
            let pad = Sensor::named(name).unwrap().pad(1000).unwrap();
            let graph = PadGraph::new(&pad).unwrap();
            let place = |column: usize| pad.mesh.vertices[pad.face[column] as usize];
            let slopes = graph.slopes(|column| 2.0 * place(column).x - 3.0 * place(column).y);
            let off = |[x, y]: &[f64; 2]| (x - 2.0).abs().max((y + 3.0).abs());
            assert!(slopes.len() == graph.columns && slopes.iter().all(|s| off(s) < 1e-9));
        }
    }

    #[test]
    fn interpolation_reproduces_linear_fields() {
        let matrix = interpolation([15, 7], [8, 4]);
        let field = |n: usize, m: usize| -> Vec<f32> {
            let at =
                |c: usize| (c % n) as f32 / (n - 1) as f32 + 2.0 * (c / n) as f32 / (m - 1) as f32;
            (0..n * m).map(at).collect()
        };
        let mut fine = vec![0.0; 15 * 7];
        matrix.add_product(&field(8, 4), &mut fine, 1);
        let pairs = fine.iter().zip(field(15, 7));
        assert!(pairs.clone().all(|(a, b)| (a - b).abs() < 1e-5));
    }

    #[test]
    fn other_layers_are_refused() {
        let pad = Sensor::named("gelsight-mini").unwrap().pad(3000).unwrap();
        assert!(PadGraph::new(&pad).unwrap_err().to_string().contains("expected a mesh of 4"));
    }
}
