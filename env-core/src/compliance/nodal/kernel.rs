//! Compliance of a bonded elastic layer, between square-like cells on its face and at depth.
//!
//! A layer of thickness t, infinite in plan and bonded to a rigid base, is displaced at its face by
//! u(x) = ∫ G(x − ξ) p(ξ) dξ under a traction p. With κ = k t for the wave number k, shear modulus
//! μ and D(κ) = (3−4ν) cosh 2κ + 2κ² + 5 − 12ν + 8ν², the transform of G has the parts
//!
//! - normal (1−ν)/(μk) · ((3−4ν) sinh 2κ − 2κ)/D,
//! - along the wave (1−ν)/(μk) · ((3−4ν) sinh 2κ + 2κ)/D,
//! - across it tanh κ/(μk),
//! - coupling of the first two 1/(μk) · ((1−2ν)(3−4ν)(1 − cosh 2κ)/2 + κ²)/D,
//!
//! which follow from Navier's equations in plane strain with zero displacement at the base. For
//! large κ they are those of a half-space. G is the half-space's, which is integrated over a cell
//! in closed form (Johnson 1985, Contact Mechanics, ch. 3: Boussinesq's and Cerruti's solutions),
//! plus a smooth rest, the Hankel transform of the difference. Below the face the solution is the
//! exponential of the same equations as a system of first order in depth.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use std::sync::Arc;

use nalgebra::{Matrix2, Matrix3, Matrix4};

use crate::{deformation::Moduli, simd::vectorised};

/// Mean displacement of cells under unit forces spread over others (m/N), for grids of which each
/// has cells half as long as the one before.
pub(super) struct LayerKernel {
    levels: Vec<Arc<Table>>,
}

/// Displacements by the distance of two cells.
pub(super) struct Table {
    /// Least distances along x and y at which the displacement is zero.
    reach: [usize; 2],
    /// Least distances along x and y that have no entries.
    count: [usize; 2],
    /// Displacements for distances of 0 or more. The signs of x and y turn with those of a
    /// distance.
    entries: Vec<Columns>,
    /// Table of cells twice as long, which has the displacements for distances without entries.
    longer: Option<Arc<Table>>,
    /// Displacements for distances up to [`NEAR`] with their signs, and for a strip more along y:
    /// by distance along x, axis of the force and distance along y.
    near: Vec<f32>,
}

/// Displacement under unit forces along each axis (m/N): three columns of three numbers and one
/// that is not used.
pub(super) type Columns = [f32; 12];

/// Displacement of a plane parallel to the face under forces on points of the face (m/N).
pub(super) struct PlaneKernel {
    radial: Radial,
    thickness: f64,
    /// 1/(E t) (m/N).
    scale: f64,
}

/// Distance beyond which the layer does not move, in thicknesses.
const REACH: f64 = 4.0;
/// Distance in cells up to which cells smaller than the first level's have entries of their own;
/// farther away, the larger cells' are interpolated.
const OWN: usize = 24;
/// Most distances along an axis with entries: interpolation takes longer, and all entries of the
/// finest grids together take hundreds of megabytes.
const STORED: usize = 512;
/// Number of cells along y in a strip.
pub(super) const STRIP: usize = 8;
/// Distance in cells along each axis of strips that are read as they lie in memory.
const NEAR: i32 = 31;
/// Largest wave number, in 1/t over the depth in t, and its largest value at the face.
const WAVES: (f64, f64) = (14.0, 40.0);
/// Wave numbers are this far apart, in 1/t.
const WAVE: f64 = 0.025;
/// Intervals in radius over one thickness.
const RADII: usize = 40;

impl LayerKernel {
    /// Tabulates the kernel for `levels` grids, the first with cells of `sides` (m), on a layer of
    /// `thickness` (m).
    pub(super) fn new(sides: [f64; 2], levels: usize, thickness: f64, moduli: Moduli) -> Self {
        let rest = Radial::new(WAVES.0, |k| difference(k, moduli.poisson));
        let count = sides.map(|side| (REACH * thickness / side).ceil() as usize + 1);
        let mut all: Vec<Arc<Table>> = Vec::with_capacity(levels);
        for level in 0..levels {
            let sides = sides.map(|side| side / f64::from(1u32 << level));
            let longer = all.last().cloned();
            let table = Table::new(count.map(|count| count << level), longer, |at| {
                let sides = sides.map(|side| side / thickness);
                let at = [at[0] as f64 * sides[0], at[1] as f64 * sides[1]];
                let near = half_space_cell(at, sides, moduli.poisson) + rest.cell(at, sides);
                near * (1.0 / (moduli.young * thickness))
            });
            all.push(Arc::new(table));
        }
        Self { levels: all }
    }

