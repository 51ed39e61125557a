//! Picture of the face by the camera behind the gel.
//!
//! The colour at a pixel is a polynomial of its place and of the slope that the face has gained
//! there since rest, fitted to frames of a real sensor ([`ImageResponse`]). Photometric stereo
//! inverts such a picture (Yuan, Dong & Adelson, Sensors 17, 2762, 2017).
//!
//! Shapes: P pixels, those across the fastest.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use nalgebra::{Isometry3, Point3, Similarity3, Vector3};

use super::{
    depth,
    face::{Face, PlanGrid},
};
use crate::{deformation::Deformation, geometry::Shape, sensor::ImageResponse, simd::vectorised};

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
    /// Prepares the picture of `face` on the pixels of `grid`.
    pub(super) fn new(face: &Face, grid: PlanGrid, response: &ImageResponse) -> Self {
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
            rest: depth::heights(face, &grid, None),
            background: grid.centres().map(at).collect(),
            response: response.clone(),
            half_view,
            grid,
        }
    }

    /// Colours (P, 3) from 0 to 1 of the face deformed by objects of these `shapes`, or at rest.
    pub(super) fn picture(
        &self,
        face: &Face,
        deformation: Option<&Deformation>,
        shapes: &[&Shape],
    ) -> Vec<f64> {
        let mut colours = self.background.clone();
        if let Some(deformation) = deformation {
            let placed: Vec<_> = shapes.iter().copied().zip(&deformation.poses).collect();
            let heights = self.heights(face, deformation, &placed);
            let raised = heights.iter().zip(&self.rest).map(|(z, rest)| (z - rest) as f32);
            let raised: Vec<_> = raised.collect();
            self.add_response(&self.smoothed(&raised), &mut colours);
        }
        colours.iter().flatten().map(|c| f64::from(c.clamp(0.0, 1.0))).collect()
    }

    /// Heights (P) in m of the face deformed by objects at their poses: raised to an object where
    /// nodes touch it, and nowhere inside of one.
    fn heights(
        &self,
        face: &Face,
        deformation: &Deformation,
        objects: &[(&Shape, &Isometry3<f64>)],
    ) -> Vec<f64> {
        let displacement = Some(&deformation.displacement[..]);
        if objects.is_empty() {
            return depth::heights(face, &self.grid, displacement);
        }
        let gap = |place: &Point3<f64>| {
            let gaps = objects.iter().filter_map(|(shape, pose)| gap(shape, pose, place));
            gaps.filter(|gap| (0.0..CLOSE).contains(gap)).reduce(f64::min)
        };
        let bears =
            deformation.contact_force.iter().zip(&deformation.displacement).zip(&face.places);
        let missing = |((force, moved), place): ((&Vector3<f64>, _), &Point3<f64>)| {
            let touches = *force != Vector3::zeros();
            touches.then(|| gap(&(place + moved))).flatten().unwrap_or_default()
        };
        let missing: Vec<f64> = bears.map(missing).collect();
        let mut heights = vec![-face.thickness; self.rest.len()];
        depth::cover(face, &self.grid, displacement, |pixel, z, (corners, shares)| {
            let raised: f64 =
                corners.iter().zip(shares).map(|(&n, s)| s * missing[n as usize]).sum();
            heights[pixel] = heights[pixel].max(z + raised);
        });
        for (shape, pose) in objects {
            lower(&mut heights, &self.grid, shape, pose);
        }
        heights
    }

    /// Convolves a map (P) with the camera's Gaussian; beyond the view it has the values of the edge.
    fn smoothed(&self, map: &[f32]) -> Vec<f32> {
        let [nx, ny] = self.grid.counts.map(|count| count as usize);
        let [of_row, of_column] =
            [0, 1].map(|axis| gaussian(self.response.smoothing / self.grid.cell[axis]));
        let reach = of_row.len() / 2;
        let mut padded = vec![0.0; nx + 2 * reach];
        let mut passed = vec![0.0; map.len()];
        for (row, out) in map.chunks_exact(nx).zip(passed.chunks_exact_mut(nx)) {
            padded[..reach].fill(row[0]);
            padded[reach..reach + nx].copy_from_slice(row);
            padded[reach + nx..].fill(row[nx - 1]);
            for (shift, weight) in of_row.iter().enumerate() {
                add(out, *weight, &padded[shift..shift + nx]);
            }
        }
        let reach = of_column.len() / 2;
        let mut smooth = vec![0.0; map.len()];
        for (j, out) in smooth.chunks_exact_mut(nx).enumerate() {
            for (shift, weight) in of_column.iter().enumerate() {
                let from = (j + shift).saturating_sub(reach).min(ny - 1) * nx;
                add(out, *weight, &passed[from..from + nx]);
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
        let [of_p, of_q, of_x, _] = [0, 1, 2, 3].map(most);
        let steepest = self.response.steepest as f32;
        let unit = self.half_view;
        let mut row = ResponseRow::new(nx, [of_p, of_q, of_x]);
        for (i, x) in row.x[1].iter_mut().enumerate() {
            *x = (self.grid.centre(0, i as u32) / unit) as f32;
        }
        raise(&mut row.x);
        for (j, colours) in colours.chunks_exact_mut(nx).enumerate() {
            let y = (self.grid.centre(1, j as u32) / unit) as f32;
            let [before, after] = [j.saturating_sub(1), (j + 1).min(ny - 1)];
            let line = |j: usize| &raised[j * nx..(j + 1) * nx];
            let across = if after > before { ((after - before) as f32 * dy).recip() } else { 0.0 };
            row.slopes(line(j), dx, [line(before), line(after)], across, steepest);
            row.colours.iter_mut().for_each(|colour| colour.fill(0.0));
            for (&[a, b, c, d], coefficients) in
                self.response.terms.iter().zip(&self.response.response)
            {
                let of_row = y.powi(d.into());
                row.add([a, b, c].map(usize::from), coefficients.map(|k| k as f32 * of_row));
            }
            for (i, colour) in colours.iter_mut().enumerate() {
                for (c, added) in colour.iter_mut().zip(&row.colours) {
                    *c += added[i];
                }
            }
        }
    }
}

/// Lowers heights (P) inside of an object to where a line from below enters it.
fn lower(heights: &mut [f64], grid: &PlanGrid, shape: &Shape, pose: &Isometry3<f64>) {
    let highest = heights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let [x, y] = [0, 1].map(|axis| 0.5 * f64::from(grid.counts[axis]) * grid.cell[axis]);
    let within = [Point3::new(-x, -y, f64::NEG_INFINITY), Point3::new(x, y, highest)];
    match shape.triangles_near(&Similarity3::from_isometry(*pose, 1.0), &within) {
        Some(triangles) => lower_to_triangles(heights, grid, &triangles),
        None => lower_by_rays(heights, grid, shape, pose),
    }
}

/// Lowers heights (P) inside of the solid whose surface near them consists of `triangles`.
fn lower_to_triangles(heights: &mut [f64], grid: &PlanGrid, triangles: &[[Point3<f64>; 3]]) {
    // The last crossing of the surface below each height, and `true` if a line from below enters.
    let mut crossed = vec![(f64::NEG_INFINITY, false); heights.len()];
    for triangle in triangles {
        let [u, v] = [1, 2].map(|corner| triangle[corner] - triangle[0]);
        let enters = u.x * v.y < u.y * v.x;
        depth::cover_by(triangle, grid, |pixel, z, _| {
            if crossed[pixel].0 < z && z < heights[pixel] {
                crossed[pixel] = (z, enters);
            }
        });
    }
    for (height, (z, enters)) in heights.iter_mut().zip(crossed) {
        if enters {
            *height = z;
        }
    }
}

/// Lowers heights (P) inside of a solid by a ray for each.
fn lower_by_rays(heights: &mut [f64], grid: &PlanGrid, shape: &Shape, pose: &Isometry3<f64>) {
    let [nx, ny] = grid.counts;
    let place = |i: u32, j: u32, z: f64| Point3::new(grid.centre(0, i), grid.centre(1, j), z);
    let tiles = (0..ny.div_ceil(TILE)).flat_map(|j| (0..nx.div_ceil(TILE)).map(move |i| (i, j)));
    for (i, j) in tiles {
        let columns = i * TILE..((i + 1) * TILE).min(nx);
        let rows = j * TILE..((j + 1) * TILE).min(ny);
        let pixels = || rows.clone().flat_map(|j| columns.clone().map(move |i| (i, j)));
        let number = |(i, j): (u32, u32)| (j * nx + i) as usize;
        let range = pixels().map(|pixel| heights[number(pixel)]);
        let [low, high] = range
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], z| [low.min(z), high.max(z)]);
        let corner = place(columns.start, rows.start, 0.5 * (low + high));
        let [dx, dy] = grid.cell.map(|cell| f64::from(TILE) * cell);
        let radius = dx.hypot(dy) + 0.5 * (high - low);
        if shape.distance(&pose.inverse_transform_point(&corner)).value > radius {
            continue;
        }
        for pixel in pixels() {
            let height = &mut heights[number(pixel)];
            if let Some(gap) = gap(shape, pose, &place(pixel.0, pixel.1, *height)) {
                *height += gap.min(0.0);
            }
        }
    }
}

