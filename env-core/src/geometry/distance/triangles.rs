//! Nearest point on a triangle surface, found with a tree of bounding boxes.
//!
//! The sign comes from the angle-weighted normal of the nearest face, edge or vertex (Bærentzen and
//! Aanæs, "Signed distance computation using the angle weighted pseudonormal", 2005): correct at
//! every point for a watertight surface. Everything is f64 and no tolerance is absolute.

use std::collections::HashMap;

use nalgebra::{Point3, Similarity3, Vector3};

use super::Distance;

/// Triangles in a leaf of the tree, at most.
const LEAF: usize = 4;
/// Depth of the traversal's stack. Every level halves a count that fits 32 bits.
const DEPTH: usize = 64;

/// A watertight triangle surface prepared for distance and ray queries.
#[derive(Clone, Debug)]
pub(in crate::geometry) struct TriangleTree {
    nodes: Vec<Node>,
    triangles: Vec<Triangle>,
    normals: Vec<Normals>,
}

/// A box, and below it either two nodes or a run of triangles.
#[derive(Clone, Debug)]
struct Node {
    low: Vector3<f64>,
    high: Vector3<f64>,
    /// First triangle of a leaf, or the second child; the first child follows its parent.
    first: u32,
    /// Triangles of a leaf, 0 for an inner node.
    count: u32,
}

#[derive(Clone, Debug)]
struct Triangle {
    origin: Vector3<f64>,
    /// The other corners, from the origin.
    sides: [Vector3<f64>; 2],
}

/// Outward normals of one triangle, its edges (opposite to corner i) and its corners.
#[derive(Clone, Debug)]
struct Normals {
    face: Vector3<f64>,
    edges: [Vector3<f64>; 3],
    corners: [Vector3<f64>; 3],
}

/// The part of a triangle that is nearest to a point.
#[derive(Clone, Copy)]
enum Feature {
    Face,
    /// The edge opposite to a corner.
    Edge(usize),
    Corner(usize),
}

