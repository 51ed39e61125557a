//! Regular grids of contact cells on the face of a pad, each with cells half as long as the one
//! before.
//!
//! The pad is a bonded elastic layer ([`LayerKernel`]) but near its sides. What these and the rim
//! change is smooth, and is taken from finite elements: [`SideCompliance`] is the difference of both
//! compliances between tractions that fall off linearly around the cells of the first grid, and is
//! interpolated between their centres. Far from the sides it would be the error of the elements, and
//! is left out: 2 % in the force of a contact that is as wide as half of a pad. Where that matters,
//! the difference is that of the elements of the pad and of elements of a layer on the same nodes,
//! whose errors are the same, everywhere.
//!
//! Shapes: M cells of a grid, N of them, C cells of the first grid.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use std::sync::Arc;

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use rayon::prelude::*;

use super::{
    contact_nodes::{Shares, areas, condensed_between},
    kernel::{Columns, LayerKernel, Table, matrix},
    layer_elements::LayerElements,
    patch::nearest,
};
use crate::{
    compliance::condensed::Condensed,
    deformation::Moduli,
    geometry::{PadMesh, PadOutline, Shape},
    responses::Responses,
    simd::vectorised,
};

/// Cells of the first grid are grouped in squares of this many along each axis.
pub(super) const ROOT: u32 = 4;
/// Level from which squares of four cells are searched at their displaced positions, and not at
/// rest.
const MOVED: u32 = 2;
/// Greatest difference of the displacements of neighbouring cells, relative to half of a diagonal.
const BENT: f64 = 1.0;

/// Number of cells about equally near to a shape that are not divided further: it is wider than
/// they are.
const MANY: usize = 2000;

/// Distances from the sides, in thicknesses, within which all and beyond which nothing of the
/// elements' difference from the layer is due to the sides.
const SIDES: [f64; 2] = [0.5, 1.25];

/// Data shared by the grids of a pad.
pub(super) struct CellLevels {
    outline: PadOutline,
    /// Cells of the first grid along x and y, multiples of [`ROOT`], and their sides (m).
    count: [u32; 2],
    sides: [f64; 2],
    kernel: Arc<LayerKernel>,
    /// Height of the face over the centres of the cells of each grid (m).
    heights: Arc<Vec<Vec<f64>>>,
    /// Compliance of the pad less that of the layer.
    edges: Option<SideCompliance>,
}

/// One grid. Cells are counted row after row along y.
#[derive(Clone)]
pub(super) struct CellGrid {
    cells: Arc<CellLevels>,
    level: u32,
}

/// Compliance of a pad less that of a layer, between tractions around the cells of the first grid.
pub(super) struct SideCompliance {
    /// Displacement around all cells under unit forces around each along each axis (3C, 3C) in m/N.
    entries: Vec<f32>,
    /// `true` for cells where forces on them or their displacement are changed (C).
    is_near: Vec<bool>,
    /// Cells along y.
    rows: u32,
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

impl CellLevels {
    /// Covers the face of a pad with a first grid of `count` cells and finer ones, `levels` in all.
    /// The influence of the sides is that of the elements `condensed` on a `fine` mesh: everywhere if
    /// there are elements of a `layer` on that mesh, else only near the sides.
    pub(super) fn new(
        outline: &PadOutline,
        count: [u32; 2],
        levels: usize,
        (condensed, fine): (&Condensed, &PadMesh),
        layer: Option<&LayerElements>,
    ) -> Arc<Self> {
        let moduli: Moduli = condensed.body.moduli()[0];
        let sides = [outline.width / f64::from(count[0]), outline.length / f64::from(count[1])];
        let kernel = Arc::new(LayerKernel::new(sides, levels, outline.thickness, moduli));
        let outline = *outline;
        let heights = |level: u32| -> Vec<f64> {
            let [nx, ny] = count.map(|count| count << level);
            let middle =
                |i: u32, n: u32, extent: f64| ((f64::from(i) + 0.5) / f64::from(n) - 0.5) * extent;
            let places = (0..nx).flat_map(|i| (0..ny).map(move |j| (i, j)));
            let height = |(i, j)| {
                outline.height(middle(i, nx, outline.width), middle(j, ny, outline.length))
            };
            places.map(height).collect()
        };
        let heights = Arc::new((0..levels as u32).map(heights).collect());
        let mut all = Self { outline, count, sides, kernel, heights, edges: None };
        let without_sides = Arc::new(Self {
            kernel: Arc::clone(&all.kernel),
            heights: Arc::clone(&all.heights),
            ..all
        });
        let grid = CellGrid::new(&without_sides, 1);
        all.edges = Some(match layer {
            Some(layer) => SideCompliance::everywhere(condensed, fine, &grid, layer),
            None => SideCompliance::near_sides(condensed, fine, &grid),
        });
        Arc::new(all)
    }