    /// Displacements of cells of a `level`.
    pub(super) fn level(&self, level: usize) -> &Table {
        &self.levels[level]
    }
}

impl Table {
    /// Tabulates the displacement `under` unit forces at distances less than `reach`, as it is or,
    /// far away, between those of the cells twice as long.
    fn new(
        reach: [usize; 2],
        longer: Option<Arc<Self>>,
        under: impl Fn([usize; 2]) -> Matrix3<f64>,
    ) -> Self {
        let count = if longer.is_some() { reach.map(|count| count.min(STORED)) } else { reach };
        let mut all = Self { reach, count, entries: Vec::new(), near: Vec::new(), longer };
        all.entries.reserve_exact(count[0] * count[1]);
        for (x, y) in (0..count[0]).flat_map(|x| (0..count[1]).map(move |y| (x, y))) {
            let is_far = all.longer.is_some() && x.max(y) > OWN + 1;
            let entry = if is_far { all.far([x, y]) } else { columns(&under([x, y]).cast()) };
            all.entries.push(entry);
        }
        for (x, axis) in (-NEAR..=NEAR).flat_map(|x| [0, 1, 2].map(|axis| (x, axis))) {
            for y in (-NEAR..).take(2 * NEAR as usize + STRIP) {
                let columns = all.at([x, y]);
                all.near.extend_from_slice(&columns[4 * axis..][..3]);
            }
        }
        all
    }

    /// Displacements of a strip whose first cell is `away` from the loaded one under unit forces
    /// along each axis (m/N), if it is near.
    #[inline(always)]
    pub(super) fn strip(&self, away: [i32; 2]) -> Option<[&[f32; 3 * STRIP]; 3]> {
        const WIDTH: usize = 3 * (2 * NEAR as usize + STRIP);
        let place = |axis: usize| (away[axis] + NEAR) as usize;
        let [x, y] = [place(0), place(1)];
        if x.max(y) > 2 * NEAR as usize {
            return None;
        }
        let rows = &self.near[3 * WIDTH * x..][..3 * WIDTH];
        let axis = |axis| rows[axis * WIDTH + 3 * y..].first_chunk();
        Some([axis(0)?, axis(1)?, axis(2)?])
    }

    /// Displacement of a cell under unit forces on the cell from which it is `away`, in cells along
    /// x and y (m/N).
    #[inline(always)]
    pub(super) fn at(&self, away: [i32; 2]) -> Columns {
        let mut far = Columns::default();
        let (entry, signs) = self.entry(away, &mut far);
        let mut turned = [0.0; 12];
        for axis in 0..3 {
            for i in 0..4 {
                turned[4 * axis + i] = entry[4 * axis + i] * (signs[axis] * signs[i]);
            }
        }
        turned
    }