impl TriangleTree {
    pub(in crate::geometry) fn new(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Self {
        let corners = |t: &[u32; 3]| t.map(|i| vertices[i as usize].coords);
        let mut order: Vec<usize> = (0..triangles.len()).collect();
        let boxes: Vec<_> = triangles
            .iter()
            .map(|t| {
                let [a, b, c] = corners(t);
                (a.inf(&b).inf(&c), a.sup(&b).sup(&c))
            })
            .collect();
        let mut nodes = Vec::with_capacity(2 * triangles.len() / LEAF + 1);
        build(&mut nodes, &boxes, &mut order, 0);
        let normals = normals(vertices, triangles);
        Self {
            nodes,
            triangles: order
                .iter()
                .map(|&t| {
                    let [a, b, c] = corners(&triangles[t]);
                    Triangle { origin: a, sides: [b - a, c - a] }
                })
                .collect(),
            normals: order.iter().map(|&t| normals[t].clone()).collect(),
        }
    }

    /// Signed distance to the surface and its gradient.
    pub(in crate::geometry) fn distance(&self, point: &Point3<f64>) -> Distance {
        let (triangle, offset, feature) = self.nearest(&point.coords);
        let normals = &self.normals[triangle];
        match feature {
            Feature::Face => Distance { value: normals.face.dot(&offset), normal: normals.face },
            Feature::Edge(i) => Distance::from_edge(&offset, &normals.edges[i]),
            Feature::Corner(i) => Distance::from_edge(&offset, &normals.corners[i]),
        }
    }

    /// Nearest triangle, vector from its nearest point to `p`, and the feature on which that point
    /// lies.
    fn nearest(&self, p: &Vector3<f64>) -> (usize, Vector3<f64>, Feature) {
        let mut best = (0, Vector3::zeros(), Feature::Face);
        let mut squared = f64::INFINITY;
        let mut stack = [(0u32, 0.0); DEPTH];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (index, bound) = stack[height];
            if bound >= squared {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count > 0 {
                let first = node.first as usize;
                for t in first..first + node.count as usize {
                    let (offset, feature) = self.triangles[t].nearest(p);
                    let d = offset.norm_squared();
                    if d < squared {
                        (best, squared) = ((t, offset, feature), d);
                    }
                }
                continue;
            }
            let children = [index + 1, node.first].map(|i| (i, self.nodes[i as usize].bound(p)));
            let [near, far] = if children[0].1 <= children[1].1 { [0, 1] } else { [1, 0] };
            stack[height] = children[far];
            stack[height + 1] = children[near];
            height += 2;
        }
        best
    }

    /// Corners of the triangles, at least those that meet the box between the corners `within` once
    /// `place` enlarges and places them; before that is done.
    pub(super) fn near(
        &self,
        place: &Similarity3<f64>,
        [low, high]: &[Point3<f64>; 2],
    ) -> Vec<[Point3<f64>; 3]> {
        let meets = |least: &Point3<f64>, most: &Point3<f64>| {
            (0..3).all(|i| least[i] <= high[i] && most[i] >= low[i])
        };
        // Takes half of a box to half of the one about it once it is placed.
        let widened = place.scaling() * place.isometry.rotation.to_rotation_matrix().matrix().abs();
        let mut found = Vec::new();
        let mut stack = vec![0];
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index as usize];
            let middle = place * Point3::from(0.5 * (node.low + node.high));
            let half = widened * (0.5 * (node.high - node.low));
            if !meets(&(middle - half), &(middle + half)) {
                continue;
            }
            if node.count == 0 {
                stack.extend([node.first, index + 1]);
                continue;
            }
            let first = node.first as usize;
            let triangles = &self.triangles[first..first + node.count as usize];
            found.extend(triangles.iter().map(Triangle::corners).filter(|corners| {
                let [a, b, c] = corners.map(|corner| place * corner);
                meets(&a.inf(&b).inf(&c), &a.sup(&b).sup(&c))
            }));
        }
        found
    }

    /// First intersection of a ray with the surface: the distance along the ray (m), and `true` if
    /// the ray enters there.
    pub(super) fn first_hit(
        &self,
        origin: &Point3<f64>,
        direction: &Vector3<f64>,
    ) -> Option<(f64, bool)> {
        let inverse = direction.map(|x| 1.0 / x);
        let mut best: Option<(f64, bool)> = None;
        let mut stack = [0u32; DEPTH];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let index = stack[height];
            let node = &self.nodes[index as usize];
            let farthest = best.map_or(f64::INFINITY, |b| b.0);
            if !node.is_met(&origin.coords, &inverse, farthest) {
                continue;
            }
            if node.count == 0 {
                stack[height] = node.first;
                stack[height + 1] = index + 1;
                height += 2;
                continue;
            }
            let first = node.first as usize;
            for triangle in &self.triangles[first..first + node.count as usize] {
                let hit = triangle.hit(&origin.coords, direction);
                if let Some(s) = hit.filter(|&s| best.is_none_or(|b| s < b.0)) {
                    let normal = triangle.sides[0].cross(&triangle.sides[1]);
                    best = Some((s, normal.dot(direction) < 0.0));
                }
            }
        }
        best
    }
}

impl Node {
    /// Squared distance from `p` to the box.
    fn bound(&self, p: &Vector3<f64>) -> f64 {
        let outside = (self.low - p).sup(&(p - self.high)).sup(&Vector3::zeros());
        outside.norm_squared()
    }

    /// Returns whether a ray meets the box before `farthest`. `inverse` holds the reciprocals of
    /// its direction, which may be infinite.
    fn is_met(&self, origin: &Vector3<f64>, inverse: &Vector3<f64>, farthest: f64) -> bool {
        let (mut enter, mut leave) = (0f64, farthest);
        for i in 0..3 {
            let a = (self.low[i] - origin[i]) * inverse[i];
            let b = (self.high[i] - origin[i]) * inverse[i];
            // f64::min and max drop the NaN of an origin on a face that the ray runs along.
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        enter <= leave
    }
}

impl Triangle {
    fn corners(&self) -> [Point3<f64>; 3] {
        let [u, v] = self.sides;
        [self.origin, self.origin + u, self.origin + v].map(Point3::from)
    }