    /// Cells of the first grid between whose centres a point of the plan lies, with weights that sum
    /// to 1; the outermost hold to the edge.
    fn around(&self, x: f64, y: f64) -> [(u32, f64); 4] {
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

    /// Share of the elements' difference from the layer that is due to the sides at (x, y): 1 near
    /// them, 0 far from them.
    pub(super) fn share_of_sides(&self, x: f64, y: f64) -> f64 {
        let room = |p: f64, extent: f64| 0.5 * extent - p.abs();
        let inwards = room(x, self.outline.width).min(room(y, self.outline.length));
        let [near, far] = SIDES.map(|thicknesses| thicknesses * self.outline.thickness);
        let share = ((far - inwards) / (far - near)).clamp(0.0, 1.0);
        share * share * (3.0 - 2.0 * share)
    }

    /// Point of the face over (x, y).
    fn on_face(&self, x: f64, y: f64) -> Point3<f64> {
        Point3::new(x, y, self.outline.height(x, y))
    }
}

impl CellGrid {
    /// The grid of that `level`, 0 for the first.
    pub(super) fn new(cells: &Arc<CellLevels>, level: u32) -> Self {
        Self { cells: Arc::clone(cells), level }
    }

    fn count(&self) -> [u32; 2] {
        let [nx, ny] = self.cells.count;
        [nx << self.level, ny << self.level]
    }

    /// Number of cells M.
    pub(super) fn len(&self) -> usize {
        let [nx, ny] = self.count();
        (nx * ny) as usize
    }

    /// Sides of a cell in plan (m).
    #[inline(always)]
    fn sides(&self) -> [f64; 2] {
        let ([x, y], parts) = (self.cells.sides, f64::from(1u32 << self.level));
        [x / parts, y / parts]
    }

    /// Area of a cell in plan (m²).
    pub(super) fn area(&self) -> f64 {
        self.sides().iter().product()
    }

    /// Longest side of a cell in plan (m).
    pub(super) fn longest_side(&self) -> f64 {
        self.sides().into_iter().fold(0.0, f64::max)
    }

    /// Half of a cell's diagonal, and a fifth more for slopes (m).
    pub(super) fn half_diagonal(&self) -> f64 {
        let [x, y] = self.sides();
        0.6 * x.hypot(y)
    }

    /// Place of a cell along x and y.
    pub(super) fn cell(&self, rank: u32) -> [i32; 2] {
        let rows = self.count()[1];
        [(rank / rows).cast_signed(), (rank % rows).cast_signed()]
    }

    /// Centre of a cell on the face at rest.
    pub(super) fn place(&self, rank: u32) -> Point3<f64> {
        let ([i, j], [a, b]) = (self.cell(rank), self.sides());
        let outline = &self.cells.outline;
        Point3::new(
            (f64::from(i) + 0.5) * a - 0.5 * outline.width,
            (f64::from(j) + 0.5) * b - 0.5 * outline.length,
            self.cells.heights[self.level as usize][rank as usize],
        )
    }