    /// Displacement at the same distance along x and y without their signs, and these; it is
    /// written to `far` if there is no entry.
    #[inline(always)]
    fn entry<'a>(&'a self, away: [i32; 2], far: &'a mut Columns) -> (&'a Columns, [f32; 4]) {
        let [x, y] = away.map(|cells| cells.unsigned_abs() as usize);
        let sign = |axis: usize| if away[axis] < 0 { -1.0 } else { 1.0 };
        let signs = [sign(0), sign(1), 1.0, 1.0];
        if x < self.count[0] && y < self.count[1] {
            return (&self.entries[x * self.count[1] + y], signs);
        }
        *far = self.far([x, y]);
        (far, signs)
    }

    /// Displacement at a distance without an entry, interpolated in the first table of longer cells
    /// that has entries around it. Those between would give the same, since they interpolate, too.
    #[inline(always)]
    fn far(&self, away: [usize; 2]) -> Columns {
        let mut sum = Columns::default();
        if away[0] >= self.reach[0] || away[1] >= self.reach[1] {
            return sum;
        }
        let (mut table, mut at) = (self, away.map(|cells| cells as f32));
        while let Some(longer) = &table.longer {
            (table, at) = (longer, at.map(|cells| 0.5 * cells));
            let is_within = (0..2).all(|axis| at[axis] + 1.0 < table.count[axis] as f32);
            if is_within || table.count == table.reach {
                break;
            }
        }
        for (corner, weight) in corners(at) {
            let [x, y] = corner.map(|cells| cells as usize);
            if x < table.count[0] && y < table.count[1] {
                let entry = &table.entries[x * table.count[1] + y];
                sum.iter_mut().zip(entry).for_each(|(sum, entry)| *sum += weight * entry);
            }
        }
        sum
    }

    /// Displacement (m) at a distance under a `force` (N).
    #[inline(always)]
    pub(super) fn moved(&self, away: [i32; 2], force: [f32; 3]) -> [f32; 4] {
        let mut far = Columns::default();
        let (entry, signs) = self.entry(away, &mut far);
        let [x, y, z] = [force[0] * signs[0], force[1] * signs[1], force[2]];
        let mut moved = [0.0; 4];
        for i in 0..4 {
            moved[i] = signs[i] * (x * entry[i] + y * entry[4 + i] + z * entry[8 + i]);
        }
        moved
    }

    /// Displacement (m) of the cell `at` under forces (N) on the cells `loaded`.
    pub(super) fn sum(&self, at: [i32; 2], loaded: &[([i32; 2], [f32; 3])]) -> [f32; 3] {
        let mut sum = [0.0; 4];
        vectorised(
            #[inline(always)]
            || {
                for (from, force) in loaded {
                    let moved = self.moved([at[0] - from[0], at[1] - from[1]], *force);
                    for i in 0..4 {
                        sum[i] += moved[i];
                    }
                }
            },
        );
        [sum[0], sum[1], sum[2]]
    }

    /// [`Table::at`] as a matrix for a distance that is not a whole number of cells, interpolated.
    pub(super) fn between(&self, away: [f32; 2]) -> Matrix3<f32> {
        let mut sum = Matrix3::zeros();
        for (corner, weight) in corners(away).into_iter().filter(|(_, weight)| *weight > 0.0) {
            sum += matrix(&self.at(corner)) * weight;
        }
        sum
    }

    /// Displacement (m) under a `force` (N) at a distance that is not a whole number of cells,
    /// interpolated.
    #[inline(always)]
    pub(super) fn under(&self, away: [f32; 2], force: [f32; 3]) -> [f32; 3] {
        let mut sum = [0.0; 4];
        for (corner, weight) in corners(away) {
            let moved = self.moved(corner, force);
            for k in 0..4 {
                sum[k] += weight * moved[k];
            }
        }
        [sum[0], sum[1], sum[2]]
    }
}

/// Whole numbers of cells around a distance, with the weights that interpolate between them.
#[inline(always)]
fn corners(away: [f32; 2]) -> [([i32; 2], f32); 4] {
    let low = away.map(f32::floor);
    let [by_x, by_y] = [0, 1].map(|axis| {
        let share = away[axis] - low[axis];
        [1.0 - share, share]
    });
    let [x, y] = low.map(|cells| cells as i32);
    [[0, 0], [0, 1], [1, 0], [1, 1]]
        .map(|[i, j]| ([x + i, y + j], by_x[i as usize] * by_y[j as usize]))
}

/// The columns of a matrix.
fn columns(matrix: &Matrix3<f32>) -> Columns {
    std::array::from_fn(|k| if k % 4 < 3 { matrix[(k % 4, k / 4)] } else { 0.0 })
}

/// The matrix of some columns.
pub(super) fn matrix(columns: &Columns) -> Matrix3<f32> {
    Matrix3::from_fn(|i, axis| columns[4 * axis + i])
}

impl PlaneKernel {
    /// Tabulates the displacement of the plane `depth` (m) below the face of a layer of `thickness`
    /// (m).
    pub(super) fn new(depth: f64, thickness: f64, moduli: Moduli) -> Self {
        let depth = depth / thickness;
        let most = f64::min(WAVES.0 / depth, WAVES.1);
        let radial = Radial::new(most, |k| below(k, depth, moduli.poisson));
        Self { radial, thickness, scale: 1.0 / (moduli.young * thickness) }
    }

    /// Displacement at a horizontal distance (m) from a unit force on the face (m/N).
    pub(super) fn at(&self, x: f64, y: f64) -> Matrix3<f64> {
        self.radial.at(x / self.thickness, y / self.thickness) * self.scale
    }

