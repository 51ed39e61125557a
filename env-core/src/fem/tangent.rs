//! Tangents of the hyperelastic laws: derivatives of the stress with respect to the strain at one
//! point.
//!
//! ∂P/∂F = ∂²w/∂F² + p ∂²θ/∂F² + U″ ∂θ/∂F ⊗ ∂θ/∂F, in the terms of [`super::material`]. The last
//! part is left to the elements, which may average θ.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::material::{Material, cofactor, rotation};
use crate::deformation::Law;

/// ∂P/∂F as a matrix over the entries of F, column by column.
type Tangent9 = SMatrix<f64, 9, 9>;

/// ∂²w/∂F² + p ∂²θ/∂F² at one point.
#[derive(Clone, Debug)]
pub(super) enum Tangent {
    /// μ 1 + a C⊗C − b C⊗ᵗC, with C = cof F and (C⊗ᵗC)ᵢₖⱼₗ = Cᵢₗ Cⱼₖ.
    Cofactor { mu: f64, a: f64, b: f64, cofactor: Matrix3<f64> },
    /// Any other tangent.
    Full(Box<Tangent9>),
}

impl Material {
    /// ∂²w/∂F² + `pressure` ∂²θ/∂F² (Pa).
    pub(super) fn tangent(&self, f: &Matrix3<f64>, pressure: f64) -> Tangent {
        let (mu, j) = (self.mu, f.determinant());
        // For w = μ/2 I₁ + h(J): a = h″ + (h′ + p)/J and b = (h′ + p)/J.
        match self.law {
            Law::NeoHookean => {
                let b = (pressure - mu / j) / j;
                Tangent::Cofactor { mu, a: mu / (j * j) + b, b, cofactor: cofactor(f) }
            }
            Law::StableNeoHookean => {
                let b = (pressure + mu * (j - 2.0)) / j;
                Tangent::Cofactor { mu, a: mu + b, b, cofactor: cofactor(f) }
            }
            Law::Corotated => Tangent::Full(Box::new(corotated_tangent(f, mu, pressure))),
            _ => Tangent::Full(Box::new(linear_tangent(mu))),
        }
    }
}

impl Tangent {
    /// Second derivative of the energy density with respect to the displacements of two nodes whose
    /// shape functions have the gradients `g` and `h` (Pa/m²).
    pub(super) fn block(&self, g: &Vector3<f64>, h: &Vector3<f64>) -> Matrix3<f64> {
        match self {
            Self::Cofactor { mu, a, b, cofactor } => {
                let (c, d) = (cofactor * g, cofactor * h);
                Matrix3::from_diagonal_element(mu * g.dot(h)) + *a * c * d.transpose()
                    - *b * d * c.transpose()
            }
            Self::Full(tangent) => {
                let mut block = Matrix3::zeros();
                for k in 0..3 {
                    for l in 0..3 {
                        block += g[k] * h[l] * tangent.fixed_view::<3, 3>(3 * k, 3 * l);
                    }
                }
                block
            }
        }
    }

    /// Returns the tangent as a matrix over the entries of F.
    pub(super) fn full(&self) -> Tangent9 {
        match self {
            Self::Cofactor { .. } => {
                let mut full = Tangent9::zeros();
                for k in 0..3 {
                    for l in 0..3 {
                        let block = self.block(&axis(k), &axis(l));
                        full.fixed_view_mut::<3, 3>(3 * k, 3 * l).copy_from(&block);
                    }
                }
                full
            }
            Self::Full(tangent) => **tangent,
        }
    }

    /// Returns the tangent with its eigenvalues replaced by their absolute values, so that it is
    /// positive along every direction (Chen et al. 2024, arXiv 2406.05928).
    pub(super) fn filtered(&self) -> Self {
        let full = self.full();
        let eigen = (0.5 * (full + full.transpose())).symmetric_eigen();
        let scaled = eigen.eigenvectors * SMatrix::from_diagonal(&eigen.eigenvalues.abs());
        Self::Full(Box::new(scaled * eigen.eigenvectors.transpose()))
    }
}

