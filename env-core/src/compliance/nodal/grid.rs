//! Regular grids of contact cells on the face of a pad, each with cells half as long as the one
//! before.
//!
//! The pad is a bonded elastic layer ([`LayerKernel`]) but for its sides, whose influence
//! ([`SideCompliance`]) is interpolated between nodes that are dense near them. Where its face is
//! inclined, forces and displacements turn with it.
//!
//! Shapes: M cells of a grid.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use std::{collections::BTreeMap, sync::Arc};

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use super::{
    kernel::{LayerKernel, Table, matrix},
    side_compliance::SideCompliance,
    sides::Sides,
};
use crate::{
    contact::gap,
    deformation::Moduli,
    geometry::{PadOutline, Shape},
    responses::Responses,
};

/// Cells of the first grid are grouped in squares of this many along each axis.
pub(super) const ROOT: u32 = 4;
/// Level from which squares of four cells are searched at their displaced positions, and not at
/// rest.
const MOVED: u32 = 2;
/// Greatest difference of the displacements of neighbouring cells, relative to half of a diagonal.
const BENT: f64 = 1.0;

/// Number of cells about equally near to a shape from which none is divided further: the shape is
/// wide against the cells.
const MANY: usize = 2000;

/// Number of grids with tables of heights. Those of all finer ones together take tens of megabytes.
const TABULATED: usize = 5;

/// Points along each side of a cell of the first grid over which the influence of the sides is
/// averaged.
const AVERAGED: u32 = 3;

/// Cells of the first grid, counted row after row along y.
struct FirstGrid {
    outline: PadOutline,
    /// Cells along x and y, and their sides (m).
    count: [u32; 2],
    sides: [f64; 2],
}

/// Data shared by the grids of a pad.
pub(super) struct CellLevels {
    /// The first grid. Numbers of cells along x and y are multiples of [`ROOT`].
    first: FirstGrid,
    kernel: LayerKernel,
    /// Height of the face over the centres of the cells of each of the first [`TABULATED`] grids
    /// (m).
    heights: Vec<Vec<f64>>,
    /// Compliance of the pad less that of the layer.
    side_compliance: SideCompliance,
}

/// One grid. Cells are counted row after row along y.
#[derive(Clone)]
pub(super) struct CellGrid {
    cells: Arc<CellLevels>,
    level: u32,
}

/// Height of the face over the centre of a cell of that `level`, given by its place along x and y
/// (m).
fn height(first: &FirstGrid, level: u32, [i, j]: [u32; 2]) -> f64 {
    let [nx, ny] = first.count.map(|count| count << level);
    let middle = |i: u32, n: u32, extent: f64| ((f64::from(i) + 0.5) / f64::from(n) - 0.5) * extent;
    let outline = &first.outline;
    outline.height(middle(i, nx, outline.width), middle(j, ny, outline.length))
}

impl CellLevels {
    /// Covers the face of a pad of these `moduli` with a first grid of `count` cells and finer
    /// ones, `levels` in all.
    pub(super) fn new(
        outline: &PadOutline,
        count: [u32; 2],
        levels: usize,
        moduli: Moduli,
        sides: &Sides,
    ) -> Arc<Self> {
        let sizes = [outline.width / f64::from(count[0]), outline.length / f64::from(count[1])];
        let first = FirstGrid { outline: *outline, count, sides: sizes };
        let kernel = LayerKernel::new(first.sides, levels, outline.thickness, moduli);
        let heights = |level: usize| -> Vec<f64> {
            let [nx, ny] = count.map(|count| count << level);
            let places = (0..nx).flat_map(|i| (0..ny).map(move |j| [i, j]));
            places.map(|cell| height(&first, level as u32, cell)).collect()
        };
        let heights = (0..levels.min(TABULATED)).map(heights).collect();
        let side_compliance = SideCompliance::new(sides);
        Arc::new(Self { first, kernel, heights, side_compliance })
    }

    /// Height of the face over the centre of a cell of that `level`, given by its place along x
    /// and y and by its rank (m).
    #[inline(always)]
    fn height(&self, level: u32, cell: [u32; 2], rank: u32) -> f64 {
        match self.heights.get(level as usize) {
            Some(heights) => heights[rank as usize],
            None => height(&self.first, level, cell),
        }
    }

    /// Point of the face over (x, y).
    fn on_face(&self, x: f64, y: f64) -> Point3<f64> {
        Point3::new(x, y, self.first.outline.height(x, y))
    }
}