/// Terms of the response along a row of pixels (W).
struct ResponseRow {
    /// Powers of the slopes along and across the row, and of the place along it, each (power, W).
    p: Vec<Vec<f32>>,
    q: Vec<Vec<f32>>,
    x: Vec<Vec<f32>>,
    /// Sums for red, green and blue (W).
    colours: [Vec<f32>; 3],
}

impl ResponseRow {
    /// Buffers for rows of `width` pixels and powers up to `most`, at least 1.
    fn new(width: usize, most: [usize; 3]) -> Self {
        let [p, q, x] = most.map(|most| vec![vec![1.0; width]; most.max(1) + 1]);
        Self { p, q, x, colours: [0, 1, 2].map(|_| vec![0.0; width]) }
    }

    /// Sets the slopes, limited to `steepest`, and their powers: those of `line` at pixels `dx` apart
    /// (m), and the difference of the lines beside it times `across` (1/m).
    fn slopes(
        &mut self,
        line: &[f32],
        dx: f32,
        [before, after]: [&[f32]; 2],
        across: f32,
        steepest: f32,
    ) {
        let (p, q, last) = (&mut self.p[1], &mut self.q[1], line.len() - 1);
        vectorised(
            #[inline(always)]
            || {
                let half = 0.5 / dx;
                for i in 1..last {
                    p[i] = (line[i + 1] - line[i - 1]) * half;
                }
                if last > 0 {
                    p[0] = (line[1] - line[0]) / dx;
                    p[last] = (line[last] - line[last - 1]) / dx;
                } else {
                    p[0] = 0.0;
                }
                for i in 0..=last {
                    q[i] = (after[i] - before[i]) * across;
                }
                for i in 0..=last {
                    let slope = (p[i] * p[i] + q[i] * q[i]).sqrt();
                    let shrink = (steepest / slope.max(f32::MIN_POSITIVE)).min(1.0);
                    p[i] *= shrink;
                    q[i] *= shrink;
                }
            },
        );
        raise(&mut self.p);
        raise(&mut self.q);
    }

