//! Cells of a grid that shapes may touch in one load step, and their displacement under forces on
//! some.
//!
//! Displacement is kept as two parts: that of the layer by strips of cells, for which the kernel is
//! read as it lies in memory, and that of the sides around nodes of the face. In sweeps
//! only the strips with touching cells are active; the others are brought up to date between them.
//!
//! Shapes: N cells, B strips, T nodes around them, between which the influence of the sides is
//! interpolated. A displacement consists of those of all cells of the strips and of the nodes
//! ([`STRIP`] B + T, 3) in m.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use std::ops::Range;

use nalgebra::{Matrix3, Vector3};

use super::{
    grid::CellGrid,
    kernel::{STRIP, Table, matrix},
    side_compliance::Around,
};
use crate::simd::vectorised;

/// The cells, each identified by its number among them.
#[derive(Default)]
pub(super) struct Spots {
    /// Places in the grid along x and y (N).
    cells: Vec<[i32; 2]>,
    /// Rotations from the frames of the layer to that of the pad (N).
    tilts: Vec<Matrix3<f32>>,
    /// Place of each cell among those of the strips (N).
    places: Vec<u32>,
    /// First cell of each strip (B).
    strips: Vec<[i32; 2]>,
    /// Strips that follow every force, and those that do not.
    active: Vec<u32>,
    passive: Vec<u32>,
    /// Force on each cell that is included in the displacement of the passive strips (N).
    included: Vec<Vector3<f64>>,
    /// Nodes around each cell, with weights: by number, and by number among those of the rectangle
    /// that contains all (N).
    around: Vec<[(u32, f32); 4]>,
    numbers: Vec<[u32; 4]>,
    coarse: Around,
    /// Displacement around the nodes under unit forces on some cells (3, 3T each) in m/N, by the
    /// sides.
    rows: Vec<f32>,
    /// Place in `rows` of each cell's, if they have been computed (N).
    known: Vec<Option<usize>>,
}

impl Spots {
    /// Takes the cells of `ranks` (N) of a grid, ascending, for those before. All strips are active
    /// and the displacement is zero.
    pub(super) fn renew(
        &mut self,
        grid: &CellGrid,
        ranks: impl Iterator<Item = u32>,
        displacement: &mut Vec<f32>,
    ) {
        self.cells.clear();
        self.tilts.clear();
        self.places.clear();
        self.strips.clear();
        self.around.clear();
        self.numbers.clear();
        self.rows.clear();
        for rank in ranks {
            let cell = grid.cell(rank);
            self.cells.push(cell);
            self.tilts.push(grid.tilt(rank).cast());
            match self.strips.last() {
                Some(strip) if strip[0] == cell[0] && ((cell[1] - strip[1]) as usize) < STRIP => {}
                _ => self.strips.push(cell),
            }
            let last = self.strips.len() - 1;
            self.places.push((STRIP * last) as u32 + (cell[1] - self.strips[last][1]) as u32);
            self.around.push(grid.around(rank).map(|(node, share)| (node, share as f32)));
        }
        let place = |(node, _): (u32, f32)| grid.side_compliance().place(node);
        self.coarse = Around::of(self.around.iter().flatten().map(|&part| place(part)));
        let number = |part| self.coarse.number(place(part));
        self.numbers.extend(self.around.iter().map(|around| around.map(number)));
        self.included.clear();
        self.included.resize(self.cells.len(), Vector3::zeros());
        self.known.clear();
        self.known.resize(self.cells.len(), None);
        self.passive.clear();
        self.active.clear();
        self.active.extend(0..self.strips.len() as u32);
        displacement.clear();
        displacement.resize(3 * (STRIP * self.strips.len() + self.coarse.len()), 0.0);
    }

    /// Makes the strips of the `touching` cells active and the others passive. The displacement of
    /// the latter must include all forces. Returns the ranges of numbers of a displacement that
    /// follow every force.
    pub(super) fn activate(&mut self, touching: impl Iterator<Item = u32>) -> Vec<[usize; 2]> {
        self.active.clear();
        self.active.extend(touching.map(|cell| self.places[cell as usize] / STRIP as u32));
        self.active.dedup();
        self.passive.clear();
        let mut next = self.active.iter().peekable();
        let is_passive = |strip: &u32| next.next_if_eq(&strip).is_none();
        self.passive.extend((0..self.strips.len() as u32).filter(is_passive));
        let mut runs: Vec<[usize; 2]> = Vec::new();
        let strip = |first: usize| [first, first + 3 * STRIP];
        let active = self.active.iter().map(|&number| strip(3 * STRIP * number as usize));
        let sides = 3 * STRIP * self.strips.len();
        for run in active.chain([[sides, sides + 3 * self.coarse.len()]]) {
            match runs.last_mut() {
                Some([_, end]) if *end == run[0] => *end = run[1],
                _ => runs.push(run),
            }
        }
        runs
    }