fn axis(i: usize) -> Vector3<f64> {
    Vector3::ith(i, 1.0)
}

/// 2μ (1 − ∂R/∂F) + p ∂cof F/∂F, from R ᵀδR = [(tr S · 1 − S)⁻¹ axial(RᵀδF)]ₓ.
fn corotated_tangent(f: &Matrix3<f64>, mu: f64, pressure: f64) -> Tangent9 {
    let r = rotation(f);
    let s = r.transpose() * f;
    let spin = (Matrix3::identity() * s.trace() - s).try_inverse().unwrap_or_else(Matrix3::zeros);
    let mut tangent = Tangent9::zeros();
    for l in 0..3 {
        for j in 0..3 {
            let df = axis(j) * axis(l).transpose();
            let turned = r.transpose() * df;
            let skew = turned - turned.transpose();
            let omega = spin * Vector3::new(skew[(2, 1)], skew[(0, 2)], skew[(1, 0)]);
            let dr = r * omega.cross_matrix();
            let dp = 2.0 * mu * (df - dr) + pressure * cofactor_derivative(f, &df);
            tangent.column_mut(3 * l + j).copy_from_slice(dp.as_slice());
        }
    }
    tangent
}

/// Change of cof F as F changes by `df`.
fn cofactor_derivative(f: &Matrix3<f64>, df: &Matrix3<f64>) -> Matrix3<f64> {
    // cof is quadratic in F, so a symmetric difference is exact.
    0.5 * (cofactor(&(f + df)) - cofactor(&(f - df)))
}

fn linear_tangent(mu: f64) -> Tangent9 {
    let mut tangent = Tangent9::zeros();
    for l in 0..3 {
        for j in 0..3 {
            let df = axis(j) * axis(l).transpose();
            let dp = mu * (df + df.transpose());
            tangent.column_mut(3 * l + j).copy_from_slice(dp.as_slice());
        }
    }
    tangent
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::material::tests::{GEL, laws, state, stress};

    #[test]
    fn tangent_is_the_gradient_of_the_stress() {
        let step = 1e-6;
        for (law, material) in laws() {
            let f = state();
            let volumetric = material.volumetric(material.dilatation(&f));
            let gradient = material.dilatation_gradient(&f);
            let mut exact = material.tangent(&f, volumetric.pressure).full();
            let g = SMatrix::<f64, 9, 1>::from_column_slice(gradient.as_slice());
            exact += volumetric.stiffness * g * g.transpose();
            for i in 0..9 {
                let stress_at = |d: f64| {
                    let mut f = state();
                    f[i] += d;
                    stress(&material, &f)
                };
                let difference = (stress_at(step) - stress_at(-step)) / (2.0 * step);
                let column = SMatrix::<f64, 9, 1>::from_column_slice(difference.as_slice());
                let error = (column - exact.column(i)).norm() / exact.norm();
                assert!(error < 1e-8, "{law} column {i}: relative error {error:.1e}");
            }
        }
    }

    #[test]
    fn a_filtered_tangent_is_positive_and_keeps_a_positive_one() {
        for (law, material) in laws() {
            let squeezed = Matrix3::from_diagonal(&[0.4, 1.3, 1.3].into());
            let filtered = material.tangent(&squeezed, -GEL.lambda()).filtered().full();
            let least = filtered.symmetric_eigenvalues().min();
            // Rounding of the eigenvalues, relative to the largest.
            assert!(least > -1e-12 * filtered.norm(), "{law}: {least} Pa");
            let rest = material.tangent(&Matrix3::identity(), 0.0);
            let change = (rest.filtered().full() - rest.full()).norm() / rest.full().norm();
            assert!(change < 1e-12, "{law}: changed by {change:.1e}");
        }
    }
}
