//! Lowering of a height map to round solids, a row of pixels at once.
//!
//! Shapes: P pixels, those across the fastest.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use nalgebra::{Isometry3, Vector3};

use super::face::PlanGrid;
use crate::{geometry::Shape, simd::vectorised};

/// Points with Σ mᵢ pᵢ² ≤ (r + k z)², a not negative r + k z, and z in a range.
#[derive(Clone, Copy)]
struct RoundSolid {
    /// Factors m.
    metric: Vector3<f64>,
    /// Radius r at z = 0, and its growth k along z.
    radius: f64,
    slope: f64,
    /// Least and greatest z.
    slab: [f64; 2],
}

const EVERYWHERE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

impl RoundSolid {
    fn ellipsoid(semi_axes: &Vector3<f64>) -> Self {
        let metric = semi_axes.map(|semi_axis| semi_axis.powi(-2));
        Self { metric, radius: 1.0, slope: 0.0, slab: EVERYWHERE }
    }

    /// Between discs about z, at heights `slab` and of these radii.
    fn frustum(slab: [f64; 2], radii: [f64; 2]) -> Self {
        let slope = (radii[1] - radii[0]) / (slab[1] - slab[0]);
        let metric = Vector3::new(1.0, 1.0, 0.0);
        Self { metric, radius: radii[0] - slope * slab[0], slope, slab }
    }

    fn cylinder(radius: f64, slab: [f64; 2]) -> Self {
        Self { slab, ..Self::frustum([0.0, 1.0], [radius; 2]) }
    }

    fn scaled(self, factor: f64) -> Self {
        let slab = self.slab.map(|z| factor * z);
        Self { radius: factor * self.radius, slab, ..self }
    }

    /// The solid `shape` and its hole, if this is how it is made.
    fn of(shape: &Shape) -> Option<(Self, Option<Self>)> {
        Some(match *shape {
            Shape::Sphere { radius } => (Self::ellipsoid(&Vector3::repeat(radius)), None),
            Shape::Ellipsoid { semi_axes } => (Self::ellipsoid(&semi_axes), None),
            Shape::Cylinder { radius, half_height: h } => (Self::cylinder(radius, [-h, h]), None),
            Shape::Cone { radius, half_height: h } => (Self::frustum([-h, h], [radius, 0.0]), None),
            Shape::Annulus { outer, inner, half_height: h } => {
                (Self::cylinder(outer, [-h, h]), Some(Self::cylinder(inner, EVERYWHERE)))
            }
            Shape::Cup { bottom, rim, half_height: h, wall } => {
                let inside = Self::frustum([wall - h, h], [bottom - wall, rim - wall]);
                (Self::frustum([-h, h], [bottom, rim]), Some(inside))
            }
            Shape::Sampled(ref sampled) => {
                let ((solid, hole), factor) = (Self::of(sampled.exact())?, sampled.scale());
                (solid.scaled(factor), hole.map(|hole| hole.scaled(factor)))
            }
            _ => return None,
        })
    }
}

/// Pieces of a row of parallel lines in a solid (W): where each enters it and leaves it (m along
/// the line); a line that does not leave above where it enters meets nothing.
struct Pieces {
    enters: Vec<f64>,
    leaves: Vec<f64>,
}

/// Lines with one direction.
struct Lines {
    up: Vector3<f64>,
    /// From a line to the next (m).
    step: Vector3<f64>,
}

impl Pieces {
    fn new(count: usize) -> Self {
        Self { enters: vec![0.0; count], leaves: vec![0.0; count] }
    }

    /// Sets the pieces of the lines from `start` on in a solid.
    fn find(&mut self, solid: &RoundSolid, lines: &Lines, start: &Vector3<f64>) {
        let growth = solid.slope * lines.up.z;
        let a = solid.metric.dot(&lines.up.component_mul(&lines.up)) - growth * growth;
        // A line steeper than the side is inside beyond a root; beyond the other root lies the
        // mirrored cone past the apex.
        vectorised(
            #[inline(always)]
            || match (a >= 0.0, growth < 0.0) {
                (true, _) => self.fill(solid, lines, start, a, |near, far| [near, far]),
                (_, true) => self.fill(solid, lines, start, a, |near, _| [f64::NEG_INFINITY, near]),
                _ => self.fill(solid, lines, start, a, |_, far| [far, f64::INFINITY]),
            },
        );
    }

