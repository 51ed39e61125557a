//! Influence of the sides of a pad on displacement between its contact cells.
//!
//! The change by the sides, the rim and the curved face against an elastic layer ([`Sides`]) is
//! smooth, and is taken between tractions that fall off linearly around the cells of the first
//! grid.
//!
//! Shapes: C cells of the first grid.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use nalgebra::Vector3;

use super::{kernel::Columns, sides::Sides};
use crate::{geometry::PadOutline, simd::vectorised};

/// Cells of the first grid, counted row after row along y.
#[derive(Clone, Copy)]
pub(super) struct FirstGrid {
    pub(super) outline: PadOutline,
    /// Cells along x and y, and their sides (m).
    pub(super) count: [u32; 2],
    pub(super) sides: [f64; 2],
}

/// Compliance of a pad less that of a layer, between tractions around the cells of the first grid.
pub(super) struct SideCompliance {
    /// Displacement around all cells under unit forces around each along each axis (3C, 3C) in m/N.
    entries: Vec<f32>,
    /// Cells along x and y.
    count: [u32; 2],
}

/// Cells of the first grid in a rectangle, counted row after row along y: first cell along x and y,
/// and numbers of them.
#[derive(Clone, Copy, Default)]
pub(super) struct Around {
    first: [u32; 2],
    count: [u32; 2],
}

impl Around {
    /// The smallest that contains some cells, given by their places along x and y.
    pub(super) fn of(cells: impl Iterator<Item = [u32; 2]>) -> Self {
        let none = ([u32::MAX; 2], [0; 2]);
        let (first, end) = cells.fold(none, |(first, end), cell| {
            let wider = |axis: usize| (first[axis].min(cell[axis]), end[axis].max(cell[axis] + 1));
            let [x, y] = [wider(0), wider(1)];
            ([x.0, y.0], [x.1, y.1])
        });
        let count = [0, 1].map(|axis| end[axis].saturating_sub(first[axis]));
        Self { first, count }
    }

    /// Number of cells.
    pub(super) fn len(&self) -> usize {
        (self.count[0] * self.count[1]) as usize
    }

    /// Number of the cell at a place along x and y.
    pub(super) fn number(&self, cell: [u32; 2]) -> u32 {
        (cell[0] - self.first[0]) * self.count[1] + cell[1] - self.first[1]
    }
}

impl FirstGrid {
    /// Divides the face of a pad into `count` cells along x and y.
    pub(super) fn new(outline: &PadOutline, count: [u32; 2]) -> Self {
        let sides = [outline.width / f64::from(count[0]), outline.length / f64::from(count[1])];
        Self { outline: *outline, count, sides }
    }

    /// Cells between whose centres a point of the plan lies, with weights that sum to 1; the
    /// outermost hold to the edge.
    pub(super) fn around(&self, x: f64, y: f64) -> [(u32, f64); 4] {
        let along = |axis: usize, p: f64, extent: f64| {
            let most = f64::from(self.count[axis] - 1);
            let place = ((p + 0.5 * extent) / self.sides[axis] - 0.5).clamp(0.0, most);
            let low = place.floor().min(most - 1.0);
            (low as u32, place - low)
        };
        let (i, by_x) = along(0, x, self.outline.width);
        let (j, by_y) = along(1, y, self.outline.length);
        let cell = |a: u32, b: u32| (i + a) * self.count[1] + j + b;
        [
            (cell(0, 0), (1.0 - by_x) * (1.0 - by_y)),
            (cell(0, 1), (1.0 - by_x) * by_y),
            (cell(1, 0), by_x * (1.0 - by_y)),
            (cell(1, 1), by_x * by_y),
        ]
    }

    /// Nodes of the face of `sides` that bear tractions around each cell (C), with shares of the
    /// force.
    fn loads(&self, sides: &Sides) -> Vec<Vec<(u32, f64)>> {
        let mut loads = vec![Vec::new(); (self.count[0] * self.count[1]) as usize];
        for (&node, area) in sides.mesh.face.iter().zip(sides.areas()) {
            let place = &sides.mesh.mesh.vertices[node as usize];
            for (cell, share) in self.around(place.x, place.y) {
                if share > 1e-9 {
                    loads[cell as usize].push((node, share * area));
                }
            }
        }
        for loads in &mut loads {
            let sum: f64 = loads.iter().map(|(_, share)| share).sum();
            for (_, share) in loads {
                *share /= sum;
            }
        }
        loads
    }
}

