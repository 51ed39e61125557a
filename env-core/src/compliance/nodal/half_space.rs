//! Half-space under forces on its face.
//!
//! For a force F on the face, the vector r from there to a point at depth d below the face,
//! ρ = |r|, m = 1 − 2ν and Φ = (F_x r_x + F_y r_y)/(ρ + d) + F_z ln(ρ + d), with z out of the face,
//! displacement and strain are 1/(4πμ) times
//!
//! - u = F/ρ + (F·r) r/ρ³ + m (Φ,x  Φ,y  Φ,d),
//! - ε = (F·r) (1/ρ³ − 3 r rᵀ/ρ⁵) + m H, where H is the Hessian of Φ in the plane, −Φ,dd normal to
//!   it and zero otherwise
//!
//! (Boussinesq's and Cerruti's solutions; Johnson 1985, Contact Mechanics, ch. 3). Forces may act
//! at a height over the face, so that they bear on it as smooth pressures.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use crate::simd::LANES;

/// One number for each of the points that are computed together.
pub(super) type Lanes = [f32; LANES];

/// Force (N) at a place of the face (m).
#[derive(Clone, Copy)]
pub(super) struct PointForce {
    pub(super) place: [f32; 2],
    pub(super) force: [f32; 3],
}

/// Half-space with m = 1 − 2ν, and the height over its face from which forces act (m).
#[derive(Clone, Copy)]
pub(super) struct HalfSpace {
    pub(super) m: f32,
    pub(super) lift: f32,
}

impl HalfSpace {
    /// Displacement of the points `at` under `forces`, times 4πμ: x, y and z.
    #[inline(always)]
    pub(super) fn displacement(self, at: &[Lanes; 3], forces: &[PointForce]) -> [Lanes; 3] {
        let mut sum = [[0.0; LANES]; 3];
        for PointForce { place, force: [fx, fy, fz] } in forces {
            for i in 0..LANES {
                let (x, y, d) = (at[0][i] - place[0], at[1][i] - place[1], at[2][i] + self.lift);
                let (r, w) = inverses(x * x + y * y + d * d, d);
                let plane = fx * x + fy * y;
                let along = (plane - fz * d) * r * r * r;
                // Part of the gradient of Φ that is along r in the plane.
                let inwards = (fz - plane * w) * w * r;
                sum[0][i] += fx * (r + self.m * w) + x * (along + self.m * inwards);
                sum[1][i] += fy * (r + self.m * w) + y * (along + self.m * inwards);
                sum[2][i] += fz * r - d * along + self.m * (fz - plane * w) * r;
            }
        }
        sum
    }

    /// Strain of the points `at` under `forces`, times 4πμ: xx, yy, zz, xy, xz and yz.
    #[inline(always)]
    pub(super) fn strain(self, at: &[Lanes; 3], forces: &[PointForce]) -> [Lanes; 6] {
        let mut sum = [[0.0; LANES]; 6];
        for PointForce { place, force: [fx, fy, fz] } in forces {
            for i in 0..LANES {
                let (x, y, d) = (at[0][i] - place[0], at[1][i] - place[1], at[2][i] + self.lift);
                let (r, w) = inverses(x * x + y * y + d * d, d);
                let (plane, square, product) = (fx * x + fy * y, r * r, r * w);
                let even = (plane - fz * d) * (square * r);
                let along = -3.0 * even * square;
                // Factors in the Hessian of Φ: of F_x x and its like, of x² and its like, of 1.
                let turn = self.m * w * product;
                let (turn_x, turn_y, turned) = (turn * fx, turn * fy, turn * plane);
                let (upright, factor) = (self.m * fz * product, square + product);
                let both = along + turned * (factor + product) - upright * factor;
                let all = even + (upright - turned);
                let (by_x, by_y, by_d) = (both * x - turn_x, both * y - turn_y, along * d);
                sum[0][i] += (by_x - turn_x) * x + all;
                sum[1][i] += (by_y - turn_y) * y + all;
                sum[2][i] += by_d * d + (1.0 - self.m) * even;
                sum[3][i] += by_x * y - turn_y * x;
                sum[4][i] -= by_d * x;
                sum[5][i] -= by_d * y;
            }
        }
        sum
    }
}