    /// Sets the pieces where they are `between` the roots of the solid's quadratic a s² + 2 b s + c
    /// along a line.
    #[inline(always)]
    fn fill(
        &mut self,
        solid: &RoundSolid,
        Lines { up, step }: &Lines,
        start: &Vector3<f64>,
        a: f64,
        between: impl Fn(f64, f64) -> [f64; 2],
    ) {
        let (m, growth, per_height) = (&solid.metric, solid.slope * up.z, up.z.recip());
        for (i, (enters, leaves)) in (0i32..).zip(self.enters.iter_mut().zip(&mut self.leaves)) {
            let i = f64::from(i);
            let [x, y, z] = [0, 1, 2].map(|axis: usize| start[axis] + i * step[axis]);
            let radius = solid.radius + solid.slope * z;
            let b = m.x * x * up.x + m.y * y * up.y + m.z * z * up.z - growth * radius;
            let c = m.x * x * x + m.y * y * y + m.z * z * z - radius * radius;
            let discriminant = b * b - a * c;
            // Without cancellation.
            let q = -(b + discriminant.max(0.0).sqrt().copysign(b));
            let (s, t) = (c / q, q / a);
            let [from, to] = between(s.min(t), s.max(t));
            // Without a root it is inside everywhere or nowhere.
            let has_root = discriminant >= 0.0 && (a != 0.0 || b != 0.0);
            let end = if c <= 0.0 { f64::INFINITY } else { f64::NEG_INFINITY };
            let (from, to) = if has_root { (from, to) } else { (-end, end) };
            let ends = solid.slab.map(|end| (end - z) * per_height);
            *enters = from.max(ends[0].min(ends[1]));
            *leaves = to.min(ends[0].max(ends[1]));
        }
    }

    /// Lowers heights (W) inside of these pieces without `holes` to where a line from below enters.
    fn lower(&self, row: &mut [f64], holes: Option<&Self>) {
        let pieces = self.enters.iter().zip(&self.leaves);
        vectorised(
            #[inline(always)]
            || match holes {
                None => {
                    for (height, (enters, leaves)) in row.iter_mut().zip(pieces.clone()) {
                        let is_in = *enters < *height && *height <= *leaves;
                        *height = if is_in { *enters } else { *height };
                    }
                }
                Some(holes) => {
                    let holes = holes.enters.iter().zip(&holes.leaves);
                    let pieces = pieces.clone().zip(holes);
                    for (height, ((enters, leaves), (from, to))) in row.iter_mut().zip(pieces) {
                        // A hole that is not met takes nothing away.
                        let from = if from < to { *from } else { f64::INFINITY };
                        let beyond = enters.max(*to);
                        let is_before = *enters < *height && *height <= leaves.min(from);
                        let is_beyond = beyond < *height && *height <= *leaves;
                        let lowered = if is_beyond { beyond } else { *height };
                        *height = if is_before { *enters } else { lowered };
                    }
                }
            },
        );
    }
}

/// Lowers heights (P) inside of a solid to where a line from below enters it; returns whether it is
/// a round one, without which nothing is done.
pub(super) fn lower_to_round(
    heights: &mut [f64],
    grid: &PlanGrid,
    shape: &Shape,
    pose: &Isometry3<f64>,
) -> bool {
    let Some((solid, hole)) = RoundSolid::of(shape) else { return false };
    // The axes of the grid in the frame of the solid.
    let to_solid = pose.inverse();
    let turn = to_solid.rotation.to_rotation_matrix();
    let [across, along, up] = [0, 1, 2].map(|axis| turn.matrix().column(axis).into_owned());
    let first = to_solid.translation.vector + grid.centre(0, 0) * across;
    let lines = Lines { up, step: grid.cell[0] * across };
    let width = grid.counts[0] as usize;
    let (mut pieces, mut holes) = (Pieces::new(width), Pieces::new(width));
    for (j, row) in (0..).zip(heights.chunks_exact_mut(width)) {
        let start = first + grid.centre(1, j) * along;
        pieces.find(&solid, &lines, &start);
        if let Some(hole) = &hole {
            holes.find(hole, &lines, &start);
        }
        pieces.lower(row, hole.is_some().then_some(&holes));
    }
    true
}
