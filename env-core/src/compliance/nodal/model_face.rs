//! Face of the mesh on which fields are output, and its displacement by the elastic layer and the
//! sides.
//!
//! Forces on cells are distributed over the nodes of the face, for which responses are tabulated.
//! Near a cell, the response to the force on the cell itself is used instead.
//!
//! Shapes: C nodes a layer.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, Vector3};

use super::{grid::CellGrid, kernel::PlaneKernel, side_field::SideField};
use crate::{
    geometry::{PadMesh, plan_shares},
    simd::{LANES, vectorised},
};

/// Distance in plan from a cell up to which nodes are displaced by the force on the cell itself,
/// and not by tractions around face nodes, in spacings of the nodes.
const NEAR: f64 = 3.5;
/// Points along each side of a cell over which a force is spread, where the sides are concerned.
pub(super) const SPREAD: u32 = 2;
/// Squares of the plan along each axis.
const SQUARES: usize = 48;

/// Nodes of the face near a square of the plan.
pub(super) struct NearNodes {
    /// Their numbers, ascending.
    pub(super) nodes: Vec<u32>,
    /// Ranges of successive numbers among them.
    runs: Vec<[usize; 2]>,
    /// Ranges of a layer's displacement (C, 3) that begin with the nodes of a run and contain them,
    /// each a multiple of [`LANES`] long.
    pub(super) parts: Vec<[usize; 2]>,
}

/// The mesh on which fields are output: layers of nodes of one plan. C nodes a layer.
pub(super) struct ModelFace {
    /// Nodes of the face (C).
    pub(super) nodes: Vec<Point3<f64>>,
    /// Rotations from the frames of the layer under the nodes to that of the pad (C).
    tilts: Vec<Matrix3<f32>>,
    /// Influence of the sides on displacement.
    pub(super) sides: SideField,
    triangles: Vec<[u32; 3]>,
    /// Triangles that a square of the plan may touch, row after row along y.
    squares: Vec<Vec<u32>>,
    /// Nodes of the face within [`NEAR`] of each square.
    near: Vec<NearNodes>,
    /// Lowest corner of the squares (m).
    corner: [f64; 2],
    /// Free layers below the face.
    pub(super) below: Vec<PlaneKernel>,
    /// Displacement of the nodes of each free layer under unit forces around each face node, by the
    /// latter first (C, C) in m/N.
    pub(super) between: Vec<Vec<Matrix3<f32>>>,
}

impl NearNodes {
    fn new(nodes: Vec<u32>) -> Self {
        let mut runs: Vec<[usize; 2]> = Vec::new();
        for (i, node) in nodes.iter().enumerate() {
            match runs.last_mut() {
                Some([_, end]) if nodes[*end - 1] + 1 == *node => *end = i + 1,
                _ => runs.push([i, i + 1]),
            }
        }
        let part = |&[first, last]: &[usize; 2]| {
            let begin = 3 * nodes[first] as usize;
            [begin, begin + (3 * (last - first)).next_multiple_of(LANES)]
        };
        let parts = runs.iter().map(part).collect();
        Self { nodes, runs, parts }
    }

    /// Numbers of the nodes (N, 3) by part, zero where there is no node.
    pub(super) fn in_parts(&self, numbers: &[[f32; 3]]) -> Vec<f32> {
        let mut all = Vec::new();
        for (&[first, last], [begin, end]) in self.runs.iter().zip(&self.parts) {
            let length = all.len() + end - begin;
            all.extend_from_slice(numbers[first..last].as_flattened());
            all.resize(length, 0.0);
        }
        all
    }
}