impl CellGrid {
    /// The grid of that `level`, 0 for the first.
    pub(super) fn new(cells: &Arc<CellLevels>, level: u32) -> Self {
        Self { cells: Arc::clone(cells), level }
    }

    fn count(&self) -> [u32; 2] {
        let [nx, ny] = self.cells.first.count;
        [nx << self.level, ny << self.level]
    }

    /// Number of cells M.
    pub(super) fn len(&self) -> usize {
        let [nx, ny] = self.count();
        (nx * ny) as usize
    }

    /// Sides of a cell in plan (m).
    #[inline(always)]
    fn cell_size(&self) -> [f64; 2] {
        let ([x, y], parts) = (self.cells.first.sides, f64::from(1u32 << self.level));
        [x / parts, y / parts]
    }

    /// Area of a cell in plan (m²).
    pub(super) fn area(&self) -> f64 {
        self.cell_size().iter().product()
    }

    /// Longest side of a cell in plan (m).
    pub(super) fn longest_side(&self) -> f64 {
        self.cell_size().into_iter().fold(0.0, f64::max)
    }

    /// Half of a cell's diagonal, and a fifth more for slopes (m).
    pub(super) fn half_diagonal(&self) -> f64 {
        let [x, y] = self.cell_size();
        0.6 * x.hypot(y)
    }

    /// Place of a cell along x and y.
    pub(super) fn cell(&self, rank: u32) -> [i32; 2] {
        let rows = self.count()[1];
        [(rank / rows).cast_signed(), (rank % rows).cast_signed()]
    }

    /// Centre of a cell on the face at rest.
    pub(super) fn place(&self, rank: u32) -> Point3<f64> {
        let ([i, j], [a, b]) = (self.cell(rank), self.cell_size());
        let outline = &self.cells.first.outline;
        Point3::new(
            (f64::from(i) + 0.5) * a - 0.5 * outline.width,
            (f64::from(j) + 0.5) * b - 0.5 * outline.length,
            self.cells.height(self.level, [i, j].map(i32::cast_unsigned), rank),
        )
    }

    /// Outward unit normal of the face at rest at the centre of a cell.
    pub(super) fn normal(&self, rank: u32) -> Vector3<f64> {
        self.tilt(rank).column(2).into()
    }

    /// Rotation from the frame of the layer under a cell, whose z axis is the normal of the face,
    /// to that of the pad.
    pub(super) fn tilt(&self, rank: u32) -> Matrix3<f64> {
        self.tilt_at(&self.place(rank))
    }

    /// Rotation from the frame of the layer under a point of the face to that of the pad.
    pub(super) fn tilt_at(&self, point: &Point3<f64>) -> Matrix3<f64> {
        self.cells.first.outline.tilt(point.x, point.y)
    }

    /// Cell of the grid before that this cell is a quarter of.
    pub(super) fn parent(&self, rank: u32) -> u32 {
        let [i, j] = self.cell(rank);
        (i as u32 / 2) * (self.count()[1] / 2) + j as u32 / 2
    }

    /// Points on the face at rest that represent equal parts of a cell, `count` along each side.
    pub(super) fn points(&self, rank: u32, count: u32) -> impl Iterator<Item = Point3<f64>> {
        let (centre, sides, outline) =
            (self.place(rank), self.cell_size(), &self.cells.first.outline);
        let away = move |i: u32| (f64::from(i) + 0.5) / f64::from(count) - 0.5;
        (0..count * count).map(move |i| {
            let x = centre.x + sides[0] * away(i / count);
            let y = centre.y + sides[1] * away(i % count);
            Point3::new(x, y, outline.height(x, y))
        })
    }

    /// Quarters of a cell in the next grid.
    pub(super) fn children(&self, rank: u32) -> [u32; 4] {
        let [i, j] = self.cell(rank).map(|i| 2 * i as u32);
        [[0, 0], [0, 1], [1, 0], [1, 1]].map(|[a, b]| (i + a) * 2 * self.count()[1] + j + b)
    }

    /// The neighbours of a cell, corner to corner, too, that are counted after it.
    pub(super) fn later_neighbours(&self, rank: u32) -> impl Iterator<Item = u32> {
        let (count, cell) = (self.count().map(u32::cast_signed), self.cell(rank));
        let places = [[0, 1], [1, -1], [1, 0], [1, 1]].map(|[i, j]| [cell[0] + i, cell[1] + j]);
        let is_there = move |[i, j]: &[i32; 2]| *i < count[0] && (0..count[1]).contains(j);
        let rank = move |[i, j]: [i32; 2]| (i * count[1] + j).cast_unsigned();
        places.into_iter().filter(is_there).map(rank)
    }