    /// Outward unit normal of the face at rest at the centre of a cell.
    pub(super) fn normal(&self, rank: u32) -> Vector3<f64> {
        const STEP: f64 = 1e-6;
        let (at, height) = (self.place(rank), |x, y| self.cells.outline.height(x, y));
        let dx = height(at.x + STEP, at.y) - height(at.x - STEP, at.y);
        let dy = height(at.x, at.y + STEP) - height(at.x, at.y - STEP);
        Vector3::new(-dx, -dy, 2.0 * STEP).normalize()
    }

    /// Cell of the grid before that this cell is a quarter of.
    pub(super) fn parent(&self, rank: u32) -> u32 {
        let [i, j] = self.cell(rank);
        (i as u32 / 2) * (self.count()[1] / 2) + j as u32 / 2
    }

    /// Points on the face at rest that represent equal parts of a cell, `count` along each side.
    pub(super) fn points(&self, rank: u32, count: u32) -> impl Iterator<Item = Point3<f64>> {
        let (centre, sides, outline) = (self.place(rank), self.sides(), &self.cells.outline);
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

    /// Displacement of cells by the layer alone.
    pub(super) fn layer(&self) -> &Table {
        self.cells.kernel.level(self.level as usize)
    }

    /// Change of it by the sides, between [`CellGrid::around`] the cells.
    pub(super) fn edges(&self) -> Option<&SideCompliance> {
        self.cells.edges.as_ref()
    }

    /// Displacement of a point of the plan under unit forces on a cell, by the layer alone (m/N).
    pub(super) fn at_point(&self, loaded: u32, point: &Point3<f64>) -> Matrix3<f32> {
        let (centre, sides) = (self.place(loaded), self.sides());
        let away = [(point.x - centre.x) / sides[0], (point.y - centre.y) / sides[1]];
        self.layer().between(away.map(|cells| cells as f32))
    }

    /// Displacement of the cells under unit forces on each of them, if this is the first grid.
    pub(super) fn responses(&self) -> Responses {
        let count = self.len() as u32;
        let mut all = Responses::new(3 * count as usize);
        for loaded in 0..count {
            let from = self.cell(loaded);
            let response = |at: u32| {
                let to = self.cell(at);
                let mut sum = self.layer().at([to[0] - from[0], to[1] - from[1]]);
                if let Some(block) = self.edges().and_then(|edges| edges.block(loaded, at)) {
                    sum.iter_mut().zip(block).for_each(|(sum, c)| *sum += c);
                }
                sum
            };
            let columns: Vec<_> = (0..count).map(response).collect();
            for axis in 0..3 {
                let part = |columns: &Columns| [0, 1, 2].map(|i| f64::from(columns[4 * axis + i]));
                all.push(columns.iter().flat_map(part));
            }
        }
        all
    }

    /// Displacement of a point of the plan at some distance (m) from a cell under a `force` (N) on
    /// it, by the layer alone (m).
    #[inline(always)]
    pub(super) fn under(&self, away: [f64; 2], force: [f32; 3]) -> [f32; 3] {
        let sides = self.sides();
        self.layer().under([(away[0] / sides[0]) as f32, (away[1] / sides[1]) as f32], force)
    }

    /// Data shared by all grids of the pad.
    pub(super) fn cells(&self) -> &CellLevels {
        &self.cells
    }

    /// Place along x and y of a cell of the first grid.
    pub(super) fn first_cell(&self, rank: u32) -> [u32; 2] {
        let rows = self.cells.count[1];
        [rank / rows, rank % rows]
    }

    /// Cells of the first grid around a cell, with weights that sum to 1.
    pub(super) fn around(&self, rank: u32) -> [(u32, f64); 4] {
        let place = self.place(rank);
        self.cells.around(place.x, place.y)
    }

    /// Displacement (m) of cells under forces (N) on some.
    pub(super) fn field<'a>(
        &'a self,
        forces: &[(u32, Vector3<f64>)],
    ) -> impl Fn(u32) -> Vector3<f64> + 'a {
        let [nx, ny] = self.cells.count;
        let mut around = vec![Vector3::<f32>::zeros(); (nx * ny) as usize];
        for (rank, force) in forces {
            for (cell, share) in self.around(*rank) {
                around[cell as usize] += (force * share).cast::<f32>();
            }
        }
        let by_edges = self.edges().map(|edges| edges.field(&around));
        let loaded: Vec<_> =
            forces.iter().map(|(rank, f)| (self.cell(*rank), f.cast::<f32>().into())).collect();
        move |rank| {
            let mut sum =
                Vector3::<f32>::from(self.layer().sum(self.cell(rank), &loaded)).cast::<f64>();
            if let Some(by_edges) = &by_edges
                && !loaded.is_empty()
            {
                for (to, share) in self.around(rank) {
                    let by_edges: [f32; 3] = std::array::from_fn(|i| by_edges[3 * to as usize + i]);
                    sum += Vector3::from(by_edges).cast::<f64>() * share;
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
        let sides = self.sides();
        let outline = &self.cells.outline;
        while let Some((size, [i, j], moved)) = open.pop() {
            let rank = (i + size / 2) * rows + j + size / 2;
            if size == 1 {
                let place = self.place(rank) + moved.unwrap_or_default();
                let gap = nearest(shapes, poses, &place).1.value;
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
            let gap = nearest(shapes, poses, &(centre + moved.unwrap_or_default())).1.value;
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
        let gap = |grid: &Self, rank: u32| nearest(shapes, poses, &grid.place(rank)).1.value;
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

/// Skin nodes that bear tractions around each cell of the first grid, with shares of the force.
fn loads(condensed: &Condensed, fine: &PadMesh, cells: &CellLevels) -> Vec<Shares> {
    let areas = areas(condensed);
    let mut loads: Vec<Shares> = vec![Vec::new(); (cells.count[0] * cells.count[1]) as usize];
    for &node in &fine.face {
        let place = &condensed.rest.places()[node as usize];
        let Some(rank) = condensed.rank_of(node) else { continue };
        for (cell, share) in cells.around(place.x, place.y) {
            if share > 1e-9 {
                loads[cell as usize].push((rank as u32, share * areas[rank]));
            }
        }
    }
    normalised(loads)
}

/// Scales shares so that those of each load sum to 1.
fn normalised(mut loads: Vec<Shares>) -> Vec<Shares> {
    for loads in &mut loads {
        let sum: f64 = loads.iter().map(|(_, share)| share).sum();
        for (_, share) in loads {
            *share /= sum;
        }
    }
    loads
}

impl SideCompliance {
    /// Subtracts the compliance of elements of a `layer` from that of the elements `condensed` on the
    /// same `fine` mesh of the pad that `grid` covers.
    fn everywhere(
        condensed: &Condensed,
        fine: &PadMesh,
        grid: &CellGrid,
        layer: &LayerElements,
    ) -> Self {
        let cells = &grid.cells;
        let loads = loads(condensed, fine, cells);
        let elements = condensed_between(condensed, &loads, &loads);
        let node = |rank: u32| condensed.skin[rank as usize] as usize;
        let rows = |workspace: &mut _, from: &Shares| -> Vec<f64> {
            let rows = [0, 1, 2].map(|axis| {
                let mut forces = vec![Vector3::zeros(); fine.mesh.vertices.len()];
                for (rank, share) in from {
                    forces[node(*rank)][axis] = *share;
                }
                let moved = layer.displacement(&forces, workspace);
                let seen = |to: &Shares| -> [f64; 3] {
                    let part = |(rank, share): &(u32, f64)| moved[node(*rank)] * *share;
                    to.iter().map(part).sum::<Vector3<_>>().into()
                };
                loads.iter().flat_map(seen).collect::<Vec<_>>()
            });
            rows.concat()
        };
        // The layer and its mesh are their own mirror images, so that a quarter of the cells tell all.
        let [nx, ny] = cells.count.map(|count| count as usize);
        let quarter: Vec<_> = (0..nx.div_ceil(2))
            .flat_map(|i| (0..ny.div_ceil(2)).map(move |j| i * ny + j))
            .collect();
        let known: Vec<_> = quarter
            .par_iter()
            .map_init(|| layer.workspace(), |workspace, cell| rows(workspace, &loads[*cell]))
            .collect();
        let width = 3 * loads.len();
        let mut entries = Vec::with_capacity(width * width);
        for (loaded, axis) in (0..loads.len()).flat_map(|cell| [0, 1, 2].map(|axis| (cell, axis))) {
            let [i, j] = [loaded / ny, loaded % ny];
            let mirrored = [2 * i >= nx, 2 * j >= ny];
            let image = |[i, j]: [usize; 2]| {
                [if mirrored[0] { nx - 1 - i } else { i }, if mirrored[1] { ny - 1 - j } else { j }]
            };
            let sign = |axis: usize| if axis < 2 && mirrored[axis] { -1.0 } else { 1.0 };
            let [a, b] = image([i, j]);
            let row = &known[a * ny.div_ceil(2) + b][width * axis..][..width];
            for (at, seen) in (0..loads.len()).flat_map(|cell| [0, 1, 2].map(|seen| (cell, seen))) {
                let [a, b] = image([at / ny, at % ny]);
                let by_layer = sign(axis) * sign(seen) * row[3 * (a * ny + b) + seen];
                let found = elements.at(loaded as u32, axis, 3 * at + seen);
                entries.push((found - by_layer) as f32);
            }
        }
        Self { entries, is_near: vec![true; loads.len()], rows: cells.count[1] }
    }

    /// Subtracts the compliance of the layer, from a `grid` of cells smaller than the first, from
    /// that of the elements `condensed` on a `fine` mesh, where cells are near the sides.
    fn near_sides(condensed: &Condensed, fine: &PadMesh, grid: &CellGrid) -> Self {
        let cells = &grid.cells;
        let size = (cells.count[0] * cells.count[1]) as usize;
        let loads = loads(condensed, fine, cells);
        let elements = condensed_between(condensed, &loads, &loads);
        let mut tents: Vec<Shares> = vec![Vec::new(); size];
        for rank in 0..grid.len() as u32 {
            for (cell, share) in grid.around(rank) {
                if share > 1e-9 {
                    tents[cell as usize].push((rank, share));
                }
            }
        }
        let tents = normalised(tents);
        let first = CellGrid::new(cells, 0);
        let share_of_sides = |cell: usize| {
            let place = first.place(cell as u32);
            cells.share_of_sides(place.x, place.y)
        };
        let by_layer = |loaded: u32, at: u32| {
            let (to, from) = (grid.cell(at), grid.cell(loaded));
            matrix(&grid.layer().at([to[0] - from[0], to[1] - from[1]]))
        };
        let mut entries = vec![0.0; 9 * size * size];
        for (node, loaded) in tents.iter().enumerate() {
            let under = |at: u32| -> Matrix3<f64> {
                let part = |&(cell, share): &(u32, f64)| by_layer(cell, at).cast() * share;
                loaded.iter().map(part).sum()
            };
            let moved: Vec<_> = (0..grid.len() as u32).map(under).collect();
            for (at, seen) in tents.iter().enumerate() {
                let part = |&(cell, share): &(u32, f64)| moved[cell as usize] * share;
                let layer: Matrix3<f64> = seen.iter().map(part).sum();
                let share = f64::max(share_of_sides(node), share_of_sides(at));
                for (axis, i) in (0..3).flat_map(|axis| (0..3).map(move |i| (axis, i))) {
                    let found = elements.at(node as u32, axis, 3 * at + i);
                    entries[3 * size * (3 * node + axis) + 3 * at + i] =
                        (share * (found - layer[(i, axis)])) as f32;
                }
            }
        }
        let is_near = (0..size).map(|cell| share_of_sides(cell) > 0.0).collect();
        Self { entries, is_near, rows: cells.count[1] }
    }

    /// Displacement around all cells (3C) in m under forces around each (C) in N.
    fn field(&self, forces: &[Vector3<f32>]) -> Vec<f32> {
        let size = 3 * self.is_near.len();
        let mut sum = vec![0.0; size];
        let forces = forces.iter().flat_map(|force| <[f32; 3]>::from(*force));
        vectorised(
            #[inline(always)]
            || {
                for (force, row) in forces.clone().zip(self.entries.chunks_exact(size)) {
                    if force != 0.0 {
                        sum.iter_mut().zip(row).for_each(|(sum, c)| *sum += force * c);
                    }
                }
            },
        );
        sum
    }

    /// Adds to `rows` the displacement of the T cells that are `around` under unit forces along each
    /// axis (3, 3T), shared among the cells `loaded`. Returns whether it is not zero.
    pub(super) fn add_rows(
        &self,
        loaded: [(u32, f32); 4],
        around: &Around,
        rows: &mut [f32],
    ) -> bool {
        let Around { first, count } = *around;
        let (size, width) = (3 * self.is_near.len(), 3 * count[1] as usize);
        let places = (first[0]..first[0] + count[0]).map(|x| x * self.rows + first[1]);
        let is_near = |first: u32, count: u32| {
            self.is_near[first as usize..][..count as usize].iter().any(|near| *near)
        };
        let matters = loaded.iter().any(|(from, _)| is_near(*from, 1))
            || places.clone().any(|place| is_near(place, count[1]));
        if !matters {
            return false;
        }
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
        true
    }

    /// Displacement around cell `at` under unit forces around cell `loaded` (m/N), if it is not zero.
    #[inline(always)]
    pub(super) fn block(&self, loaded: u32, at: u32) -> Option<Columns> {
        let ([loaded, at], size) = ([loaded as usize, at as usize], 3 * self.is_near.len());
        let is_near = self.is_near[loaded] || self.is_near[at];
        is_near.then(|| {
            let part = |axis| &self.entries[size * (3 * loaded + axis) + 3 * at..][..3];
            let [x, y, z] = [part(0), part(1), part(2)];
            [x[0], x[1], x[2], 0.0, y[0], y[1], y[2], 0.0, z[0], z[1], z[2], 0.0]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        compliance::{Compliance, ComplianceOptions},
        deformation::{Law, SoftBody},
    };

    #[test]
    fn sides_soften_what_is_near_them_and_not_what_is_far() {
        let outline = PadOutline::flat(0.032, 0.032, 0.003);
        let pad = PadMesh::with_nodes(&outline, 1500).unwrap();
        let moduli = Moduli { young: 3e5, poisson: 0.47 };
        let body = SoftBody::new(pad.mesh.clone(), Law::Linear, moduli, &pad.base).unwrap();
        let options = ComplianceOptions { friction: 0.5, sweeps: 0 };
        let condensed = Compliance::new(body, options).unwrap().condensed;
        let layer = LayerElements::new(&pad, moduli).unwrap();
        let cells = CellLevels::new(&outline, [16; 2], 2, (&condensed, &pad), Some(&layer));
        let grid = CellGrid::new(&cells, 0);
        // Change of the displacement of a cell along z under a force on it, over that by the layer.
        let change = |[i, j]: [u32; 2]| {
            let rank = 16 * i + j;
            let block = grid.edges().unwrap().block(rank, rank).unwrap();
            block[10] / grid.layer().at([0, 0])[10]
        };
        let (middle, corner) = (change([8, 8]), change([0, 0]));
        assert!(
            middle.abs() < 2e-3 && corner > 0.2,
            "{middle} in the middle, {corner} at a corner"
        );
    }
}
