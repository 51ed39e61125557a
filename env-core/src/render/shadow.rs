//! Shadow map of the key light: a depth map seen from the light, and the share of the light that
//! reaches a point.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use super::{camera::FAR, mesh::RenderMesh, raster::Raster};

/// Texels along each side of the map.
const SIZE: usize = 1024;
/// Texels along each side of a tile, for which one upper bound of the depth is kept.
const TILE: usize = 16;
const TILES: usize = SIZE / TILE;
/// Half of the width over which the edge of a shadow is smoothed (texels).
const SOFTNESS: usize = 3;

/// Depth map on a square that faces the light: height along the direction to the light of the first
/// surface that the light meets.
pub(super) struct ShadowMap {
    raster: Raster,
    /// Greatest height in each tile and its eight neighbours (m).
    highest: Vec<f32>,
    /// Rows: across, along, towards the light.
    rotation: Matrix3<f64>,
    center: Point3<f64>,
    half_width: f64,
    /// Map from the world to column, row and height towards the light (m).
    to_texels: Matrix3<f32>,
    shift: Vector3<f32>,
    /// Offset along the normal at which a point is looked up in grazing light (m): the width over
    /// which the smoothing would make a surface shade itself.
    lift: f32,
}

impl ShadowMap {
    pub(super) fn new(towards_light: &Vector3<f64>) -> Self {
        let along = towards_light.normalize();
        let across = Vector3::y().cross(&along).normalize();
        let up = along.cross(&across);
        Self {
            raster: Raster::new(SIZE, SIZE),
            highest: vec![f32::NEG_INFINITY; TILES * TILES],
            rotation: Matrix3::from_rows(&[across.transpose(), up.transpose(), along.transpose()]),
            center: Point3::origin(),
            half_width: 1.0,
            to_texels: Matrix3::zeros(),
            shift: Vector3::zeros(),
            lift: 0.0,
        }
    }

    /// Clears the map and sets its square, of half width `half_width` (m) about `center`.
    pub(super) fn begin(&mut self, center: Point3<f64>, half_width: f64) {
        self.raster.clear();
        (self.center, self.half_width) = (center, half_width);
        let texels = 0.5 * SIZE as f64 / half_width;
        let scale = Vector3::new(texels, -texels, 1.0);
        let to_texels = Matrix3::from_diagonal(&scale) * self.rotation;
        // The centre of the first texel is at 0.
        let middle = Vector3::new(0.5 * SIZE as f64 - 0.5, 0.5 * SIZE as f64 - 0.5, 0.0);
        self.shift = (middle - to_texels * center.coords).cast();
        self.to_texels = to_texels.cast();
        self.lift = ((SOFTNESS as f64 + 1.0) / texels) as f32;
    }

    /// Adds the body `mesh` at `pose`.
    pub(super) fn cast(
        &mut self,
        mesh: &RenderMesh,
        pose: &Isometry3<f64>,
        seen: &mut Vec<[f32; 4]>,
    ) {
        let rotation = self.rotation * pose.rotation.to_rotation_matrix().matrix();
        let shift = self.rotation * (pose.translation.vector - self.center.coords);
        let to_clip = |p: &Point3<f64>| {
            let q = rotation * p.coords + shift;
            [q.x / self.half_width, q.y / self.half_width, q.z / FAR, 1.0].map(|x| x as f32)
        };
        self.raster.fill_depth(mesh, to_clip, seen);
    }

    /// Completes the map, which can then be queried.
    pub(super) fn finish(&mut self) {
        self.highest.fill(f32::NEG_INFINITY);
        for (row, band) in self.raster.depth.chunks_exact(SIZE * TILE).enumerate() {
            for column in 0..TILES {
                let highest = highest_in_tile(band, column);
                if highest > f32::NEG_INFINITY {
                    raise_around(&mut self.highest, column, row, highest);
                }
            }
        }
    }

    /// Share of the key light that reaches `position` (m) on a surface of unit normal `normal`.
    pub(super) fn light_at(&self, position: &Vector3<f32>, normal: &Vector3<f32>) -> f32 {
        let cosine = normal.dot(&self.to_texels.row(2).transpose());
        let raised = position + normal * (self.lift * (1.0 - cosine * cosine).max(0.0).sqrt());
        let [x, y, height] = (self.to_texels * raised + self.shift).into();
        let inside = (SOFTNESS as f32)..(SIZE - SOFTNESS - 1) as f32;
        if !(inside.contains(&x) && inside.contains(&y)) {
            return 1.0;
        }
        let (column, row) = (x as u32 as usize, y as u32 as usize);
        if self.highest[row / TILE * TILES + column / TILE] <= height {
            return 1.0;
        }
        let fraction = [x - column as f32, y - row as f32];
        self.smoothed(column - SOFTNESS, row - SOFTNESS, fraction, height)
    }

    /// Share of the texels that are not above `height`, in a square of 2 `SOFTNESS` + 1 texels that
    /// begins at `fraction` of the texel (`left`, `top`).
    fn smoothed(&self, left: usize, top: usize, fraction: [f32; 2], height: f32) -> f32 {
        const COUNT: usize = 2 * SOFTNESS + 2;
        let [across, down] = fraction.map(|fraction| {
            let mut weights = [1.0; COUNT];
            (weights[0], weights[COUNT - 1]) = (1.0 - fraction, fraction);
            weights
        });
        let mut sums = [0.0; COUNT];
        for (row, weight) in self.raster.depth[top * SIZE..].chunks(SIZE).zip(down) {
            for (sum, &depth) in sums.iter_mut().zip(&row[left..left + COUNT]) {
                *sum += if depth > height { 0.0 } else { weight };
            }
        }
        let lit: f32 = sums.iter().zip(across).map(|(sum, weight)| sum * weight).sum();
        lit / ((COUNT - 1) * (COUNT - 1)) as f32
    }
}

/// Greatest depth in tile `column` of a band of `TILE` rows.
fn highest_in_tile(band: &[f32], column: usize) -> f32 {
    let mut highest = [f32::NEG_INFINITY; TILE];
    for row in band.chunks_exact(SIZE) {
        for (highest, &depth) in highest.iter_mut().zip(&row[column * TILE..][..TILE]) {
            *highest = if depth > *highest { depth } else { *highest };
        }
    }
    highest.into_iter().fold(f32::NEG_INFINITY, f32::max)
}

/// Raises a tile and its eight neighbours to at least `height`.
fn raise_around(tiles: &mut [f32], column: usize, row: usize, height: f32) {
    let columns = column.saturating_sub(1)..(column + 2).min(TILES);
    for row in row.saturating_sub(1)..(row + 2).min(TILES) {
        for tile in &mut tiles[row * TILES..][columns.clone()] {
            *tile = tile.max(height);
        }
    }
}