    /// Outline of the pad.
    pub(super) fn outline(&self) -> &PadOutline {
        &self.cells.first.outline
    }

    /// Displacement of cells by the layer alone.
    pub(super) fn layer(&self) -> &Table {
        self.cells.kernel.level(self.level as usize)
    }

    /// Change of it by the sides, between the nodes [`CellGrid::around`] the cells.
    pub(super) fn side_compliance(&self) -> &SideCompliance {
        &self.cells.side_compliance
    }

    /// Displacement of a point of the plan under unit forces on a cell, by the layer alone (m/N).
    pub(super) fn at_point(&self, loaded: u32, point: &Point3<f64>) -> Matrix3<f32> {
        let (centre, sides) = (self.place(loaded), self.cell_size());
        let away = [(point.x - centre.x) / sides[0], (point.y - centre.y) / sides[1]];
        let [from, to] = [&centre, point].map(|point| self.tilt_at(point).cast::<f32>());
        to * self.layer().between(away.map(|cells| cells as f32)) * from.transpose()
    }

    /// Displacement of the cells under unit forces on each of them, if this is the first grid.
    pub(super) fn responses(&self) -> Responses {
        let count = self.len() as u32;
        let mut all = Responses::new(3 * count as usize);
        let spread: Vec<_> = (0..count).map(|cell| self.spread(cell)).collect();
        // Displacement around each node by the sides under forces spread over the loaded cell.
        let mut by_sides = vec![Matrix3::<f32>::zeros(); self.side_compliance().len()];
        let tilts: Vec<Matrix3<f32>> = (0..count).map(|cell| self.tilt(cell).cast()).collect();
        for loaded in 0..count {
            let (from, tilt) = (self.cell(loaded), tilts[loaded as usize].transpose());
            for (node, sum) in (0..).zip(&mut by_sides) {
                let part = |(from, share): &(u32, f32)| {
                    matrix(&self.side_compliance().block(*from, node)) * *share
                };
                *sum = spread[loaded as usize].iter().map(part).sum();
            }
            let response = |at: u32| {
                let to = self.cell(at);
                let by_layer = matrix(&self.layer().at([to[0] - from[0], to[1] - from[1]]));
                let part = |(node, share): &(u32, f32)| by_sides[*node as usize] * *share;
                let by_sides: Matrix3<f32> = spread[at as usize].iter().map(part).sum();
                tilts[at as usize] * by_layer * tilt + by_sides
            };
            let blocks: Vec<_> = (0..count).map(response).collect();
            for axis in 0..3 {
                let part = |block: &Matrix3<f32>| <[f32; 3]>::from(block.column(axis));
                all.push(blocks.iter().flat_map(part).map(f64::from));
            }
        }
        all
    }

    /// Displacement of a point of the plan at some distance (m) from a cell under a `force` (N) on
    /// it, by the layer alone (m).
    #[inline(always)]
    pub(super) fn under(&self, away: [f64; 2], force: [f32; 3]) -> [f32; 3] {
        let sides = self.cell_size();
        self.layer().under([(away[0] / sides[0]) as f32, (away[1] / sides[1]) as f32], force)
    }

    /// Nodes of [`CellGrid::side_compliance`] around a cell, with weights that sum to 1.
    pub(super) fn around(&self, rank: u32) -> [(u32, f64); 4] {
        self.side_compliance().around(&self.place(rank))
    }

    /// Nodes around points that are spread over a cell, with weights that sum to 1.
    fn spread(&self, rank: u32) -> Vec<(u32, f32)> {
        let mut nodes = BTreeMap::<u32, f32>::new();
        let share = 1.0 / f64::from(AVERAGED * AVERAGED);
        for point in self.points(rank, AVERAGED) {
            for (node, part) in self.side_compliance().around(&point) {
                *nodes.entry(node).or_default() += (part * share) as f32;
            }
        }
        nodes.into_iter().collect()
    }