    /// Size of the responses by the sides, the largest part, whether they are in use or not (bytes).
    pub(super) fn bytes(&self) -> usize {
        size_of::<f32>() * self.rows.capacity()
    }

    /// Displacement of a cell (m).
    pub(super) fn moved(&self, cell: usize, displacement: &[f32]) -> Vector3<f64> {
        let at = |place: usize| <[f32; 3]>::try_from(&displacement[3 * place..][..3]).unwrap();
        let by_layer = Vector3::from(at(self.places[cell] as usize));
        let mut sum: [f32; 3] = (self.tilts[cell] * by_layer).into();
        for (number, (_, share)) in self.parts(cell) {
            let by_sides = at(STRIP * self.strips.len() + number as usize);
            for i in 0..3 {
                sum[i] += share * by_sides[i];
            }
        }
        Vector3::from(sum).cast()
    }

    /// Adds to the displacement of the active strips, and around the nodes, the response to a
    /// `force` (N) on cell `loaded`.
    pub(super) fn add_response(
        &mut self,
        grid: &CellGrid,
        loaded: usize,
        force: &Vector3<f64>,
        displacement: &mut [f32],
    ) {
        let rows = self.rows(grid, loaded);
        let rows = &self.rows[rows];
        let (by_layer, by_sides) = displacement.split_at_mut(3 * STRIP * self.strips.len());
        let by_layer = by_layer.as_chunks_mut().0;
        let (from, force) = (self.cells[loaded], force.cast::<f32>());
        let in_layer = self.in_layer(loaded, &force);
        vectorised(
            #[inline(always)]
            || {
                add_strips(by_layer, (&self.active, &self.strips), grid.layer(), from, in_layer);
                add_rows(by_sides, rows, force.into());
            },
        );
    }

    /// Updates the displacement of the passive strips to the `force` (N) on a cell.
    pub(super) fn update_passive(
        &mut self,
        grid: &CellGrid,
        cell: usize,
        force: &Vector3<f64>,
        displacement: &mut [f32],
    ) {
        let news = force - self.included[cell];
        if news == Vector3::zeros() {
            return;
        }
        self.included[cell] = *force;
        let by_layer = displacement[..3 * STRIP * self.strips.len()].as_chunks_mut().0;
        let (from, force) = (self.cells[cell], self.in_layer(cell, &news.cast()));
        vectorised(
            #[inline(always)]
            || add_strips(by_layer, (&self.passive, &self.strips), grid.layer(), from, force),
        );
    }

    /// Displacement of a cell under unit forces on itself (m/N).
    pub(super) fn own_compliance(&mut self, grid: &CellGrid, cell: usize) -> Matrix3<f64> {
        let tilt = self.tilts[cell];
        let mut sum = tilt * matrix(&grid.layer().at([0, 0])) * tilt.transpose();
        let first = self.rows(grid, cell).start;
        let size = 3 * self.coarse.len();
        for (number, (_, share)) in self.parts(cell) {
            let at = |i, axis| self.rows[first + axis * size + 3 * number as usize + i];
            sum += Matrix3::from_fn(at) * share;
        }
        sum.cast()
    }

    /// A force on a cell in the frame of the layer.
    fn in_layer(&self, cell: usize, force: &Vector3<f32>) -> [f32; 3] {
        self.tilts[cell].tr_mul(force).into()
    }

    /// Nodes around a cell: number in the rectangle, number and weight.
    fn parts(&self, cell: usize) -> impl Iterator<Item = (u32, (u32, f32))> {
        self.numbers[cell].into_iter().zip(self.around[cell])
    }

    /// Place in `rows` of the responses to forces on cell `loaded`, which are computed on first
    /// use.
    fn rows(&mut self, grid: &CellGrid, loaded: usize) -> Range<usize> {
        let size = 9 * self.coarse.len();
        let first = self.known[loaded].unwrap_or_else(|| {
            let first = self.rows.len();
            self.rows.resize(first + size, 0.0);
            let rows = &mut self.rows[first..];
            grid.side_compliance().add_rows(self.around[loaded], &self.coarse, rows);
            first
        });
        self.known[loaded] = Some(first);
        first..first + size
    }
}

/// Adds to the displacement `sum` of those of the `strips` that are `chosen` the layer's response
/// to a `force` (N) on the cell `from`.
#[inline(always)]
fn add_strips(
    sum: &mut [[f32; 3 * STRIP]],
    (chosen, strips): (&[u32], &[[i32; 2]]),
    layer: &Table,
    from: [i32; 2],
    force: [f32; 3],
) {
    for &strip in chosen {
        let (sum, at) = (&mut sum[strip as usize], strips[strip as usize]);
        let away = [at[0] - from[0], at[1] - from[1]];
        if let Some([x, y, z]) = layer.strip(away) {
            for i in 0..sum.len() {
                sum[i] += force[0] * x[i] + force[1] * y[i] + force[2] * z[i];
            }
        } else {
            for (k, sum) in (0..).zip(sum.as_chunks_mut::<3>().0) {
                let moved = layer.moved([away[0], away[1] + k], force);
                for i in 0..3 {
                    sum[i] += moved[i];
                }
            }
        }
    }
}

