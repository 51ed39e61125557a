//! The face cut into finer triangles, whose corners follow the nodes of the mesh smoothly.
//!
//! The motion of a fine node is that of a quadratic in the plan, fitted to the nodes around it by
//! moving least squares with Gaussian weights (Lancaster & Salkauskas, Math. Comp. 37, 141, 1981).
//! Motion that is quadratic is reproduced; facets and noise from node to node are smoothed.
//!
//! Shapes: V nodes of the mesh, T triangles of the face, Q fine nodes.

use std::collections::BTreeMap;

use nalgebra::{Matrix6, Point3, Vector2, Vector3, Vector6};

use super::face::{Face, FacePoint};

/// Standard deviation of the Gaussian, in spacings of the nodes. The rim of a pressed ball is as
/// round with 1 and less with 0.6.
const WIDTH: f64 = 0.8;
/// Distance at which the Gaussian is cut off, in standard deviations.
const CUT: f64 = 3.0;
/// Largest sum of magnitudes of the weights of a fine node; one-sided fits have more.
const MOST_WEIGHT: f64 = 3.0;
/// Most parts into which an edge is cut.
const MOST_PARTS: f64 = 8.0;

/// Face of a pad at rest, cut finer.
#[derive(Debug)]
pub(super) struct SmoothFace {
    /// Parts into which each edge is cut.
    parts: usize,
    /// Fine nodes (Q).
    nodes: Vec<FineNode>,
    /// Corners of the fine triangles, `parts`² for each triangle of the face (T).
    triangles: Vec<[u32; 3]>,
    /// Area of the face in the plan around each node (V) in m², 0 away from the face.
    pub(super) areas: Vec<f64>,
    /// Spacing of the nodes: square root of their mean area (m).
    pub(super) spacing: f64,
    /// Nodes on the border of the face (V).
    pub(super) is_border: Vec<bool>,
}

/// Corner of fine triangles.
#[derive(Debug)]
struct FineNode {
    /// Triangle of the face that it is on, with its place there.
    at: FacePoint,
    /// Position at rest (m).
    place: Point3<f64>,
    /// Height of the outline over it at rest (m).
    rise: f64,
    /// Nodes around it, with the weights of their motion.
    weights: Vec<(u32, f64)>,
}

impl SmoothFace {
    /// Cuts `face` into triangles with edges of about `edge` (m).
    pub(super) fn new(face: &Face, edge: f64) -> Self {
        let areas = areas(face);
        let on_face = areas.iter().filter(|area| **area > 0.0);
        let spacing = (on_face.clone().sum::<f64>() / on_face.count() as f64).sqrt();
        let parts = (spacing / edge).round().clamp(1.0, MOST_PARTS) as usize;
        let (points, triangles) = cut(face, parts);
        let neighbours = Neighbours::new(face, &areas, WIDTH * spacing);
        let nodes = points.into_iter().map(|at| FineNode::new(face, at, &neighbours)).collect();
        let is_border = border(face);
        Self { parts, nodes, triangles, areas, spacing, is_border }
    }

    /// Numbers of the fine triangles of a triangle of the face.
    pub(super) fn fine(&self, triangle: usize) -> &[[u32; 3]] {
        let count = self.parts * self.parts;
        &self.triangles[triangle * count..(triangle + 1) * count]
    }

    /// Number of fine nodes (Q).
    pub(super) fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Place (m) of a fine node under `motion` of the nodes (V) in m, and its share of the smooth
    /// surface, which is interpolated from `shares` at the nodes (V); the rest is flat triangles.
    pub(super) fn place(
        &self,
        node: u32,
        motion: &[Vector3<f64>],
        shares: &[f64],
    ) -> (Point3<f64>, f64) {
        let FineNode { at: (corners, weights), place, rise, weights: around } =
            &self.nodes[node as usize];
        let corners = || corners.iter().zip(weights).filter(|(_, weight)| **weight != 0.0);
        let share: f64 = corners().map(|(&node, weight)| shares[node as usize] * weight).sum();
        let flat = || corners().map(|(&node, weight)| motion[node as usize] * *weight);
        let smooth = || around.iter().map(|&(node, weight)| motion[node as usize] * weight);
        let moved = match share {
            1.0 => smooth().sum::<Vector3<f64>>(),
            0.0 => flat().sum(),
            _ => {
                (1.0 - share) * flat().sum::<Vector3<f64>>() + share * smooth().sum::<Vector3<_>>()
            }
        };
        (place + moved + share * rise * Vector3::z(), share)
    }
}

