//! Picture of the face by the camera behind the gel.
//!
//! The colour at a pixel is a polynomial of its place and of the slope that the face has gained
//! there since rest, fitted to frames of a real sensor ([`ImageResponse`]). Photometric stereo
//! inverts such a picture (Yuan, Dong & Adelson, Sensors 17, 2762, 2017).
//!
//! Shapes: P pixels, those across the fastest.

use nalgebra::{Isometry3, Point3, Vector3};

use super::{
    depth,
    skin::{PlanGrid, Skin},
};
use crate::{deformation::Deformation, geometry::Shape, sensor::ImageResponse};

/// Gap between object and a node that bears contact force up to which the node counts as touching
/// (m). Forces are spread to nodes beside the contact, too.
const CLOSE: f64 = 1e-4;
/// Pixels along an edge of the tiles that are tested against the object as a whole.
const TILE: u32 = 8;

/// Camera behind a pad at rest.
#[derive(Debug)]
pub(super) struct TactileCamera {
    grid: PlanGrid,
    response: ImageResponse,
    /// Half of the view's longer edge (m), the unit of places in the response.
    half_view: f64,
    /// Heights of the resting face (P) in m.
    rest: Vec<f64>,
    /// Colours of the resting face (P, 3).
    background: Vec<[f32; 3]>,
}

impl TactileCamera {
    /// Prepares the picture of the pad of `skin` on the pixels of `grid`.
    pub(super) fn new(skin: &Skin, grid: PlanGrid, response: &ImageResponse) -> Self {
        let half_view = [0, 1].map(|axis| 0.5 * f64::from(grid.counts[axis]) * grid.cell[axis]);
        let half_view = half_view[0].max(half_view[1]);
        let terms = response.background_terms.iter().zip(&response.background);
        let at = |[x, y]: [f64; 2]| {
            let mut colour = [0.0; 3];
            for ([a, b], coefficients) in terms.clone() {
                let power = (x / half_view).powi((*a).into()) * (y / half_view).powi((*b).into());
                for (c, k) in colour.iter_mut().zip(coefficients) {
                    *c += k * power;
                }
            }
            colour.map(|c| c as f32)
        };
        Self {
            rest: depth::heights(skin, &grid, None),
            background: grid.centres().map(at).collect(),
            response: response.clone(),
            half_view,
            grid,
        }
    }

    /// Colours (P, 3) from 0 to 1 of the face deformed by an object, or at rest.
    pub(super) fn picture(
        &self,
        skin: &Skin,
        felt: Option<&Deformation>,
        object: Option<&Shape>,
    ) -> Vec<f64> {
        let mut colours = self.background.clone();
        if let Some(felt) = felt {
            let shape = object.zip(felt.poses.first());
            let heights = self.heights(skin, felt, shape);
            let raised = heights.iter().zip(&self.rest).map(|(z, rest)| (z - rest) as f32);
            let raised: Vec<_> = raised.collect();
            self.add_response(&self.smoothed(&raised), &mut colours);
        }
        colours.iter().flatten().map(|c| f64::from(c.clamp(0.0, 1.0))).collect()
    }

    /// Heights (P) in m of the face deformed by an object at a pose: raised to the object where
    /// nodes touch it, and nowhere inside of it.
    fn heights(
        &self,
        skin: &Skin,
        felt: &Deformation,
        object: Option<(&Shape, &Isometry3<f64>)>,
    ) -> Vec<f64> {
        let displacement = Some(&felt.displacement[..]);
        let Some((shape, pose)) = object else {
            return depth::heights(skin, &self.grid, displacement);
        };
        let gap = |place: &Point3<f64>| gap(shape, pose, place);
        let bears = felt.contact_force.iter().zip(&felt.displacement).zip(&skin.places);
        let missing = |((force, moved), place): ((&Vector3<f64>, _), &Point3<f64>)| {
            let touches = *force != Vector3::zeros();
            let gap = touches.then(|| gap(&(place + moved))).flatten();
            gap.filter(|gap| (0.0..CLOSE).contains(gap)).unwrap_or_default()
        };
        let missing: Vec<f64> = bears.map(missing).collect();
        let mut heights = vec![-skin.thickness; self.rest.len()];
        depth::cover(skin, &self.grid, displacement, |pixel, z, (corners, shares)| {
            let raised: f64 =
                corners.iter().zip(shares).map(|(&n, s)| s * missing[n as usize]).sum();
            heights[pixel] = heights[pixel].max(z + raised);
        });
        self.lower(&mut heights, shape, pose);
        heights
    }