impl SideCompliance {
    /// Takes the influence of the `sides` between the cells of the `first` grid.
    pub(super) fn new(first: &FirstGrid, sides: &Sides) -> Self {
        let loads = first.loads(sides);
        let row = |from: &[(u32, f64)], axis: usize| -> Vec<f32> {
            let force = |&(node, share): &(u32, f64)| (node, Vector3::ith(axis, share));
            let moved = sides.displacement(&from.iter().map(force).collect::<Vec<_>>());
            let seen = |to: &Vec<(u32, f64)>| -> [f32; 3] {
                let part = |&(node, share): &(u32, f64)| moved[node as usize] * share;
                to.iter().map(part).sum::<Vector3<f64>>().cast().into()
            };
            loads.iter().flat_map(seen).collect()
        };
        let rows = loads.iter().flat_map(|from| [0, 1, 2].map(|axis| row(from, axis)));
        Self { entries: rows.flatten().collect(), count: first.count }
    }

    /// Numbers in a row.
    fn size(&self) -> usize {
        3 * (self.count[0] * self.count[1]) as usize
    }

    /// Displacement around all cells (3C) in m under forces around each (C) in N.
    pub(super) fn field(&self, forces: &[Vector3<f32>]) -> Vec<f32> {
        let mut sum = vec![0.0; self.size()];
        let forces = forces.iter().flat_map(|force| <[f32; 3]>::from(*force));
        vectorised(
            #[inline(always)]
            || {
                for (force, row) in forces.clone().zip(self.entries.chunks_exact(self.size())) {
                    if force != 0.0 {
                        sum.iter_mut().zip(row).for_each(|(sum, c)| *sum += force * c);
                    }
                }
            },
        );
        sum
    }

    /// Adds to `rows` the displacement of the T cells that are `around` under unit forces along
    /// each axis (3, 3T), shared among the cells `loaded`.
    pub(super) fn add_rows(&self, loaded: [(u32, f32); 4], around: &Around, rows: &mut [f32]) {
        let Around { first, count } = *around;
        let (size, width) = (self.size(), 3 * count[1] as usize);
        let places = (first[0]..first[0] + count[0]).map(|x| x * self.count[1] + first[1]);
        vectorised(
            #[inline(always)]
            || {
                for (from, by) in loaded {
                    let mut rows = rows.chunks_exact_mut(width);
                    for axis in 0..3 {
                        let row = &self.entries[size * (3 * from as usize + axis)..][..size];
                        for place in places.clone() {
                            let part = &row[3 * place as usize..][..width];
                            let sum = rows.next().expect("a row for each axis and place");
                            sum.iter_mut().zip(part).for_each(|(sum, c)| *sum += by * c);
                        }
                    }
                }
            },
        );
    }

    /// Displacement around cell `at` under unit forces around cell `loaded` (m/N).
    #[inline(always)]
    pub(super) fn block(&self, loaded: u32, at: u32) -> Columns {
        let ([loaded, at], size) = ([loaded as usize, at as usize], self.size());
        let part = |axis| &self.entries[size * (3 * loaded + axis) + 3 * at..][..3];
        let [x, y, z] = [part(0), part(1), part(2)];
        [x[0], x[1], x[2], 0.0, y[0], y[1], y[2], 0.0, z[0], z[1], z[2], 0.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        compliance::nodal::grid::{CellGrid, CellLevels},
        deformation::Moduli,
    };

    #[test]
    fn sides_soften_what_is_near_them_and_not_what_is_far() {
        let outline = PadOutline::flat(0.032, 0.032, 0.003);
        let moduli = Moduli { young: 3e5, poisson: 0.47 };
        let sides = Sides::new(&outline, moduli, 300).unwrap();
        let grid = CellGrid::new(&CellLevels::new(&outline, [16; 2], 2, moduli, &sides), 0);
        // Change of the displacement of a cell along z under a force on it, over that by the layer.
        let change = |[i, j]: [u32; 2]| {
            let rank = 16 * i + j;
            grid.edges().block(rank, rank)[10] / grid.layer().at([0, 0])[10]
        };
        let (middle, corner) = (change([8, 8]), change([0, 0]));
        assert!(
            middle.abs() < 2e-3 && corner > 0.2,
            "{middle} in the middle, {corner} at a corner"
        );
    }
}