    /// Vector from the nearest point of the triangle to `p`, and the feature on which that point
    /// lies.
    fn nearest(&self, p: &Vector3<f64>) -> (Vector3<f64>, Feature) {
        let [u, v] = &self.sides;
        let q = p - self.origin;
        let (uu, uv, vv) = (u.norm_squared(), u.dot(v), v.norm_squared());
        let (qu, qv) = (q.dot(u), q.dot(v));
        // Barycentric coordinates of the foot on the plane, times the determinant.
        let determinant = uu * vv - uv * uv;
        let (b, c) = (vv * qu - uv * qv, uu * qv - uv * qu);
        let a = determinant - b - c;
        if a >= 0.0 && b >= 0.0 && c >= 0.0 && determinant > 0.0 {
            return (q - (b * u + c * v) / determinant, Feature::Face);
        }
        // Outside: the nearest of the three edges.
        let edges = [(*u, v - u), (*v, -v), (Vector3::zeros(), *u)];
        let mut best = (q, Feature::Corner(0));
        let mut squared = f64::INFINITY;
        for (i, (start, along)) in edges.iter().enumerate() {
            let t = (q - start).dot(along);
            let length = along.norm_squared();
            let (offset, feature) = if t <= 0.0 {
                (q - start, Feature::Corner((i + 1) % 3))
            } else if t >= length {
                (q - start - along, Feature::Corner((i + 2) % 3))
            } else {
                (q - start - t / length * along, Feature::Edge(i))
            };
            let d = offset.norm_squared();
            if d < squared {
                (best, squared) = ((offset, feature), d);
            }
        }
        best
    }

    /// Distance (m) at which a ray passes through the triangle, edges included (Möller and
    /// Trumbore, 1997).
    fn hit(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let [u, v] = &self.sides;
        let across = direction.cross(v);
        let determinant = u.dot(&across);
        if determinant == 0.0 {
            return None;
        }
        let q = origin - self.origin;
        let b = q.dot(&across) / determinant;
        let turned = q.cross(u);
        let c = direction.dot(&turned) / determinant;
        let s = v.dot(&turned) / determinant;
        // Rounding may put a hit on an edge outside of both triangles; the slack keeps such a ray
        // from slipping through.
        let slack = -1e-12;
        (b >= slack && c >= slack && 1.0 - b - c >= slack && s >= 0.0).then_some(s)
    }
}

/// Builds the node over the triangles `order` and its descendants; `start` is the index of the
/// first of them in the whole order. Triangles are halved along the longest side of the box of
/// their centres.
fn build(
    nodes: &mut Vec<Node>,
    boxes: &[(Vector3<f64>, Vector3<f64>)],
    order: &mut [usize],
    start: u32,
) {
    let (mut low, mut high) = boxes[order[0]];
    let center = |t: usize| boxes[t].0 + boxes[t].1;
    let (mut least, mut most) = (center(order[0]), center(order[0]));
    for &t in &*order {
        (low, high) = (low.inf(&boxes[t].0), high.sup(&boxes[t].1));
        (least, most) = (least.inf(&center(t)), most.sup(&center(t)));
    }
    let index = nodes.len();
    nodes.push(Node { low, high, first: start, count: order.len() as u32 });
    if order.len() <= LEAF {
        return;
    }
    let axis = (most - least).imax();
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |&a, &b| center(a)[axis].total_cmp(&center(b)[axis]));
    let (lower, upper) = order.split_at_mut(middle);
    build(nodes, boxes, lower, start);
    let second = nodes.len() as u32;
    build(nodes, boxes, upper, start + middle as u32);
    nodes[index].first = second;
    nodes[index].count = 0;
}

/// Normals of every triangle's face, edges (sum of both faces' normals) and corners (sum weighted
/// by angle).
fn normals(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Vec<Normals> {
    let mut at_edge: HashMap<(u32, u32), Vector3<f64>> = HashMap::new();
    let mut at_vertex = vec![Vector3::zeros(); vertices.len()];
    let mut faces = Vec::with_capacity(triangles.len());
    for t in triangles {
        let [a, b, c] = t.map(|i| vertices[i as usize]);
        let face = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default();
        for (i, [x, y, z]) in [[a, b, c], [b, c, a], [c, a, b]].into_iter().enumerate() {
            at_vertex[t[i] as usize] += (y - x).angle(&(z - x)) * face;
            *at_edge.entry(opposite(t, i)).or_default() += face;
        }
        faces.push(face);
    }
    let of = |(t, face): (&[u32; 3], &Vector3<f64>)| Normals {
        face: *face,
        edges: [0, 1, 2].map(|i| at_edge[&opposite(t, i)]),
        corners: t.map(|i| at_vertex[i as usize]),
    };
    triangles.iter().zip(&faces).map(of).collect()
}

/// The edge opposite to corner `i`, smaller vertex first.
fn opposite(t: &[u32; 3], i: usize) -> (u32, u32) {
    let (a, b) = (t[(i + 1) % 3], t[(i + 2) % 3]);
    (a.min(b), a.max(b))
}