    /// Lowers heights (P) inside of an object to its surface.
    fn lower(&self, heights: &mut [f64], shape: &Shape, pose: &Isometry3<f64>) {
        let [nx, ny] = self.grid.counts;
        let place =
            |i: u32, j: u32, z: f64| Point3::new(self.grid.centre(0, i), self.grid.centre(1, j), z);
        let tiles =
            (0..ny.div_ceil(TILE)).flat_map(|j| (0..nx.div_ceil(TILE)).map(move |i| (i, j)));
        for (i, j) in tiles {
            let columns = i * TILE..((i + 1) * TILE).min(nx);
            let rows = j * TILE..((j + 1) * TILE).min(ny);
            let pixels = || rows.clone().flat_map(|j| columns.clone().map(move |i| (i, j)));
            let number = |(i, j): (u32, u32)| (j * nx + i) as usize;
            let range = pixels().map(|pixel| heights[number(pixel)]);
            let [low, high] = range.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], z| {
                [low.min(z), high.max(z)]
            });
            let corner = place(columns.start, rows.start, 0.5 * (low + high));
            let [dx, dy] = self.grid.cell.map(|cell| f64::from(TILE) * cell);
            let radius = dx.hypot(dy) + 0.5 * (high - low);
            if shape.distance(&pose.inverse_transform_point(&corner)).value > radius {
                continue;
            }
            for pixel in pixels() {
                let height = &mut heights[number(pixel)];
                let gap = gap(shape, pose, &place(pixel.0, pixel.1, *height));
                *height += gap.unwrap_or_default().min(0.0);
            }
        }
    }

    /// Convolves a map (P) with the camera's Gaussian; beyond the view it has the values of the edge.
    fn smoothed(&self, map: &[f32]) -> Vec<f32> {
        let [nx, ny] = self.grid.counts.map(|count| count as usize);
        let sigma = |axis: usize| self.response.smoothing / self.grid.cell[axis];
        let inside =
            |at: usize, shift: isize, count: usize| at.saturating_add_signed(shift).min(count - 1);
        let mut passed = vec![0.0; map.len()];
        for (row, out) in map.chunks_exact(nx).zip(passed.chunks_exact_mut(nx)) {
            for (shift, weight) in gaussian(sigma(0)) {
                for (i, sum) in out.iter_mut().enumerate() {
                    *sum += weight * row[inside(i, shift, nx)];
                }
            }
        }
        let mut smooth = vec![0.0; map.len()];
        for (j, out) in smooth.chunks_exact_mut(nx).enumerate() {
            for (shift, weight) in gaussian(sigma(1)) {
                let from = inside(j, shift, ny) * nx;
                for (sum, z) in out.iter_mut().zip(&passed[from..from + nx]) {
                    *sum += weight * z;
                }
            }
        }
        smooth
    }

    /// Adds the response to the slope of `raised` (P), the height gained since rest (m).
    fn add_response(&self, raised: &[f32], colours: &mut [[f32; 3]]) {
        let [nx, ny] = self.grid.counts.map(|count| count as usize);
        let [dx, dy] = self.grid.cell.map(|cell| cell as f32);
        let most = |axis: usize| {
            let powers = self.response.terms.iter().map(|term| usize::from(term[axis]));
            powers.max().unwrap_or(0)
        };
        let unit = self.half_view;
        let xs: Vec<_> = (0..nx).map(|i| (self.grid.centre(0, i as u32) / unit) as f32).collect();
        let x = powers(&xs, most(2));
        let slope = |high: usize, low: usize, steps: usize, step: f32| {
            if steps == 0 { 0.0 } else { (raised[high] - raised[low]) / (steps as f32 * step) }
        };
        let slopes = |i: usize, j: usize| {
            let [left, right] = [i.saturating_sub(1), (i + 1).min(nx - 1)];
            let [before, after] = [j.saturating_sub(1), (j + 1).min(ny - 1)];
            let p = slope(j * nx + right, j * nx + left, right - left, dx);
            let q = slope(after * nx + i, before * nx + i, after - before, dy);
            let shrink = (self.response.steepest as f32 / p.hypot(q)).min(1.0);
            (p * shrink, q * shrink)
        };
        let mut weight = vec![0.0; nx];
        for (j, row) in colours.chunks_exact_mut(nx).enumerate() {
            let y = (self.grid.centre(1, j as u32) / unit) as f32;
            let (p, q): (Vec<_>, Vec<_>) = (0..nx).map(|i| slopes(i, j)).unzip();
            let (p, q) = (powers(&p, most(0)), powers(&q, most(1)));
            for (&[a, b, c, d], coefficients) in
                self.response.terms.iter().zip(&self.response.response)
            {
                let of_row = y.powi(d.into());
                let [a, b, c] = [a, b, c].map(usize::from);
                for (w, ((p, q), x)) in weight.iter_mut().zip(p[a].iter().zip(&q[b]).zip(&x[c])) {
                    *w = p * q * x * of_row;
                }
                let [red, green, blue] = coefficients.map(|k| k as f32);
                for (colour, w) in row.iter_mut().zip(&weight) {
                    colour[0] += red * w;
                    colour[1] += green * w;
                    colour[2] += blue * w;
                }
            }
        }
    }
}

/// Distance from a place up to an object (m), negative inside; `None` if nothing is above.
fn gap(shape: &Shape, pose: &Isometry3<f64>, place: &Point3<f64>) -> Option<f64> {
    let up = pose.inverse_transform_vector(&Vector3::z());
    shape.ray_gap(&pose.inverse_transform_point(place), &up)
}

/// Powers 0 to `most` of `values`.
fn powers(values: &[f32], most: usize) -> Vec<Vec<f32>> {
    let mut powers = vec![vec![1.0; values.len()]];
    for power in 0..most {
        powers.push(powers[power].iter().zip(values).map(|(p, v)| p * v).collect());
    }
    powers
}

/// Shifts (pixels) and weights of a Gaussian of standard deviation `sigma` (pixels) out to three of
/// them; the weights sum to 1.
fn gaussian(sigma: f64) -> Vec<(isize, f32)> {
    let reach = (3.0 * sigma).ceil() as isize;
    let weight = |shift: isize| {
        if sigma > 0.0 { (-0.5 * (shift as f64 / sigma).powi(2)).exp() } else { 1.0 }
    };
    let sum: f64 = (-reach..=reach).map(weight).sum();
    (-reach..=reach).map(|shift| (shift, (weight(shift) / sum) as f32)).collect()
}