    /// Adds `coefficients` · pᵃ qᵇ xᶜ.
    fn add(&mut self, [a, b, c]: [usize; 3], coefficients: [f32; 3]) {
        let (p, q, x) = (&self.p[a][..], &self.q[b][..], &self.x[c][..]);
        let [red, green, blue] = &mut self.colours;
        vectorised(
            #[inline(always)]
            || {
                let width = p.len();
                let (q, x) = (&q[..width], &x[..width]);
                let (red, green, blue) =
                    (&mut red[..width], &mut green[..width], &mut blue[..width]);
                for i in 0..width {
                    let weight = p[i] * q[i] * x[i];
                    red[i] += coefficients[0] * weight;
                    green[i] += coefficients[1] * weight;
                    blue[i] += coefficients[2] * weight;
                }
            },
        );
    }
}

/// Fills in the powers 2 and up of the values in `powers[1]`.
fn raise(powers: &mut [Vec<f32>]) {
    for power in 2..powers.len() {
        let [lower, higher] = [power - 1, power];
        for i in 0..powers[1].len() {
            powers[higher][i] = powers[lower][i] * powers[1][i];
        }
    }
}

/// Adds `weight` · `values` to `sum`.
fn add(sum: &mut [f32], weight: f32, values: &[f32]) {
    vectorised(
        #[inline(always)]
        || sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value),
    );
}

/// Distance from a place up to an object (m), negative inside; `None` if nothing is above.
fn gap(shape: &Shape, pose: &Isometry3<f64>, place: &Point3<f64>) -> Option<f64> {
    let up = pose.inverse_transform_vector(&Vector3::z());
    shape.ray_gap(&pose.inverse_transform_point(place), &up)
}

