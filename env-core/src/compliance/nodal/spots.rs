//! Cells of a grid that shapes may touch in one load step, and their responses to forces on some.
//!
//! Shapes: N cells, T cells of the first grid around them.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use nalgebra::{Matrix3, Vector3};

use super::{
    grid::Grid,
    kernel::{Columns, Table, matrix},
};
use crate::simd::vectorised;

/// The cells, each known by its number among them.
#[derive(Default)]
pub(super) struct Spots {
    /// Places in the grid along x and y (N).
    cells: Vec<[i32; 2]>,
    /// Cells of the first grid around each cell, by number among `coarse`, with weights (N).
    around: Vec<[(u32, f32); 4]>,
    /// Cells of the first grid around some cell (T).
    coarse: Vec<u32>,
    /// Displacement of all cells under unit forces on some (3, 3N each) in m/N.
    rows: Vec<f32>,
    /// Place in `rows` of each cell (N), if it is known.
    known: Vec<Option<usize>>,
    /// Displacement around the first grid's cells under unit forces on a cell (T), if it is not zero.
    by_edges: Vec<Columns>,
}

impl Spots {
    /// Takes the cells of `ranks` (N) of a grid for those before.
    pub(super) fn renew(&mut self, grid: &Grid, ranks: impl Iterator<Item = u32>) {
        const NONE: u32 = u32::MAX;
        self.cells.clear();
        self.rows.clear();
        self.known.clear();
        self.coarse.clear();
        self.around.clear();
        let mut numbers: Vec<u32> = Vec::new();
        for rank in ranks {
            self.cells.push(grid.cell(rank));
            self.known.push(None);
            self.around.push(grid.around(rank).map(|(cell, share)| {
                if numbers.len() <= cell as usize {
                    numbers.resize(cell as usize + 1, NONE);
                }
                let number = &mut numbers[cell as usize];
                if *number == NONE {
                    *number = self.coarse.len() as u32;
                    self.coarse.push(cell);
                }
                (*number, share as f32)
            }));
        }
    }

    /// Adds to the displacement of all cells (3N) in m the response to a `force` (N) on cell `loaded`.
    pub(super) fn give_way(
        &mut self,
        grid: &Grid,
        loaded: usize,
        force: &Vector3<f64>,
        displacement: &mut [f32],
    ) {
        let first = self.row(grid, loaded);
        let rows = &self.rows[first..first + 9 * self.cells.len()];
        let force: [f32; 3] = force.cast::<f32>().into();
        vectorised(
            #[inline(always)]
            || add_rows(displacement, rows, force),
        );
    }

    /// Displacement of a cell under unit forces on itself (m/N).
    pub(super) fn own(&self, grid: &Grid, cell: usize) -> Matrix3<f64> {
        let mut sum = grid.layer().at([0, 0]);
        if let Some(edges) = grid.edges() {
            let around = self.around[cell].map(|(number, by)| (self.coarse[number as usize], by));
            for (from, by) in around {
                for (to, share) in around {
                    if let Some(block) = edges.block(from, to) {
                        sum.iter_mut().zip(block).for_each(|(sum, c)| *sum += by * share * c);
                    }
                }
            }
        }
        matrix(&sum).cast()
    }

    /// Place in `rows` of the responses to forces on cell `loaded`, which are computed if they are
    /// not known.
    fn row(&mut self, grid: &Grid, loaded: usize) -> usize {
        if let Some(first) = self.known[loaded] {
            return first;
        }
        let Self { cells, around, coarse, rows, known, by_edges } = self;
        by_edges.clear();
        if let Some(edges) = grid.edges() {
            let from = around[loaded].map(|(number, by)| (coarse[number as usize], by));
            by_edges.extend(coarse.iter().map(|&to| {
                let mut sum = Columns::default();
                for (from, by) in from {
                    if let Some(block) = edges.block(from, to) {
                        sum.iter_mut().zip(block).for_each(|(sum, c)| *sum += by * c);
                    }
                }
                sum
            }));
            // Far from the sides the edges do not matter.
            if by_edges.iter().flatten().all(|c| *c == 0.0) {
                by_edges.clear();
            }
        }
        let first = rows.len();
        rows.resize(first + 9 * cells.len(), 0.0);
        let (layer, from) = (grid.layer(), cells[loaded]);
        vectorised(
            #[inline(always)]
            || fill(&mut rows[first..], layer, from, cells, around, by_edges),
        );
        known[loaded] = Some(first);
        first
    }
}

