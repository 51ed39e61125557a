//! Rigid motions: the best fit to a displacement, and one as output of a network.
//!
//! The best fit is that of least squares (Arun, Huang and Blostein 1987). A network outputs
//! rotations by six numbers, two columns made orthonormal by Gram and Schmidt (Zhou et al. 2019),
//! which, unlike angles or quaternions, are a continuous representation.

use candle_core::{Device, Result, Tensor};
use nalgebra::{Matrix3, Vector3};

/// Numbers of a motion: its rotation row by row and its translation.
pub(super) const MOTION: usize = 12;
/// No motion.
pub(super) const STILL: [f32; MOTION] =
    [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];

/// Rotation R and translation t that bring `places` nearest to where `displacement` moves them:
/// p ↦ R p + t.
pub(super) fn best_fit(
    places: &[Vector3<f64>],
    displacement: &[Vector3<f64>],
) -> (Matrix3<f64>, Vector3<f64>) {
    let mean =
        |vectors: &[Vector3<f64>]| vectors.iter().sum::<Vector3<f64>>() / places.len() as f64;
    let (centre, drift) = (mean(places), mean(displacement));
    let pairs = places.iter().zip(displacement);
    let product: Matrix3<f64> =
        pairs.map(|(p, u)| (p + u - centre - drift) * (p - centre).transpose()).sum();
    let svd = product.svd(true, true);
    let (u, v_t) = (svd.u.expect("asked for"), svd.v_t.expect("asked for"));
    let sign = (u * v_t).determinant().signum();
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
    (rotation, centre + drift - rotation * centre)
}

/// The numbers (12) of a motion.
pub(super) fn numbers(rotation: &Matrix3<f64>, translation: &Vector3<f64>) -> [f32; MOTION] {
    let mut all = [0.0; MOTION];
    let rows = rotation.transpose();
    for (number, x) in all.iter_mut().zip(rows.iter().chain(translation.iter())) {
        *number = *x as f32;
    }
    all
}

/// Angle (rad) between two motions, and distance of their translations.
pub(super) fn apart(a: &[f32], b: &[f32]) -> [f64; 2] {
    let rotation = |m: &[f32]| Matrix3::from_row_slice(&m[..9]).cast::<f64>();
    let turn = rotation(a).transpose() * rotation(b);
    // From sine and cosine, as the cosine alone does not resolve small angles.
    let sines = Vector3::new(turn.m32 - turn.m23, turn.m13 - turn.m31, turn.m21 - turn.m12);
    let angle = sines.norm().atan2(turn.trace() - 1.0);
    let translation = |m: &[f32]| Vector3::from_column_slice(&m[9..12]).cast::<f64>();
    [angle, (translation(a) - translation(b)).norm()]
}

/// Motion (12) encoded by nine numbers: two columns less those of the identity, and a translation.
pub(super) fn motion(output: &Tensor) -> Result<Tensor> {
    let identity = Tensor::new(&[1.0_f32, 0.0, 0.0, 0.0, 1.0, 0.0], &Device::Cpu)?;
    let columns = (output.narrow(0, 0, 6)? + identity)?;
    let first = unit(&columns.narrow(0, 0, 3)?)?;
    let second = columns.narrow(0, 3, 3)?;
    let along = (&first * &second)?.sum_keepdim(0)?;
    let second = unit(&(&second - first.broadcast_mul(&along)?)?)?;
    let third = cross(&first, &second)?;
    let rows = Tensor::stack(&[first, second, third], 1)?.flatten_all()?;
    Tensor::cat(&[rows, output.narrow(0, 6, 3)?], 0)
}

fn unit(x: &Tensor) -> Result<Tensor> {
    x.broadcast_div(&x.sqr()?.sum_keepdim(0)?.sqrt()?)
}

fn cross(a: &Tensor, b: &Tensor) -> Result<Tensor> {
    let [x, y, z] = [0, 1, 2].map(|i| [a, b].map(|v| v.narrow(0, i, 1)));
    let ([a1, b1], [a2, b2], [a3, b3]) = (x, y, z);
    let (a1, a2, a3, b1, b2, b3) = (a1?, a2?, a3?, b1?, b2?, b3?);
    let part = |p: &Tensor, q: &Tensor, r: &Tensor, s: &Tensor| (p * q)? - (r * s)?;
    Tensor::cat(
        &[part(&a2, &b3, &a3, &b2)?, part(&a3, &b1, &a1, &b3)?, part(&a1, &b2, &a2, &b1)?],
        0,
    )
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    fn motion_of(output: [f32; 9]) -> Vec<f32> {
        motion(&Tensor::new(&output, &Device::Cpu).unwrap()).unwrap().to_vec1().unwrap()
    }

    #[test]
    fn six_numbers_are_a_rotation_and_none_the_identity() {
        assert_eq!(motion_of([0.0; 9])[..9], [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        let found = motion_of([0.3, -1.2, 0.4, 0.9, 0.1, -0.7, 1.0, 2.0, 3.0]);
        let rotation = Matrix3::from_row_slice(&found[..9]);
        let error = (rotation * rotation.transpose() - Matrix3::identity()).norm();
        assert!(error < 1e-6 && (rotation.determinant() - 1.0).abs() < 1e-6, "{rotation}");
        assert_eq!(found[9..], [1.0, 2.0, 3.0]);
    }

    #[test]
    fn the_best_fit_to_a_rigid_motion_is_that_motion() {
        let turn = Rotation3::new(Vector3::new(0.1, -0.4, 0.2));
        let shift = Vector3::new(0.3, 0.1, -0.5);
        let places = [[0.0, 0.0, 0.1], [1.0, 0.0, 0.3], [0.0, 1.2, 0.0], [0.3, 0.4, -0.9]]
            .map(Vector3::from);
        let moved = places.map(|p| turn * p + shift - p);
        let (rotation, translation) = best_fit(&places, &moved);
        assert!((rotation - turn.matrix()).norm() < 1e-12 && (translation - shift).norm() < 1e-12);
        let numbers = numbers(&rotation, &translation);
        let [angle, _] = apart(&numbers, &motion_of([0.0; 9]));
        assert!((angle - turn.angle()).abs() < 1e-6, "{angle} for {}", turn.angle());
        let little = Rotation3::new(Vector3::new(1e-5, 0.0, 0.0));
        let [angle, _] = apart(&STILL, &super::numbers(little.matrix(), &shift));
        assert!((angle - 1e-5).abs() < 1e-7, "{angle} rad for 1e-5");
    }
}