/// Weights of a Gaussian of standard deviation `sigma` (pixels) out to three of them on both sides;
/// they sum to 1.
fn gaussian(sigma: f64) -> Vec<f32> {
    let reach = (3.0 * sigma).ceil() as i32;
    let weight = |shift: i32| {
        if sigma > 0.0 { (-0.5 * (f64::from(shift) / sigma).powi(2)).exp() } else { 1.0 }
    };
    let sum: f64 = (-reach..=reach).map(weight).sum();
    (-reach..=reach).map(|shift| (weight(shift) / sum) as f32).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::geometry::{Bump, Hollow, StarShaped, Wave};

    /// Solids that are lowered to triangles, each with the solid as rays see it, and by how much the
    /// triangles may be off its surface (m).
    fn solids() -> Vec<(Shape, Shape, f64)> {
        let wave = Wave { amplitude: 0.03, vector: Vector3::new(3.0, 2.0, 1.0), phase: 0.3 };
        let dimple = Bump { amplitude: -0.1, axis: -Vector3::z_axis(), concentration: 12.0 };
        let potato = StarShaped::new(Vector3::new(0.02, 0.02, 0.025), vec![wave]);
        let potato = potato.with_bumps(vec![dimple]);
        // (0.4 mm)²/6R, with R from 5 mm.
        let smooth = 5e-6;
        let shell = Shape::Hollow(Hollow::new(potato.clone(), 0.97));
        let potato = Shape::StarShaped(potato);
        let prism = Shape::Prism { sides: 6, radius: 0.01, half_height: 0.015 };
        let cup = Shape::Cup { bottom: 0.01, rim: 0.012, half_height: 0.01, wall: 5e-4 };
        let mesh = Shape::Mesh(Arc::new(cup.surface(24).unwrap()));
        vec![
            (prism.clone(), prism, 1e-9),
            (mesh.sampled().scaled(1.3), mesh.scaled(1.3), 1e-9),
            (mesh.clone(), mesh, 1e-9),
            (potato.sampled().scaled(1.2), potato.scaled(1.2), smooth),
            (potato.clone(), potato, smooth),
            (shell.clone(), shell, smooth),
        ]
    }

    #[test]
    fn triangles_lower_a_face_as_rays_do() {
        let grid = PlanGrid { counts: [60, 80], cell: [2.5e-4; 2] };
        let face = |[x, y]: [f64; 2]| 3e-4 * ((1e3 * x).sin() + (700.0 * y).cos());
        let before: Vec<f64> = grid.centres().map(face).collect();
        for (found, exact, tolerance) in solids() {
            for turn in 0..5 {
                let turn = f64::from(turn);
                let about = Vector3::new(0.7 + turn, 1.3 * turn - 2.0, 0.4 * turn * turn);
                let turned = Isometry3::rotation(about);
                let vertices = exact.surface(32).unwrap();
                let heights = vertices.vertices().iter().map(|v| (turned * v).z);
                let low = heights.fold(f64::INFINITY, f64::min);
                // 1.5 mm deep, so that rays pass thin walls, too.
                let aside = Vector3::new(1e-3, -2e-3, -low - 1.5e-3);
                let pose = Isometry3::from_parts(aside.into(), turned.rotation);
                let off = |[x, y]: [f64; 2], z: f64| {
                    exact.distance(&pose.inverse_transform_point(&Point3::new(x, y, z))).value
                };
                let mut after = before.clone();
                lower(&mut after, &grid, &found, &pose);
                let mut lowered = 0;
                for ((place, was), now) in grid.centres().zip(&before).zip(&after) {
                    let depth = off(place, *was);
                    let ray = if depth < 0.0 {
                        gap(&exact, &pose, &Point3::new(place[0], place[1], *was)).unwrap_or(0.0)
                    } else {
                        0.0
                    };
                    let case = format!("{exact:?}, turn {turn}, {place:?}: {was} to {now} m");
                    // Where the surface is steep, heights differ by more than the distance to it.
                    let agree = (now - was - ray.min(0.0)).abs() < 50.0 * tolerance;
                    assert!(agree || depth.abs() < tolerance, "{case}, by a ray {ray} m");
                    lowered += usize::from(now < was);
                    assert!(now == was || off(place, *now).abs() < tolerance, "{case}: off");
                }
                assert!(lowered > 30, "{exact:?}, turn {turn}: {lowered} pixels are lowered");
            }
        }
    }
}