/// Fills `rows` (3, 3N) with the displacement of `cells` (N) under unit forces on cell `from`.
#[inline(always)]
fn fill(
    rows: &mut [f32],
    layer: &Table,
    from: [i32; 2],
    cells: &[[i32; 2]],
    around: &[[(u32, f32); 4]],
    by_edges: &[Columns],
) {
    let (x, rest) = rows.split_at_mut(3 * cells.len());
    let (y, z) = rest.split_at_mut(3 * cells.len());
    let (x, y, z) = (x.as_chunks_mut::<3>().0, y.as_chunks_mut::<3>().0, z.as_chunks_mut::<3>().0);
    for ((((cell, around), x), y), z) in cells.iter().zip(around).zip(x).zip(y).zip(z) {
        let mut columns = layer.at([cell[0] - from[0], cell[1] - from[1]]);
        if !by_edges.is_empty() {
            for (to, share) in around {
                let response = &by_edges[*to as usize];
                for i in 0..columns.len() {
                    columns[i] += share * response[i];
                }
            }
        }
        let [x0, x1, x2, _, y0, y1, y2, _, z0, z1, z2, _] = columns;
        (*x, *y, *z) = ([x0, x1, x2], [y0, y1, y2], [z0, z1, z2]);
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
        compliance::{Compliance, Options, nodal::grid::Cells},
        deformation::{Moduli, SoftBody},
        geometry::{PadMesh, PadOutline},
    };

    #[test]
    fn rows_are_the_sums_over_layer_and_edges() {
        let outline = PadOutline::flat(0.02, 0.016, 0.004);
        let pad = PadMesh::with_nodes(&outline, 900).unwrap();
        let moduli = Moduli { young: 3e5, poisson: 0.47 };
        let law = crate::deformation::Law::default();
        let body = SoftBody::new(pad.mesh.clone(), law, moduli, &pad.base).unwrap();
        let model = Compliance::new(body, Options { friction: 0.8, sweeps: 0 }).unwrap();
        let cells = Cells::new(&outline, [12, 16], 4, &model.condensed, &pad);
        for level in 0..4 {
            let grid = Grid::new(&cells, level);
            // Every few cells of the whole pad: at its sides and in its middle.
            let few = grid.len() / 40 + 1;
            let ranks: Vec<_> = (0..grid.len() as u32).step_by(few).collect();
            let forces: Vec<_> = (0..ranks.len())
                .step_by(5)
                .map(|k| (k, Vector3::new(0.3, -0.2 + 0.1 * k as f64, -1.0)))
                .collect();
            let mut spots = Spots::default();
            spots.renew(&grid, ranks.iter().copied());
            let mut displacement = vec![0.0; 3 * ranks.len()];
            for (k, force) in &forces {
                spots.give_way(&grid, *k, force, &mut displacement);
            }
            let response = |loaded: u32, at: u32| -> Matrix3<f64> {
                let (from, to) = (grid.cell(loaded), grid.cell(at));
                let layer = matrix(&grid.layer().at([to[0] - from[0], to[1] - from[1]]));
                let edges = grid.edges().unwrap();
                let mut sum = layer.cast::<f64>();
                for (from, by) in grid.around(loaded) {
                    for (to, share) in grid.around(at) {
                        let block = edges.block(from, to).map_or_else(Matrix3::zeros, matrix);
                        sum += block.cast::<f64>() * (by * share);
                    }
                }
                sum
            };
            let by_rank: Vec<_> = forces.iter().map(|(k, force)| (ranks[*k], *force)).collect();
            let mut field = grid.field(&by_rank);
            let most = displacement.iter().fold(0f32, |most, u| most.max(u.abs()));
            for (&rank, found) in ranks.iter().zip(displacement.as_chunks::<3>().0) {
                let sum = by_rank.iter().map(|(from, force)| response(*from, rank) * force);
                let right: Vector3<f64> = sum.sum();
                let found = Vector3::from(*found).cast::<f64>();
                let error = (found - right).norm().max((field(rank) - right).norm());
                assert!(error < 1e-5 * f64::from(most), "{error} m of {most} m on level {level}");
            }
            for (k, &rank) in ranks.iter().enumerate() {
                let (own, right) = (spots.own(&grid, k), response(rank, rank));
                assert!((own - right).norm() < 1e-5 * right.norm(), "{own} instead of {right}");
            }
        }
    }
}