#[inline(always)]
fn add_rows(sum: &mut [f32], rows: &[f32], force: [f32; 3]) {
    let (x, rest) = rows.split_at(sum.len());
    let (y, z) = rest.split_at(sum.len());
    for (((u, x), y), z) in sum.iter_mut().zip(x).zip(y).zip(z) {
        *u += force[0] * x + force[1] * y + force[2] * z;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        compliance::nodal::{grid::CellLevels, sides::Sides},
        deformation::Moduli,
        geometry::PadOutline,
    };

    #[test]
    fn rows_are_the_sums_over_layer_and_edges() {
        let outline = PadOutline::flat(0.02, 0.016, 0.004);
        let moduli = Moduli { young: 3e5, poisson: 0.47 };
        let sides = Sides::new(&outline, moduli, 250).unwrap();
        let cells = CellLevels::new(&outline, [12, 16], 4, moduli, &sides);
        for level in 0..4 {
            let grid = CellGrid::new(&cells, level);
            // Every few cells of the whole pad: at its sides and in its middle.
            let few = grid.len() / 40 + 1;
            let ranks: Vec<_> = (0..grid.len() as u32).step_by(few).collect();
            let forces: Vec<_> = (0..ranks.len())
                .step_by(5)
                .map(|k| (k, Vector3::new(0.3, -0.2 + 0.1 * k as f64, -1.0)))
                .collect();
            let mut spots = Spots::default();
            let mut displacement = Vec::new();
            spots.renew(&grid, ranks.iter().copied(), &mut displacement);
            // Half of the forces when all strips are active, the rest when few are.
            let (early, late) = forces.split_at(forces.len() / 2);
            for (k, force) in early {
                spots.add_response(&grid, *k, force, &mut displacement);
                spots.update_passive(&grid, *k, force, &mut displacement);
            }
            spots.activate((0..ranks.len() as u32).step_by(7));
            for (k, force) in late {
                spots.add_response(&grid, *k, force, &mut displacement);
            }
            for (k, force) in &forces {
                spots.update_passive(&grid, *k, force, &mut displacement);
            }
            let response = |loaded: u32, at: u32| -> Matrix3<f64> {
                let (from, to) = (grid.cell(loaded), grid.cell(at));
                let layer = matrix(&grid.layer().at([to[0] - from[0], to[1] - from[1]]));
                let mut sum = layer.cast::<f64>();
                for (from, by) in grid.around(loaded) {
                    for (to, share) in grid.around(at) {
                        let block = matrix(&grid.side_compliance().block(from, to));
                        sum += block.cast::<f64>() * (by * share);
                    }
                }
                sum
            };
            if level == 0 {
                // The sides' influence is averaged over both cells.
                let spread = |rank: u32| {
                    let points: Vec<_> = grid.points(rank, 3).collect();
                    points.into_iter().flat_map(|point| grid.side_compliance().around(&point))
                };
                let averaged = |loaded: u32, at: u32| -> Matrix3<f64> {
                    let (from, to) = (grid.cell(loaded), grid.cell(at));
                    let layer = matrix(&grid.layer().at([to[0] - from[0], to[1] - from[1]]));
                    let mut sum = layer.cast::<f64>();
                    for (from, by) in spread(loaded) {
                        for (to, share) in spread(at) {
                            let block = matrix(&grid.side_compliance().block(from, to));
                            sum += block.cast::<f64>() * (by * share / 81.0);
                        }
                    }
                    sum
                };
                let dense = grid.responses();
                for (&from, &to) in ranks.iter().zip(ranks.iter().rev()) {
                    let at = |i, axis| dense.at(from, axis, 3 * to as usize + i);
                    let (found, right) = (Matrix3::from_fn(at), averaged(from, to));
                    let most = averaged(from, from).norm();
                    assert!((found - right).norm() < 1e-4 * most, "{found} instead of {right}");
                }
            }
            let by_rank: Vec<_> = forces.iter().map(|(k, force)| (ranks[*k], *force)).collect();
            let field = grid.field(&by_rank);
            let most = displacement.iter().fold(0f32, |most, u| most.max(u.abs()));
            for (k, &rank) in ranks.iter().enumerate() {
                let sum = by_rank.iter().map(|(from, force)| response(*from, rank) * force);
                let right: Vector3<f64> = sum.sum();
                let found = spots.moved(k, &displacement);
                let error = (found - right).norm().max((field(rank) - right).norm());
                assert!(error < 1e-5 * f64::from(most), "{error} m of {most} m on level {level}");
            }
            for (k, &rank) in ranks.iter().enumerate() {
                let (own, right) = (spots.own_compliance(&grid, k), response(rank, rank));
                assert!((own - right).norm() < 1e-5 * right.norm(), "{own} instead of {right}");
            }
        }
    }
}
