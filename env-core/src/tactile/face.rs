//! Face of a pad at rest, points on it, and grids over it.
//!
//! Shapes: V nodes of the mesh. Grids run across (x) fastest, from the corner of least x and y.

use nalgebra::Point3;

use crate::geometry::PadOutline;

/// Face of a pad at rest.
#[derive(Debug)]
pub(super) struct Face {
    /// Nodes of the mesh at rest (V).
    pub(super) places: Vec<Point3<f64>>,
    /// Corners of the face's triangles, counter-clockwise seen from outside.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Outline of the pad.
    pub(super) outline: PadOutline,
}

impl Face {
    /// Thickness of the pad (m).
    pub(super) fn thickness(&self) -> f64 {
        self.outline.thickness
    }
}

/// Point on the face: the corners of its triangle and their weights, which sum to 1.
pub(super) type FacePoint = ([u32; 3], [f64; 3]);

/// Regular grid of cells on a centred rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PlanGrid {
    /// Cells across and along.
    pub(super) counts: [u32; 2],
    /// Size of a cell (m).
    pub(super) cell: [f64; 2],
}

impl PlanGrid {
    /// Divides a centred rectangle of `extent` (m) into `counts` cells.
    pub(super) fn filling(extent: [f64; 2], counts: [u32; 2]) -> Self {
        Self { counts, cell: [0, 1].map(|axis| extent[axis] / f64::from(counts[axis])) }
    }

    /// Centre of cell `i` along `axis` (m).
    pub(super) fn centre(&self, axis: usize, i: u32) -> f64 {
        (f64::from(i) + 0.5 - 0.5 * f64::from(self.counts[axis])) * self.cell[axis]
    }

    /// Returns whether all of `places` lie more than `margin` (m) beyond one side of the grid.
    pub(super) fn misses(&self, places: &[Point3<f64>], margin: f64) -> bool {
        (0..2).any(|axis| {
            let side = 0.5 * f64::from(self.counts[axis]) * self.cell[axis] + margin;
            places.iter().all(|p| p[axis] > side) || places.iter().all(|p| p[axis] < -side)
        })
    }

    /// Centres of all cells (m).
    pub(super) fn centres(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        let [nx, ny] = self.counts;
        (0..ny).flat_map(move |j| (0..nx).map(move |i| [self.centre(0, i), self.centre(1, j)]))
    }
}