    /// Displacement at a horizontal distance (m) from a `force` (N) on the face (m).
    #[inline(always)]
    pub(super) fn under(&self, [x, y]: [f64; 2], force: [f32; 3]) -> [f32; 3] {
        let Some((parts, [x, y, half])) = self.radial.parts(x / self.thickness, y / self.thickness)
        else {
            return [0.0; 3];
        };
        let [mean, deviator, normal, out, back] = parts;
        let f = |axis: usize| f64::from(force[axis]) * self.scale;
        let [fx, fy, fz] = [f(0), f(1), f(2)];
        let along = x * fx + y * fy;
        let (even, away) = (mean - deviator * half, deviator * along + out * fz);
        let (ux, uy, uz) = (even * fx + away * x, even * fy + away * y, back * along + normal * fz);
        [ux as f32, uy as f32, uz as f32]
    }
}

/// Displacement, times E, of a half-space's face averaged over a cell of `sides` centred at `at`
/// under a unit force spread evenly over an equal cell at the origin.
fn half_space_cell(at: [f64; 2], sides: [f64; 2], poisson: f64) -> Matrix3<f64> {
    let away = (at[0] / sides[0]).hypot(at[1] / sides[1]);
    let points: &[(f64, f64)] = match away {
        x if x < 2.5 => &GAUSS_4,
        x if x < 6.0 => &GAUSS_2,
        _ => &[(0.0, 1.0)],
    };
    let mut mean = Matrix3::zeros();
    for (x, by_x) in points {
        for (y, by_y) in points {
            let at = [at[0] + x * sides[0], at[1] + y * sides[1]];
            mean += half_space(at, sides, poisson) * (by_x * by_y);
        }
    }
    mean
}

/// Points and weights of Gauss's rule on (−½, ½).
const GAUSS_2: [(f64, f64); 2] = [(-0.288_675_134_594_812_9, 0.5), (0.288_675_134_594_812_9, 0.5)];
const GAUSS_4: [(f64, f64); 4] = [
    (-0.430_568_155_797_026_3, 0.173_927_422_568_726_93),
    (-0.169_990_521_792_428_13, 0.326_072_577_431_273_07),
    (0.169_990_521_792_428_13, 0.326_072_577_431_273_07),
    (0.430_568_155_797_026_3, 0.173_927_422_568_726_93),
];

/// Displacement, times E, of the point `at` on a half-space's face under a unit force spread evenly
/// over a cell of `sides` at the origin.
fn half_space(at: [f64; 2], sides: [f64; 2], nu: f64) -> Matrix3<f64> {
    // Integrals over the cell of x²/r³, y²/r³, xy/r³, x/r² and y/r², by their values at its
    // corners.
    let (mut xx, mut yy, mut xy, mut x1, mut y1) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (sign_x, x) in [(1.0, at[0] + 0.5 * sides[0]), (-1.0, at[0] - 0.5 * sides[0])] {
        for (sign_y, y) in [(1.0, at[1] + 0.5 * sides[1]), (-1.0, at[1] - 0.5 * sides[1])] {
            let (sign, r) = (sign_x * sign_y, x.hypot(y));
            // b ln(a + r) without the part that cancels between the corners.
            let along = |a: f64, b: f64| if b == 0.0 { 0.0 } else { b * (a / b.abs()).asinh() };
            xx += sign * along(x, y);
            yy += sign * along(y, x);
            xy -= sign * r;
            let log = |b: f64| if r > 0.0 { b * r.ln() } else { 0.0 };
            let turn = |a: f64, b: f64| if a == 0.0 { 0.0 } else { a * (b / a).atan() };
            x1 += sign * (log(y) + turn(x, y));
            y1 += sign * (log(x) + turn(y, x));
        }
    }
    let mu = 0.5 / (1.0 + nu);
    let even = 1.0 / (2.0 * std::f64::consts::PI * mu * sides[0] * sides[1]);
    let odd = 0.5 * (1.0 - 2.0 * nu) * even;
    let all = xx + yy;
    Matrix3::new(
        even * ((1.0 - nu) * all + nu * xx),
        even * nu * xy,
        odd * x1,
        even * nu * xy,
        even * ((1.0 - nu) * all + nu * yy),
        odd * y1,
        -odd * x1,
        -odd * y1,
        even * (1.0 - nu) * all,
    )
}

/// Response of a layer of E and t of 1 to a plane wave of traction: displacement along the wave
/// under traction along it, across under across, normal under normal, along under normal, normal
/// under along.
type WaveResponse = [f64; 5];

/// Displacement by distance, the Hankel transforms of a response to waves.
struct Radial {
    /// Isotropic part in the plane, deviatoric part, normal part, and the parts that couple the
    /// plane with the normal, at radii of multiples of 1/[`RADII`].
    by_radius: Vec<WaveResponse>,
}

