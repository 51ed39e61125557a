//! Lowering of a height map to round solids, a row of pixels at once.
//!
//! Shapes: P pixels, those across the fastest.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use nalgebra::{Isometry3, Vector3};

use super::face::PlanGrid;
use crate::{geometry::Shape, simd::vectorised};

/// Points with Σ mᵢ pᵢ² ≤ (r + k z)², a not negative r + k z, and z in a range.
#[derive(Clone, Copy)]
struct Round {
    /// Factors m.
    metric: Vector3<f64>,
    /// Radius r at z = 0, and its growth k along z.
    radius: f64,
    slope: f64,
    /// Least and greatest z.
    slab: [f64; 2],
}

const EVERYWHERE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

impl Round {
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

    /// The solid `shape` and its hole, if this is how it is made.
    fn of(shape: &Shape) -> Option<[Option<Self>; 2]> {
        let (solid, hole) = match *shape {
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
            _ => return None,
        };
        Some([Some(solid), hole])
    }

    /// Pieces of lines with the direction `up`.
    fn cut(self, up: &Vector3<f64>) -> Cut {
        let growth = self.slope * up.z;
        let a = self.metric.dot(&up.component_mul(up)) - growth * growth;
        Cut { solid: self, up: *up, per_height: up.z.recip(), growth, a }
    }
}

/// A solid on parallel lines.
#[derive(Clone, Copy)]
struct Cut {
    solid: Round,
    up: Vector3<f64>,
    per_height: f64,
    /// Growth of the radius along the line.
    growth: f64,
    /// Coefficient of s² in the solid's quadratic a s² + 2 b s + c ≤ 0 along a line.
    a: f64,
}

impl Cut {
    /// Where the line from `p` enters and leaves (m along it); it meets nothing unless it leaves
    /// above where it enters.
    #[inline(always)]
    fn chord(&self, p: [f64; 3]) -> [f64; 2] {
        let (Self { solid, up, growth, a, .. }, m) = (self, &self.solid.metric);
        let radius = solid.radius + solid.slope * p[2];
        let b = m.x * p[0] * up.x + m.y * p[1] * up.y + m.z * p[2] * up.z - growth * radius;
        let c = m.x * p[0] * p[0] + m.y * p[1] * p[1] + m.z * p[2] * p[2] - radius * radius;
        let discriminant = b * b - a * c;
        // Without cancellation.
        let q = -(b + discriminant.max(0.0).sqrt().copysign(b));
        let (s, t) = (c / q, q / a);
        let (near, far) = (s.min(t), s.max(t));
        let [from, to] = if *a >= 0.0 {
            [near, far]
        } else if *growth < 0.0 {
            // A line steeper than the side is inside beyond a root; beyond the other root lies the
            // mirrored cone past the apex.
            [f64::NEG_INFINITY, near]
        } else {
            [far, f64::INFINITY]
        };
        // Without a root it is inside everywhere or nowhere.
        let has_root = discriminant >= 0.0 && (*a != 0.0 || b != 0.0);
        let end = if c <= 0.0 { f64::INFINITY } else { f64::NEG_INFINITY };
        let (from, to) = if has_root { (from, to) } else { (-end, end) };
        let ends = [0, 1].map(|end: usize| (solid.slab[end] - p[2]) * self.per_height);
        [from.max(ends[0].min(ends[1])), to.min(ends[0].max(ends[1]))]
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
    let Some([Some(solid), hole]) = Round::of(shape) else { return false };
    // The axes of the grid in the frame of the solid.
    let to_solid = pose.inverse();
    let turn = to_solid.rotation.to_rotation_matrix();
    let [across, along, up] = [0, 1, 2].map(|axis| turn.matrix().column(axis).into_owned());
    let (solid, hole) = (solid.cut(&up), hole.map(|hole| hole.cut(&up)));
    let step = grid.cell[0] * across;
    for (j, row) in (0..).zip(heights.chunks_exact_mut(grid.counts[0] as usize)) {
        let start =
            to_solid.translation.vector + grid.centre(0, 0) * across + grid.centre(1, j) * along;
        vectorised(
            #[inline(always)]
            || match &hole {
                None => lower_row(row, &start, &step, |p| [solid.chord(p), [0.0; 2]]),
                Some(hole) => lower_row(row, &start, &step, |p| {
                    let ([enters, leaves], [from, to]) = (solid.chord(p), hole.chord(p));
                    // A hole that is not met takes nothing away.
                    let from = if from < to { from } else { f64::INFINITY };
                    [[enters, leaves.min(from)], [enters.max(to), leaves]]
                }),
            },
        );
    }
    true
}

/// Lowers a row of heights inside of the pieces of the lines from points that lie `step` apart.
#[inline(always)]
fn lower_row(
    row: &mut [f64],
    start: &Vector3<f64>,
    step: &Vector3<f64>,
    pieces: impl Fn([f64; 3]) -> [[f64; 2]; 2],
) {
    for (i, height) in (0i32..).zip(row) {
        let i = f64::from(i);
        let p = [start.x + i * step.x, start.y + i * step.y, start.z + i * step.z];
        let [first, second] = pieces(p);
        let was = *height;
        let is_in = |[enters, leaves]: [f64; 2]| enters < was && was <= leaves;
        let lowered = if is_in(second) { second[0] } else { was };
        *height = if is_in(first) { first[0] } else { lowered };
    }
}