impl ModelFace {
    /// Takes `grid` for the layer's response, to which that of the `sides` is added.
    pub(super) fn new(
        model: &PadMesh,
        below: Vec<PlaneKernel>,
        sides: SideField,
        grid: &CellGrid,
    ) -> Self {
        let nodes: Vec<_> =
            model.face.iter().map(|&node| model.mesh.vertices[node as usize]).collect();
        let tilts = nodes.iter().map(|node| grid.tilt_at(node).cast()).collect();
        let corner = [0, 1].map(|axis| nodes.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min));
        let mut face = Self {
            triangles: model.face_triangles.clone(),
            squares: vec![Vec::new(); SQUARES * SQUARES],
            near: Vec::new(),
            corner,
            between: Vec::new(),
            below,
            nodes,
            tilts,
            sides,
        };
        for (t, corners) in face.triangles.iter().enumerate() {
            let ends = [0, 1].map(|axis| {
                let along = corners.map(|node| face.nodes[node as usize][axis]);
                let (low, high) = along
                    .iter()
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |e, p| (e.0.min(*p), e.1.max(*p)));
                [face.square(axis, low), face.square(axis, high)]
            });
            for i in ends[0][0]..=ends[0][1] {
                for j in ends[1][0]..=ends[1][1] {
                    face.squares[i * SQUARES + j].push(t as u32);
                }
            }
        }
        face.near = face.nodes_near_squares();
        face.between = face.between(grid);
        face
    }

    fn nodes_near_squares(&self) -> Vec<NearNodes> {
        // Area of the triangles at each node (m²), and their number.
        let mut around = vec![(0.0, 0.0); self.nodes.len()];
        for corners in &self.triangles {
            let [a, b, c] = corners.map(|node| self.nodes[node as usize].coords);
            for &node in corners {
                let (area, number) = &mut around[node as usize];
                *area += 0.5 * (b - a).xy().perp(&(c - a).xy()).abs();
                *number += 1.0;
            }
        }
        let reach: Vec<_> =
            around.iter().map(|(area, number)| NEAR * f64::sqrt(2.0 * area / number)).collect();
        let sides = self.corner.map(|low| -2.0 * low / SQUARES as f64);
        let near = |square: usize| {
            let centre = Point3::new(
                self.corner[0] + sides[0] * ((square / SQUARES) as f64 + 0.5),
                self.corner[1] + sides[1] * ((square % SQUARES) as f64 + 0.5),
                0.0,
            );
            let is_near = |&node: &u32| {
                let (place, reach) = (&self.nodes[node as usize], reach[node as usize]);
                (place - centre).xy().norm_squared() < reach * reach
            };
            NearNodes::new((0..self.nodes.len() as u32).filter(is_near).collect())
        };
        (0..SQUARES * SQUARES).map(near).collect()
    }

    /// Nodes of the face within [`NEAR`] of the square around a point.
    pub(super) fn near(&self, point: &Point3<f64>) -> &NearNodes {
        &self.near[self.square(0, point.x) * SQUARES + self.square(1, point.y)]
    }

    fn square(&self, axis: usize, p: f64) -> usize {
        let extent = -2.0 * self.corner[axis];
        ((p - self.corner[axis]) / extent * SQUARES as f64).clamp(0.0, SQUARES as f64 - 1.0)
            as usize
    }

    /// Face nodes around a point, with weights that sum to 1.
    pub(super) fn under(&self, point: &Point3<f64>) -> ([u32; 3], [f64; 3]) {
        let [i, j] = [self.square(0, point.x), self.square(1, point.y)];
        let candidates = self.squares[i * SQUARES + j].iter().filter_map(|&t| {
            let corners = self.triangles[t as usize];
            let places = corners.map(|node| self.nodes[node as usize]);
            Some((corners, plan_shares(&places, point.x, point.y)?))
        });
        let least = |shares: &[f64; 3]| shares.iter().copied().fold(f64::INFINITY, f64::min);
        let best = candidates.max_by(|(_, a), (_, b)| least(a).total_cmp(&least(b)));
        best.expect("the mesh covers the face")
    }

    /// Change of the displacement of the nodes near a `cell` of a grid, by layer, if a `force` (N)
    /// is spread over it, and not as tractions around the nodes of the face (m).
    pub(super) fn changes(&self, grid: &CellGrid, cell: u32, force: [f32; 3]) -> Vec<[f32; 3]> {
        let count = self.nodes.len();
        let from = grid.place(cell);
        let (corners, shares) = self.under(&from);
        let borne = shares.map(|share| force.map(|f| f * share as f32));
        let near = &self.near(&from).nodes;
        let mut changes = vec![[0.0; 3]; self.between.len() * near.len()];
        let away = |node: u32| {
            let at = &self.nodes[node as usize];
            [at.x - from.x, at.y - from.y]
        };
        let in_layer = grid.tilt(cell).cast().tr_mul(&Vector3::from(force)).into();
        let points: Vec<_> = grid.points(cell, SPREAD).collect();
        let share = 1.0 / points.len() as f64;
        let around = points.iter().flat_map(|point| self.sides.around(point));
        let mut by_sides: Vec<(usize, [f32; 3])> = Vec::new();
        for (node, part) in around.filter(|(_, part)| *part > 0.0) {
            let part = force.map(|f| f * (part * share) as f32);
            match by_sides.iter_mut().find(|(other, _)| *other == node) {
                Some((_, sum)) => (0..3).for_each(|i| sum[i] += part[i]),
                None => by_sides.push((node, part)),
            }
        }
        let layers = changes.chunks_exact_mut(near.len());
        for ((layer, between), changes) in self.between.iter().enumerate().zip(layers) {
            let rows = corners.map(|corner| &between[corner as usize * count..][..count]);
            let by_sides: Vec<_> = by_sides
                .iter()
                .map(|(node, force)| (&self.sides.row(*node)[layer * count..][..count], force))
                .collect();
            vectorised(
                #[inline(always)]
                || {
                    for (&node, change) in near.iter().zip(&mut *changes) {
                        let by_layer = match layer.checked_sub(1) {
                            None => grid.under(away(node), in_layer),
                            Some(below) => self.below[below].under(away(node), in_layer),
                        };
                        *change = (self.tilts[node as usize] * Vector3::from(by_layer)).into();
                        let minus = rows.iter().zip(&borne).map(|(row, f)| (*row, f, -1.0));
                        let plus = by_sides.iter().map(|(row, f)| (*row, *f, 1.0));
                        for (row, f, sign) in minus.chain(plus) {
                            let columns = &row[node as usize].data.0;
                            for i in 0..3 {
                                change[i] += sign
                                    * (f[0] * columns[0][i]
                                        + f[1] * columns[1][i]
                                        + f[2] * columns[2][i]);
                            }
                        }
                    }
                },
            );
        }
        changes
    }

    fn between(&self, grid: &CellGrid) -> Vec<Vec<Matrix3<f32>>> {
        let mut tents = vec![Vec::new(); self.nodes.len()];
        for cell in 0..grid.len() as u32 {
            let place = grid.place(cell);
            let (corners, shares) = self.under(&place);
            for (corner, share) in corners.into_iter().zip(shares).filter(|(_, s)| *s > 0.0) {
                tents[corner as usize].push((cell, place, share));
            }
        }
        let load = |cells: &Vec<(u32, Point3<f64>, f64)>| {
            let sum: f64 = cells.iter().map(|(_, _, share)| share).sum();
            let mut loads = BTreeMap::<usize, f32>::new();
            for (_, place, share) in cells {
                for (node, part) in self.sides.around(place) {
                    *loads.entry(node).or_default() += (part * share / sum) as f32;
                }
            }
            loads.into_iter().filter(|(_, share)| *share > 0.0).collect()
        };
        let loads: Vec<Vec<(usize, f32)>> = tents.iter().map(load).collect();
        let layer = |(layer, plane): (usize, Option<&PlaneKernel>)| -> Vec<Matrix3<f32>> {
            let under = |at: &Point3<f64>, cells: &[(u32, Point3<f64>, f64)]| {
                let part = |(cell, from, share): &(u32, Point3<f64>, f64)| match plane {
                    None => grid.at_point(*cell, at) * *share as f32,
                    Some(plane) => {
                        let by_layer = plane.at(at.x - from.x, at.y - from.y);
                        let turned = grid.tilt_at(at) * by_layer * grid.tilt(*cell).transpose();
                        turned.cast() * *share as f32
                    }
                };
                let sum: f64 = cells.iter().map(|(_, _, share)| share).sum();
                cells.iter().map(part).sum::<Matrix3<f32>>() / sum as f32
            };
            let by_layer =
                tents.iter().flat_map(|cells| self.nodes.iter().map(move |at| under(at, cells)));
            let count = self.nodes.len();
            let by_sides = loads.iter().flat_map(|loads| {
                let at = move |i: usize| {
                    let part = |(node, share): &(usize, f32)| self.sides.row(*node)[i] * *share;
                    loads.iter().map(part).sum::<Matrix3<f32>>()
                };
                (layer * count..(layer + 1) * count).map(at)
            });
            by_layer.zip(by_sides).map(|(layer, sides)| layer + sides).collect()
        };
        let planes = std::iter::once(None).chain(self.below.iter().map(Some));
        planes.enumerate().map(layer).collect()
    }
}