impl Radial {
    /// Transforms the `response` to wave numbers up to `most`, by Simpson's rule.
    fn new(most: f64, response: impl Fn(f64) -> WaveResponse) -> Self {
        let count = 2 * (0.5 * most / WAVE).ceil() as usize;
        let step = most / count as f64;
        let wave = |i: usize| {
            let k = f64::max(i as f64 * step, 1e-6);
            let weight = if i.is_multiple_of(count) { 1.0 } else { 2.0 + 2.0 * (i % 2) as f64 };
            (k, response(k).map(|g| g * k * weight * step / 3.0))
        };
        let waves: Vec<_> = (0..=count).map(wave).collect();
        let pi = std::f64::consts::PI;
        let at = |r: usize| {
            let r = r as f64 / RADII as f64;
            let mut sum = WaveResponse::default();
            for &(k, [along, across, normal, out, back]) in &waves {
                let (j0, j1) = (libm::j0(k * r), libm::j1(k * r));
                let j2 = if r == 0.0 { 0.0 } else { 2.0 * j1 / (k * r) - j0 };
                sum[0] += 0.25 / pi * (along + across) * j0;
                sum[1] -= 0.5 / pi * (along - across) * j2;
                sum[2] += 0.5 / pi * normal * j0;
                sum[3] -= 0.5 / pi * out * j1;
                sum[4] += 0.5 / pi * back * j1;
            }
            sum
        };
        Self { by_radius: (0..(REACH * 1.6) as usize * RADII).map(at).collect() }
    }

    /// Mean over a cell at `at`, of `sides`, under a unit force spread over a cell at the origin.
    fn cell(&self, at: [f64; 2], sides: [f64; 2]) -> Matrix3<f64> {
        // The distance between points of two cells has the variance side²/6 along each side.
        let [x, y] = sides.map(|side| side / 6.0_f64.sqrt());
        let ends = [[x, y], [x, -y], [-x, y], [-x, -y]];
        ends.iter().map(|[x, y]| self.at(at[0] + x, at[1] + y)).sum::<Matrix3<f64>>() * 0.25
    }

    /// Parts at the distance of (x, y), its direction, and half of the square of this vector.
    #[inline(always)]
    fn parts(&self, x: f64, y: f64) -> Option<(WaveResponse, [f64; 3])> {
        let r = (x * x + y * y).sqrt();
        let place = r * RADII as f64;
        let [low, high] = self.by_radius.get(place as usize..)?.first_chunk()?;
        let share = place.fract();
        let mut parts = *low;
        for i in 0..parts.len() {
            parts[i] += share * (high[i] - low[i]);
        }
        Some((parts, if r > 0.0 { [x / r, y / r, 0.5] } else { [0.0; 3] }))
    }

    fn at(&self, x: f64, y: f64) -> Matrix3<f64> {
        let Some((parts, [x, y, half])) = self.parts(x, y) else { return Matrix3::zeros() };
        let [mean, deviator, normal, out, back] = parts;
        Matrix3::new(
            mean + deviator * (x * x - half),
            deviator * x * y,
            out * x,
            deviator * x * y,
            mean + deviator * (y * y - half),
            out * y,
            back * x,
            back * y,
            normal,
        )
    }
}

/// Response of the layer's face less that of a half-space's.
fn difference(k: f64, nu: f64) -> WaveResponse {
    let mu = 0.5 / (1.0 + nu);
    let four = 3.0 - 4.0 * nu;
    // Numerators and denominator times 2 exp(−2k).
    let (once, twice) = ((-2.0 * k).exp(), (-4.0 * k).exp());
    let (sinh, cosh) = (1.0 - twice, 1.0 + twice);
    let below = four * cosh + 2.0 * once * (2.0 * k * k + 5.0 - 12.0 * nu + 8.0 * nu * nu);
    let ratio = |sign: f64| (four * sinh + 4.0 * sign * k * once) / below;
    let coupling = 0.5 * (1.0 - 2.0 * nu) * four * (2.0 * once - cosh) + 2.0 * k * k * once;
    let coupling = coupling / below + 0.5 * (1.0 - 2.0 * nu);
    let across = (1.0 - once) / (1.0 + once);
    [
        (1.0 - nu) * (ratio(1.0) - 1.0),
        across - 1.0,
        (1.0 - nu) * (ratio(-1.0) - 1.0),
        coupling,
        coupling,
    ]
    .map(|g| g / (mu * k))
}

