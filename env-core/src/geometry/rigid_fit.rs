//! The rigid motion nearest to a deformation, in the sense of least squares.
//!
//! Minimises Σ ‖R pᵢ + t − qᵢ‖² over rotations R and shifts t: R = V diag(1, 1, ±1) Uᵀ from the
//! singular values of Σ (pᵢ − p̄)(qᵢ − q̄)ᵀ = U S Vᵀ, the sign so that R does not mirror (Arun,
//! Huang and Blostein 1987, with Umeyama's sign of 1991).

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::{Error, Result};

/// A rigid motion fitted to points that moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidFit {
    /// Motion from the first positions of the points to the second.
    pub motion: Isometry3<f64>,
    /// Root mean square of the distances that remain after the motion (m).
    pub residual: f64,
}

/// Ratio of the second to the first singular value below which points lie on a line.
const LINE: f64 = 1e-12;

impl RigidFit {
    /// Fits a rigid motion to that of points from `from` (N) to `to` (N). Returns an error if the
    /// numbers of points differ, or if all points lie on one line, about which the rotation would
    /// be arbitrary.
    pub fn new(from: &[Point3<f64>], to: &[Point3<f64>]) -> Result<Self> {
        if from.len() != to.len() {
            return Err(Error::invalid("points", to.len(), format!("{} of them", from.len())));
        }
        let centres = [from, to].map(centre);
        let mut products = Matrix3::zeros();
        for (p, q) in from.iter().zip(to) {
            products += (p.coords - centres[0]) * (q.coords - centres[1]).transpose();
        }
        let svd = products.svd(true, true);
        let [first, second, _] = svd.singular_values.into();
        if second <= LINE * first || !second.is_finite() {
            let found = format!("{} points on a line or not finite", from.len());
            return Err(Error::invalid("points", found, "three or more that span a plane"));
        }
        let u = svd.u.expect("asked for");
        let v = svd.v_t.expect("asked for").transpose();
        let sign = (v * u.transpose()).determinant().signum();
        let turn = v * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * u.transpose();
        let turn = UnitQuaternion::from(Rotation3::from_matrix_unchecked(turn));
        let shift = Translation3::from(centres[1] - turn * centres[0]);
        let motion = Isometry3::from_parts(shift, turn);
        let left = from.iter().zip(to).map(|(p, q)| (motion * p - q).norm_squared());
        Ok(Self { motion, residual: (left.sum::<f64>() / from.len() as f64).sqrt() })
    }
}

fn centre(points: &[Point3<f64>]) -> Vector3<f64> {
    points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points() -> Vec<Point3<f64>> {
        let at = |i: u32| {
            let t = f64::from(i);
            Point3::new(0.01 * t.sin(), 0.02 * (1.3 * t).cos(), 0.03 * (2.1 * t).sin())
        };
        (0..20).map(at).collect()
    }

    fn motion() -> Isometry3<f64> {
        Isometry3::new(Vector3::new(0.1, -0.2, 0.3), Vector3::new(1.0, 2.0, -0.5))
    }

    #[test]
    fn a_rigid_motion_is_found() {
        let from = points();
        let to: Vec<_> = from.iter().map(|p| motion() * p).collect();
        let fit = RigidFit::new(&from, &to).unwrap();
        let turn = fit.motion.rotation.angle_to(&motion().rotation);
        let shift = (fit.motion.translation.vector - motion().translation.vector).norm();
        assert!(turn < 1e-7 && shift < 1e-14, "off by {turn} rad, {shift} m");
        assert!(fit.residual < 1e-14, "{} m", fit.residual);
    }

    #[test]
    fn points_in_a_plane_are_not_mirrored() {
        let from: Vec<_> = points().iter().map(|p| Point3::new(p.x, p.y, 0.0)).collect();
        let to: Vec<_> = from.iter().map(|p| motion() * p).collect();
        let fit = RigidFit::new(&from, &to).unwrap();
        let ahead = (fit.motion * Vector3::z() - motion() * Vector3::z()).norm();
        assert!(ahead < 1e-12, "normals {ahead} apart");
    }

    #[test]
    fn no_other_motion_is_nearer() {
        let from = points();
        let mut to: Vec<_> = from.iter().map(|p| motion() * p).collect();
        for (i, q) in to.iter_mut().enumerate() {
            q.y *= 1.0 + 0.02 * (i as f64).cos();
        }
        let fit = RigidFit::new(&from, &to).unwrap();
        for i in 0..6 {
            let mut step = [0.0; 6];
            step[i] = 1e-4;
            let [x, y, z, a, b, c] = step;
            let aside = Isometry3::new(Vector3::new(x, y, z), Vector3::new(a, b, c)) * fit.motion;
            let left: f64 = from.iter().zip(&to).map(|(p, q)| (aside * p - q).norm_squared()).sum();
            let left = (left / from.len() as f64).sqrt();
            assert!(left > fit.residual, "{left} m against {} m", fit.residual);
        }
    }

    #[test]
    fn points_without_a_motion_are_refused() {
        let line: Vec<_> = (0..5).map(|i| Point3::new(f64::from(i), 0.0, 0.0)).collect();
        assert!(RigidFit::new(&line, &line).unwrap_err().to_string().contains("on a line"));
        assert!(RigidFit::new(&[], &[]).is_err());
        assert!(RigidFit::new(&points(), &line).unwrap_err().to_string().contains("20 of them"));
        let mut lost = points();
        lost[3].x = f64::NAN;
        assert!(RigidFit::new(&points(), &lost).is_err());
    }
}
