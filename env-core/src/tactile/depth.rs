//! Height map of the face, deformed or at rest.
//!
//! The height at a pixel is that of the mesh's face above it, the uppermost where the face folds
//! over.

use std::{array::from_fn, ops::Range};

use nalgebra::{Point3, Vector3};

use super::face::{Face, PlanGrid};
use crate::geometry::plan_shares;

/// Heights of the face at the pixels of `view` (D) in m, with the nodes displaced by `displacement`
/// (V), or at rest.
pub(super) fn heights(
    face: &Face,
    view: &PlanGrid,
    displacement: Option<&[Vector3<f64>]>,
) -> Vec<f64> {
    let mut heights = vec![-face.thickness(); (view.counts[0] * view.counts[1]) as usize];
    let place = |node: u32| {
        let still = face.places[node as usize];
        displacement.map_or(still, |u| still + u[node as usize])
    };
    for corners in &face.triangles {
        let triangle = corners.map(place);
        cover_by(&triangle, [triangle.map(|corner| corner.z)], view, |pixels, [z]| {
            for (k, height) in (0..).zip(&mut heights[pixels]) {
                *height = height.max(z.at(k));
            }
        });
    }
    heights
}

/// A quantity that is linear along a row of pixels.
#[derive(Clone, Copy)]
pub(super) struct AlongRow {
    start: f64,
    step: f64,
}

impl AlongRow {
    /// Value at pixel `k` of the row.
    pub(super) fn at(self, k: i32) -> f64 {
        self.start + f64::from(k) * self.step
    }
}

/// Calls `visit` for each row of pixels of `view` in the plan of a triangle, with quantities that
/// are linear over it and have these `values` at the corners.
pub(super) fn cover_by<const N: usize>(
    triangle: &[Point3<f64>; 3],
    values: [[f64; 3]; N],
    view: &PlanGrid,
    mut visit: impl FnMut(Range<usize>, [AlongRow; N]),
) {
    /// Share of a corner down to which a pixel still counts as inside, so that rounding leaves no
    /// gap between two triangles.
    const EDGE: f64 = -1e-9;
    let [columns, rows] = [0, 1].map(|axis| pixels(view, axis, triangle));
    if columns.is_empty() || rows.is_empty() {
        return;
    }
    let [x, y] = [view.centre(0, columns.start), view.centre(1, rows.start)];
    let Some(first) = plan_shares(triangle, x, y) else { return };
    let [by_x, by_y] = share_slopes(triangle);
    let by_column = by_x.map(|slope| slope * view.cell[0]);
    let by_row = by_y.map(|slope| slope * view.cell[1]);
    let along = values.map(|values| dot(&values, &by_column));
    // The column at which a corner has this share, in the first row, and by how much it moves a row.
    let end: [f64; 3] = from_fn(|k| (EDGE - first[k]) / by_column[k]);
    let end_by_row: [f64; 3] = from_fn(|k| -by_row[k] / by_column[k]);
    let last = f64::from(columns.end - 1 - columns.start);
    for (row, j) in rows.enumerate() {
        let row = row as f64;
        let shares: [f64; 3] = from_fn(|k| first[k] + row * by_row[k]);
        let (mut from, mut to) = (0.0f64, last);
        for k in 0..3 {
            let end = end[k] + row * end_by_row[k];
            if by_column[k] > 0.0 {
                from = from.max(end);
            } else if by_column[k] < 0.0 {
                to = to.min(end);
            } else if shares[k] < EDGE {
                to = -1.0;
            }
        }
        let (from, to) = (from.ceil(), to.floor());
        if from <= to {
            let start = (j * view.counts[0] + columns.start) as usize + from as usize;
            let lines = from_fn(|n| AlongRow {
                start: dot(&values[n], &shares) + from * along[n],
                step: along[n],
            });
            visit(start..start + (to - from) as usize + 1, lines);
        }
    }
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Derivatives of a triangle's plan shares with respect to x and y (1/m).
fn share_slopes([a, b, c]: &[Point3<f64>; 3]) -> [[f64; 3]; 2] {
    let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    let edges = [c - b, a - c, b - a];
    [edges.map(|edge| -edge.y / area), edges.map(|edge| edge.x / area)]
}

/// Pixels along `axis` whose centres may lie under `triangle`.
fn pixels(view: &PlanGrid, axis: usize, triangle: &[Point3<f64>; 3]) -> Range<u32> {
    let index = |p: f64| p / view.cell[axis] + 0.5 * f64::from(view.counts[axis]) - 0.5;
    let places = triangle.map(|corner| index(corner[axis]));
    let low = places.into_iter().fold(f64::INFINITY, f64::min).floor();
    let high = places.into_iter().fold(f64::NEG_INFINITY, f64::max).ceil() + 1.0;
    // Casts of negative numbers to unsigned ones give 0.
    (low as u32)..(high as u32).min(view.counts[axis])
}