/// Response of the plane at `depth` below the face.
fn below(k: f64, depth: f64, nu: f64) -> WaveResponse {
    let (mu, lambda) = (0.5 / (1.0 + nu), nu / ((1.0 + nu) * (1.0 - 2.0 * nu)));
    // Displacements i U along the wave and W, and tractions i T and S, all times exp(ikx), change
    // with height as y' = k M y. At the base U and W are zero.
    let stiff = lambda + 2.0 * mu;
    #[rustfmt::skip]
    let m = Matrix4::new(
        0.0, -1.0, 1.0 / mu, 0.0,
        lambda / stiff, 0.0, 0.0, 1.0 / stiff,
        stiff - lambda * lambda / stiff, 0.0, 0.0, -lambda / stiff,
        0.0, 0.0, 1.0, 0.0,
    );
    let (here, face) = (exponential(&m, k * (1.0 - depth)), exponential(&m, k));
    let moved: Matrix2<f64> = here.fixed_view::<2, 2>(0, 2).into();
    let pulled: Matrix2<f64> = face.fixed_view::<2, 2>(2, 2).into();
    let g = pulled.try_inverse().map_or_else(Matrix2::zeros, |inverse| moved * inverse);
    let across =
        (-k * depth).exp() * (1.0 - (-2.0 * k * (1.0 - depth)).exp()) / (1.0 + (-2.0 * k).exp());
    [g[(0, 0)], across / mu, g[(1, 1)], g[(0, 1)], g[(1, 0)]].map(|g| g / k)
}

/// exp(`m` x) for a matrix with (m² − 1)² = 0.
fn exponential(m: &Matrix4<f64>, x: f64) -> Matrix4<f64> {
    let (sinh, cosh) = (x.sinh(), x.cosh());
    let two = 0.5 * x * sinh;
    let three = 0.5 * (x * cosh - sinh);
    let square = m * m;
    Matrix4::identity() * (cosh - two) + m * (sinh - three) + square * two + square * m * three
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distant_small_cells_move_as_larger_ones_do() {
        let moduli = Moduli { young: 3e5, poisson: 0.47 };
        let (sides, thickness) = ([1.2e-3, 1.3e-3], 4e-3);
        let kernel = LayerKernel::new(sides, 5, thickness, moduli);
        let rest = Radial::new(WAVES.0, |k| difference(k, moduli.poisson));
        for (level, away) in [(3, [30, 3]), (3, [-4, 60]), (4, [50, -40]), (4, [-100, -100])] {
            let sides = sides.map(|side| side / thickness / f64::from(1u32 << level));
            let at = [0, 1].map(|axis| sides[axis] * f64::from(away[axis]));
            let near = half_space_cell(at, sides, moduli.poisson) + rest.cell(at, sides);
            let right = near * (1.0 / (moduli.young * thickness));
            let found = matrix(&kernel.level(level).at(away)).cast::<f64>();
            let error = (found - right).norm() / right.norm();
            assert!(error < 5e-3, "{away:?} cells away on level {level}: {error:.1e}");
        }
        let far = kernel.level(2).at([100, 0]);
        assert!(far == Columns::default(), "{far:?}");
    }

    #[test]
    fn distances_without_entries_are_interpolated_and_end_where_the_layer_does() {
        let moduli = Moduli { young: 3e5, poisson: 0.47 };
        let kernel = LayerKernel::new([1.2e-3, 1.3e-3], 8, 4e-3, moduli);
        let (coarse, fine) = (kernel.level(6), kernel.level(7));
        assert!(coarse.reach[0] > STORED && fine.count == [STORED; 2]);
        for cells in [STORED.cast_signed() as i32 / 2 + 3, STORED.cast_signed() as i32 + 40] {
            let (far, own) = (matrix(&fine.at([-2 * cells, 20])), matrix(&coarse.at([-cells, 10])));
            assert!(far == own && own != Matrix3::zeros(), "{far} {own}");
            let [odd, sides] = [[2 * cells + 1, 21], [cells, 10]];
            let mean = [[0, 0], [0, 1], [1, 0], [1, 1]]
                .map(|[x, y]| matrix(&coarse.at([sides[0] + x, sides[1] + y])) * 0.25);
            let error = matrix(&fine.at(odd)) - mean.iter().sum::<Matrix3<f32>>();
            assert!(error.norm() < 1e-6 * own.norm(), "{error}");
        }
        let end = fine.reach[1].cast_signed() as i32;
        assert!(fine.at([0, 1 - end]) != Columns::default());
        assert!([[0, end], [0, -end]].map(|away| fine.at(away)) == [Columns::default(); 2]);
    }
}