    /// Displacement (m) of cells under forces (N) on some.
    pub(super) fn field<'a>(
        &'a self,
        forces: &[(u32, Vector3<f64>)],
    ) -> impl Fn(u32) -> Vector3<f64> + 'a {
        let mut around = vec![Vector3::<f32>::zeros(); self.side_compliance().len()];
        for (rank, force) in forces {
            for (node, share) in self.around(*rank) {
                around[node as usize] += (force * share).cast::<f32>();
            }
        }
        let by_sides = self.side_compliance().field(&around);
        let in_layer = |(rank, force): &(u32, Vector3<f64>)| {
            (self.cell(*rank), self.tilt(*rank).tr_mul(force).cast::<f32>().into())
        };
        let loaded: Vec<_> = forces.iter().map(in_layer).collect();
        move |rank| {
            let by_layer = Vector3::<f32>::from(self.layer().sum(self.cell(rank), &loaded));
            let mut sum = self.tilt(rank) * by_layer.cast::<f64>();
            if !loaded.is_empty() {
                for (to, share) in self.around(rank) {
                    let by_sides: [f32; 3] = std::array::from_fn(|i| by_sides[3 * to as usize + i]);
                    sum += Vector3::from(by_sides).cast::<f64>() * share;
                }
            }
            sum
        }
    }

    /// Cells that, displaced under `forces` (N), are within `reach` (m) of one of `shapes` at
    /// `poses`, with some that are not; `None` if about `most` are found to lie inside. No cell may
    /// be displaced by more than `room` − `reach`.
    pub(super) fn near(
        &self,
        (shapes, poses): (&[Shape], &[Isometry3<f64>]),
        forces: &[(u32, Vector3<f64>)],
        [room, reach]: [f64; 2],
        most: usize,
    ) -> Option<Vec<u32>> {
        let field = self.field(forces);
        let (mut found, mut inside) = (Vec::new(), 0);
        // Squares still to be searched: cells along a side in units of this grid, first cell, and
        // displacement if it is known.
        let root = ROOT << self.level;
        let [nx, ny] = self.count().map(|count| count / root);
        let mut open: Vec<(u32, [u32; 2], Option<Vector3<f64>>)> =
            (0..nx * ny).map(|k| (root, [k / ny * root, k % ny * root], None)).collect();
        let rows = self.count()[1];
        let sides = self.cell_size();
        let outline = &self.cells.first.outline;
        while let Some((size, [i, j], moved)) = open.pop() {
            let rank = (i + size / 2) * rows + j + size / 2;
            if size == 1 {
                let place = self.place(rank) + moved.unwrap_or_default();
                let gap = gap(shapes, poses, &place);
                let enough = match moved {
                    _ if forces.is_empty() => reach,
                    Some(_) => reach + BENT * self.half_diagonal(),
                    None => room,
                };
                if gap < enough {
                    found.push(rank);
                    let is_placed = moved.is_some() || forces.is_empty();
                    inside += usize::from(is_placed && gap < 0.0);
                    if inside > most {
                        return None;
                    }
                }
                continue;
            }
            let half = 0.5 * f64::from(size);
            let centre = self.cells.on_face(
                (f64::from(i) + half) * sides[0] - 0.5 * outline.width,
                (f64::from(j) + half) * sides[1] - 0.5 * outline.length,
            );
            let around = f64::from(size) * self.half_diagonal();
            let is_small = size << MOVED <= 2 << self.level;
            let moved = (is_small && !forces.is_empty()).then(|| field(rank));
            let gap = gap(shapes, poses, &(centre + moved.unwrap_or_default()));
            let enough = if moved.is_some() { 1.5 * around + reach } else { around + room };
            if gap < enough {
                let half = size / 2;
                for (i, j) in [(i, j), (i, j + half), (i + half, j), (i + half, j + half)] {
                    open.push((half, [i, j], moved));
                }
            }
        }
        Some(found)
    }

    /// Smallest distance of `shapes` at `poses` from a cell at rest (m).
    pub(super) fn clearance(&self, shapes: &[Shape], poses: &[Isometry3<f64>]) -> f64 {
        let first = Self::new(&self.cells, 0);
        let gap = |grid: &Self, rank: u32| gap(shapes, poses, &grid.place(rank));
        let mut open: Vec<_> =
            (0..first.len() as u32).map(|rank| (gap(&first, rank), rank)).collect();
        let mut grid = first;
        loop {
            let nearest = open.iter().map(|(gap, _)| *gap).fold(f64::INFINITY, f64::min);
            if grid.level == self.level || open.len() > MANY {
                return nearest;
            }
            // A cell's own points are nearer than its centre by half of its diagonal at most.
            let reach = nearest + 2.0 * grid.half_diagonal();
            let next = Self::new(&self.cells, grid.level + 1);
            let quarters = open.iter().filter(|(gap, _)| *gap < reach);
            open = quarters
                .flat_map(|(_, rank)| grid.children(*rank))
                .map(|rank| (gap(&next, rank), rank))
                .collect();
            grid = next;
        }
    }
}
