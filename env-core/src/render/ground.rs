//! Contact occlusion: the share of the sky that a body close above the ground hides from it.

use nalgebra::{Isometry3, Point3, Vector3};

use super::{camera::FAR, mesh::RenderMesh, raster::Raster};

/// Texels along each side of the map.
const SIZE: usize = 128;
/// Height above which a body does not occlude the ground (m).
const REACH: f32 = 0.05;
/// Half width of the box average that is applied twice to smooth the map (texels).
const SOFTNESS: usize = 2;

/// Occlusion in [0, 1] on a square of the ground, from the bodies as seen from below.
pub(super) struct ContactMap {
    raster: Raster,
    occlusion: Vec<f32>,
    center: Point3<f64>,
    half_width: f64,
    /// Height of the ground (m).
    level: f32,
}

impl ContactMap {
    pub(super) fn new() -> Self {
        Self {
            raster: Raster::new(SIZE, SIZE),
            occlusion: vec![0.0; SIZE * SIZE],
            center: Point3::origin(),
            half_width: 1.0,
            level: 0.0,
        }
    }

    /// Clears the map and sets its square, of half width `half_width` (m) about `center` on the
    /// ground at height `level` (m).
    pub(super) fn begin(&mut self, center: Point3<f64>, half_width: f64, level: f64) {
        self.raster.clear();
        (self.center, self.half_width, self.level) = (center, half_width, level as f32);
    }

    /// Adds `mesh` at `pose`.
    pub(super) fn cast(
        &mut self,
        mesh: &RenderMesh,
        pose: &Isometry3<f64>,
        seen: &mut Vec<[f32; 4]>,
    ) {
        let (center, half_width) = (self.center, self.half_width);
        let to_clip = |p: &Point3<f64>| {
            let q = pose * p;
            let (x, y) = ((q.x - center.x) / half_width, (center.y - q.y) / half_width);
            [x, y, -q.z / FAR, 1.0].map(|x| x as f32)
        };
        self.raster.fill_depth(mesh, to_clip, seen);
    }

    /// Completes the map, which can then be queried.
    pub(super) fn finish(&mut self) {
        for (occlusion, depth) in self.occlusion.iter_mut().zip(&self.raster.depth) {
            let height = -depth - self.level;
            *occlusion = (1.0 - height / REACH).clamp(0.0, 1.0).powi(2);
        }
        for _ in 0..2 {
            average_rows(&mut self.occlusion);
            transpose(&mut self.occlusion);
            average_rows(&mut self.occlusion);
            transpose(&mut self.occlusion);
        }
    }

    /// Occlusion in [0, 1] at `position` (m) on the ground.
    pub(super) fn at(&self, position: &Vector3<f32>) -> f32 {
        let scale = 0.5 * SIZE as f32 / self.half_width as f32;
        let x = (position.x - self.center.x as f32) * scale + 0.5 * SIZE as f32 - 0.5;
        let y = (position.y - self.center.y as f32) * scale + 0.5 * SIZE as f32 - 0.5;
        let inside = 0.0..(SIZE - 1) as f32;
        if !(inside.contains(&x) && inside.contains(&y)) {
            return 0.0;
        }
        let (column, row) = (x as u32 as usize, y as u32 as usize);
        let (u, v) = (x - column as f32, y - row as f32);
        let first = row * SIZE + column;
        let [a, b, c, d] = [0, 1, SIZE, SIZE + 1].map(|i| self.occlusion[first + i]);
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        mix(mix(a, b, u), mix(c, d, u), v)
    }
}

fn average_rows(map: &mut [f32]) {
    for row in map.chunks_exact_mut(SIZE) {
        let copy: [f32; SIZE] = std::array::from_fn(|i| row[i]);
        for (i, value) in row.iter_mut().enumerate() {
            let window = &copy[i.saturating_sub(SOFTNESS)..(i + SOFTNESS + 1).min(SIZE)];
            *value = window.iter().sum::<f32>() / (2 * SOFTNESS + 1) as f32;
        }
    }
}

fn transpose(map: &mut [f32]) {
    for i in 0..SIZE {
        for j in 0..i {
            map.swap(i * SIZE + j, j * SIZE + i);
        }
    }
}
