//! Face of a pad at rest, points on it, and grids over it.
//!
//! Shapes: V nodes of the mesh. Grids run across (x) fastest, from the corner of least x and y.

use nalgebra::Point3;

/// Face of a pad at rest.
#[derive(Debug)]
pub(super) struct Face {
    /// Nodes of the mesh at rest (V).
    pub(super) places: Vec<Point3<f64>>,
    /// Corners of the face's triangles, counter-clockwise seen from outside.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Thickness of the pad (m).
    pub(super) thickness: f64,
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

    /// Centres of all cells (m).
    pub(super) fn centres(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        let [nx, ny] = self.counts;
        (0..ny).flat_map(move |j| (0..nx).map(move |i| [self.centre(0, i), self.centre(1, j)]))
    }
}