impl FineNode {
    /// Prepares the fine node `at` a point of the face.
    fn new(face: &Face, at: FacePoint, neighbours: &Neighbours) -> Self {
        let corners = at.0.iter().zip(&at.1);
        let place: Vector3<f64> =
            corners.clone().map(|(&node, share)| face.places[node as usize].coords * *share).sum();
        let flat = || corners.map(|(&node, share)| (node, *share)).collect();
        let weights = neighbours.weights(face, place.xy()).unwrap_or_else(flat);
        let rise = face.outline.height(place.x, place.y) - place.z;
        Self { at, place: place.into(), rise, weights }
    }
}

/// Nodes of the face by squares of the plan.
struct Neighbours<'a> {
    areas: &'a [f64],
    /// Standard deviation of the Gaussian (m).
    width: f64,
    squares: BTreeMap<[i64; 2], Vec<u32>>,
}

impl<'a> Neighbours<'a> {
    fn new(face: &Face, areas: &'a [f64], width: f64) -> Self {
        let mut found = Self { areas, width, squares: BTreeMap::new() };
        for node in (0..areas.len() as u32).filter(|&node| areas[node as usize] > 0.0) {
            let square = found.square(face.places[node as usize].coords.xy());
            found.squares.entry(square).or_default().push(node);
        }
        found
    }

    fn square(&self, place: Vector2<f64>) -> [i64; 2] {
        [place.x, place.y].map(|p| (p / (CUT * self.width)).floor() as i64)
    }

    /// Nodes around `place` with their weights in a quadratic fitted there; `None` where they do
    /// not determine one well.
    fn weights(&self, face: &Face, place: Vector2<f64>) -> Option<Vec<(u32, f64)>> {
        let [i, j] = self.square(place);
        let squares = (-1..=1).flat_map(|di| (-1..=1).map(move |dj| [i + di, j + dj]));
        let nodes = squares.filter_map(|square| self.squares.get(&square)).flatten();
        let mut moments = Matrix6::zeros();
        let mut terms = Vec::new();
        for &node in nodes {
            let d = (face.places[node as usize].coords.xy() - place) / self.width;
            if d.norm() < CUT {
                let weight = self.areas[node as usize] * (-0.5 * d.norm_squared()).exp();
                let powers = Vector6::new(1.0, d.x, d.y, d.x * d.x, d.x * d.y, d.y * d.y);
                moments += weight * powers * powers.transpose();
                terms.push((node, weight * powers));
            }
        }
        let fit = moments.cholesky()?.solve(&Vector6::ith(0, 1.0));
        let weights: Vec<_> = terms.iter().map(|(node, term)| (*node, fit.dot(term))).collect();
        let magnitude: f64 = weights.iter().map(|(_, weight)| weight.abs()).sum();
        (magnitude < MOST_WEIGHT).then_some(weights)
    }
}

/// Area of the face in the plan around each node (V) in m²: a third of that of its triangles.
fn areas(face: &Face) -> Vec<f64> {
    let mut areas = vec![0.0; face.places.len()];
    for triangle in &face.triangles {
        let [a, b, c] = triangle.map(|node| face.places[node as usize].coords.xy());
        let area = 0.5 * (b - a).perp(&(c - a)).abs();
        for &node in triangle {
            areas[node as usize] += area / 3.0;
        }
    }
    areas
}

/// Nodes on the border of the face (V): ends of edges of one triangle.
fn border(face: &Face) -> Vec<bool> {
    let mut edges: BTreeMap<[u32; 2], usize> = BTreeMap::new();
    for &[a, b, c] in &face.triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            *edges.entry([from.min(to), from.max(to)]).or_default() += 1;
        }
    }
    let mut border = vec![false; face.places.len()];
    for node in edges.into_iter().filter(|(_, count)| *count == 1).flat_map(|(edge, _)| edge) {
        border[node as usize] = true;
    }
    border
}

/// Cuts each edge of the face into `parts`; returns the points and the triangles between them, in
/// the order of the face's triangles.
fn cut(face: &Face, parts: usize) -> (Vec<FacePoint>, Vec<[u32; 3]>) {
    let mut points = Vec::new();
    let mut known = BTreeMap::new();
    let mut triangles = Vec::with_capacity(face.triangles.len() * parts * parts);
    for corners in &face.triangles {
        let mut number = |i: usize, j: usize| {
            let counts = [parts - i - j, i, j];
            let mut key: Vec<_> = corners.iter().zip(counts).filter(|(_, n)| *n > 0).collect();
            key.sort_unstable();
            *known.entry(key).or_insert_with(|| {
                points.push((*corners, counts.map(|n| n as f64 / parts as f64)));
                points.len() as u32 - 1
            })
        };
        for i in 0..parts {
            for j in 0..parts - i {
                let [a, b, c] = [number(i, j), number(i + 1, j), number(i, j + 1)];
                triangles.push([a, b, c]);
                if i + j + 1 < parts {
                    triangles.push([b, number(i + 1, j + 1), c]);
                }
            }
        }
    }
    (points, triangles)
}
