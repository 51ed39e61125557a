//! Height map of the face, deformed or at rest.
//!
//! The height at a pixel is that of the mesh's face above it, the uppermost where the face folds
//! over.

use std::array::from_fn;

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
    for &corners in &face.triangles {
        cover_by(&corners.map(place), view, |pixel, z, _| heights[pixel] = heights[pixel].max(z));
    }
    heights
}

/// Calls `visit` for each pixel of `view` in the plan of a triangle, with its height there (m), and
/// the shares of the corners.
pub(super) fn cover_by(
    triangle: &[Point3<f64>; 3],
    view: &PlanGrid,
    mut visit: impl FnMut(usize, f64, [f64; 3]),
) {
    let [columns, rows] = [0, 1].map(|axis| pixels(view, axis, triangle));
    if columns.is_empty() || rows.is_empty() {
        return;
    }
    // Shares are linear in the plan.
    let Some(origin) = plan_shares(triangle, 0.0, 0.0) else { return };
    let [by_x, by_y] = share_slopes(triangle);
    for j in rows {
        let y = view.centre(1, j);
        for i in columns.clone() {
            let x = view.centre(0, i);
            let shares: [f64; 3] = from_fn(|k| origin[k] + by_x[k] * x + by_y[k] * y);
            if shares.iter().all(|&share| share >= -1e-9) {
                let z = triangle.iter().zip(shares).map(|(corner, s)| corner.z * s).sum();
                visit((j * view.counts[0] + i) as usize, z, shares);
            }
        }
    }
}

/// Derivatives of a triangle's plan shares with respect to x and y (1/m).
fn share_slopes([a, b, c]: &[Point3<f64>; 3]) -> [[f64; 3]; 2] {
    let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    let edges = [c - b, a - c, b - a];
    [edges.map(|edge| -edge.y / area), edges.map(|edge| edge.x / area)]
}

/// Pixels along `axis` whose centres may lie under `triangle`.
fn pixels(view: &PlanGrid, axis: usize, triangle: &[Point3<f64>; 3]) -> std::ops::Range<u32> {
    let index = |p: f64| p / view.cell[axis] + 0.5 * f64::from(view.counts[axis]) - 0.5;
    let places = triangle.map(|corner| index(corner[axis]));
    let low = places.into_iter().fold(f64::INFINITY, f64::min).floor();
    let high = places.into_iter().fold(f64::NEG_INFINITY, f64::max).ceil() + 1.0;
    // Casts of negative numbers to unsigned ones give 0.
    (low as u32)..(high as u32).min(view.counts[axis])
}
