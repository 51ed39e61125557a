//! Picture of the face by the camera behind the gel.
//!
//! The colour at a pixel is a polynomial of its place and of the slope that the face has gained
//! there since rest, fitted to frames of a real sensor ([`ImageResponse`]). Photometric stereo
//! inverts such a picture (Yuan, Dong & Adelson, Sensors 17, 2762, 2017).
//!
//! Shapes: P pixels, those across the fastest.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use std::cell::OnceCell;

use super::{
    depth,
    face::Face,
    imprint::{FaceView, Imprint, RaisedFace},
};
use crate::{deformation::Deformation, geometry::Shape, sensor::ImageResponse, simd::vectorised};

/// Camera behind a pad at rest.
#[derive(Debug)]
pub(super) struct TactileCamera {
    view: FaceView,
    response: ImageResponse,
    /// Half of the view's longer edge (m), the unit of places in the response.
    half_view: f64,
    /// Heights of the resting face (P) in m, by the mesh.
    rest: Vec<f64>,
    /// Colours of the resting face (P, 3).
    background: Vec<[f32; 3]>,
    /// Weights of the Gaussian that smooths the height, along a row and along a column.
    smoothing: [Vec<f32>; 2],
}

impl TactileCamera {
    /// Prepares the picture of `face` on the pixels of `view`.
    pub(super) fn new(face: &Face, view: FaceView, response: &ImageResponse) -> Self {
        let grid = &view.grid;
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
            rest: depth::heights(face, grid, None),
            smoothing: grid.cell.map(|cell| gaussian(response.smoothing / cell)),
            background: grid.centres().map(at).collect(),
            response: response.clone(),
            half_view,
            view,
        }
    }

    /// Colours (P, 3) from 0 to 1 of the face deformed by objects of these `shapes`, or at rest; for
    /// `raised` see [`FaceView::imprint`].
    pub(super) fn picture(
        &self,
        face: &Face,
        deformation: Option<&Deformation>,
        shapes: &[&Shape],
        raised: &OnceCell<RaisedFace>,
    ) -> Vec<f64> {
        let mut colours = self.background.clone();
        if let Some(deformation) = deformation {
            let objects: Vec<_> = shapes.iter().copied().zip(&deformation.poses).collect();
            let Imprint { heights, rise } = self.view.imprint(face, deformation, &objects, raised);
            let raised = heights.iter().zip(&self.rest).zip(rise);
            let raised: Vec<_> = raised.map(|((z, rest), rise)| (z - rest - rise) as f32).collect();
            self.add_response(&self.smoothed(&raised), &mut colours);
        }
        colours.as_flattened().iter().map(|c| f64::from(c.clamp(0.0, 1.0))).collect()
    }

    /// Convolves a map (P) with the camera's Gaussian; beyond the view it has the values of the
    /// edge.
    fn smoothed(&self, map: &[f32]) -> Vec<f32> {
        let [nx, ny] = self.view.grid.counts.map(|count| count as usize);
        let [of_row, of_column] = &self.smoothing;
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
        let [nx, ny] = self.view.grid.counts.map(|count| count as usize);
        let [dx, dy] = self.view.grid.cell.map(|cell| cell as f32);
        let most = |axis: usize| {
            let powers = self.response.terms.iter().map(|term| usize::from(term[axis]));
            powers.max().unwrap_or(0)
        };
        let [of_p, of_q, of_x, _] = [0, 1, 2, 3].map(most);
        let steepest = self.response.steepest as f32;
        let unit = self.half_view;
        let mut row = ResponseRow::new(nx, [of_p, of_q, of_x]);
        for (i, x) in row.x[1].iter_mut().enumerate() {
            *x = (self.view.grid.centre(0, i as u32) / unit) as f32;
        }
        raise(&mut row.x);
        for (j, colours) in colours.chunks_exact_mut(nx).enumerate() {
            let y = (self.view.grid.centre(1, j as u32) / unit) as f32;
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
            let [red, green, blue] = &row.colours;
            for (colour, ((red, green), blue)) in
                colours.iter_mut().zip(red.iter().zip(green).zip(blue))
            {
                colour[0] += red;
                colour[1] += green;
                colour[2] += blue;
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

    /// Sets the slopes, limited to `steepest`, and their powers: those of `line` at pixels `dx`
    /// apart (m), and the difference of the lines beside it times `across` (1/m).
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
        let (lower, higher) = powers.split_at_mut(power);
        let (base, last, next) = (&lower[1][..], &lower[power - 1][..], &mut higher[0][..]);
        vectorised(
            #[inline(always)]
            || {
                let pairs = base.iter().zip(last);
                next.iter_mut().zip(pairs).for_each(|(next, (base, last))| *next = base * last);
            },
        );
    }
}

/// Adds `weight` · `values` to `sum`.
fn add(sum: &mut [f32], weight: f32, values: &[f32]) {
    vectorised(
        #[inline(always)]
        || sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value),
    );
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