/// 1/ρ and 1/(ρ + d), for ρ² and d.
#[inline(always)]
fn inverses(square: f32, d: f32) -> (f32, f32) {
    let rho = square.sqrt();
    let both = 1.0 / (square * (rho + d));
    (rho * (rho + d) * both, square * both)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use nalgebra::{Matrix3, Vector3};

    use super::*;

    const FORCES: [PointForce; 2] = [
        PointForce { place: [0.2, -0.1], force: [0.7, -0.3, -1.0] },
        PointForce { place: [-0.4, 0.3], force: [0.0, 0.5, 0.2] },
    ];

    fn lanes([x, y, depth]: [f32; 3]) -> [Lanes; 3] {
        [x, y, depth].map(|x| [x; LANES])
    }

    #[test]
    fn strain_is_the_derivative_of_displacement() {
        const STEP: f32 = 1e-2;
        let space = HalfSpace { m: 0.4, lift: 0.1 };
        for point in [[0.0, 0.0, 0.6], [1.1, -0.3, 0.9], [-0.6, 0.8, 0.2], [0.2, -0.1, 1.4]] {
            let moved = |axis: usize, step: f32| {
                let mut point = point;
                // Depth grows against z.
                point[axis] += if axis == 2 { -step } else { step };
                space.displacement(&lanes(point), &FORCES).map(|u| u[0])
            };
            let by = |axis| {
                let [there, back] = [moved(axis, STEP), moved(axis, -STEP)];
                Vector3::from(there) - Vector3::from(back)
            };
            let gradient = Matrix3::from_columns(&[by(0), by(1), by(2)]) / (2.0 * STEP);
            let right = (gradient + gradient.transpose()) * 0.5;
            let [xx, yy, zz, xy, xz, yz] = space.strain(&lanes(point), &FORCES).map(|e| e[0]);
            let found = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
            let error = (found - right).norm() / right.norm();
            assert!(error < 5e-3, "{found} instead of {right} at {point:?}");
        }
    }

    /// The stress across a plane under the face, summed over the plane, is the force on the face.
    #[test]
    fn stress_across_a_plane_bears_the_force() {
        const RADII: usize = 400;
        const ANGLES: usize = 32;
        let (nu, depth) = (0.3, 0.5);
        let space = HalfSpace { m: (1.0 - 2.0 * nu) as f32, lift: 0.0 };
        let force = Vector3::new(0.7, -0.3, -1.0);
        let load = PointForce { place: [0.0; 2], force: force.map(|f| f as f32).into() };
        let mut sum = Vector3::zeros();
        for slope in (0..RADII).map(|i| (i as f64 + 0.5) * FRAC_PI_2 / RADII as f64) {
            let radius = depth * slope.tan();
            let ring = depth / slope.cos().powi(2) * FRAC_PI_2 / RADII as f64;
            for angle in (0..ANGLES).map(|i| i as f64 * 2.0 * PI / ANGLES as f64) {
                let at = [radius * angle.cos(), radius * angle.sin(), depth].map(|x| x as f32);
                let strain = space.strain(&lanes(at), &[load]).map(|e| f64::from(e[0]));
                let [xx, yy, zz, _, xz, yz] = strain;
                // Strain is times 4πμ, so that stress is 2μ of it over 4πμ.
                let normal = zz + nu / (1.0 - 2.0 * nu) * (xx + yy + zz);
                let area = radius * ring * 2.0 * PI / ANGLES as f64;
                sum += Vector3::new(xz, yz, normal) * (area / (2.0 * PI));
            }
        }
        assert!((sum - force).norm() < 2e-3, "{sum} instead of {force}");
    }
}
