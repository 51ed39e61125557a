//! Hyperelastic materials: energy density, stress and tangent at one point.
//!
//! Every law is split into a distortion and a dilatation part,
//! ψ(F) = w(F) + U(θ(F)), θ = det F (for the linear law θ = tr F − 2), so that an element may hand
//! U the dilatation averaged over its neighbourhood. U is what grows with λ; the rest stays in w,
//! which is convex at rest and keeps each element from inverting. With the pressure-like p = U′ the stress is
//! P = ∂w/∂F + p ∂θ/∂F. The laws and their sources are listed at [`Law`].
//!
//! All but the linear law are used for J = det F > 0 only.

use nalgebra::{Matrix3, SMatrix, Vector3};

use crate::deformation::{Law, Moduli};

/// ∂P/∂F as a matrix over the entries of F, column by column.
pub(super) type Tangent9 = SMatrix<f64, 9, 9>;

/// An isotropic elastic material.
#[derive(Clone, Copy, Debug)]
pub(super) struct Material {
    law: Law,
    mu: f64,
    lambda: f64,
}

/// U and its first two derivatives at one dilatation.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Volumetric {
    /// Energy density (Pa).
    pub(super) energy: f64,
    /// p = U′ (Pa).
    pub(super) pressure: f64,
    /// U″ (Pa).
    pub(super) stiffness: f64,
}

/// ∂²w/∂F² + p ∂²θ/∂F² at one point.
#[derive(Clone, Debug)]
pub(super) enum Tangent {
    /// μ 1 + a C⊗C − b C⊗ᵗC, with C = cof F and (C⊗ᵗC)ᵢₖⱼₗ = Cᵢₗ Cⱼₖ.
    Cofactor { mu: f64, a: f64, b: f64, cofactor: Matrix3<f64> },
    /// Any other.
    Full(Box<Tangent9>),
}

impl Material {
    pub(super) fn new(law: Law, moduli: &Moduli) -> Self {
        Self { law, mu: moduli.shear(), lambda: moduli.lambda() }
    }

    /// Dilatation θ.
    pub(super) fn dilatation(&self, f: &Matrix3<f64>) -> f64 {
        if self.law == Law::Linear { f.trace() - 2.0 } else { f.determinant() }
    }

    /// ∂θ/∂F.
    pub(super) fn dilatation_gradient(&self, f: &Matrix3<f64>) -> Matrix3<f64> {
        if self.law == Law::Linear { Matrix3::identity() } else { cofactor(f) }
    }

    /// Whether `f` is a deformation that the law describes.
    pub(super) fn admits(&self, f: &Matrix3<f64>) -> bool {
        self.law == Law::Linear || f.determinant() > 0.0
    }

    /// U at the dilatation `theta` (above 0 for the neo-Hookean law).
    pub(super) fn volumetric(&self, theta: f64) -> Volumetric {
        let (strain, lambda) = (theta - 1.0, self.lambda);
        match self.law {
            Law::NeoHookean => {
                let log = theta.ln();
                Volumetric {
                    energy: 0.5 * lambda * log * log,
                    pressure: lambda * log / theta,
                    stiffness: lambda * (1.0 - log) / (theta * theta),
                }
            }
            _ => quadratic(lambda, strain),
        }
    }

    /// w (Pa).
    pub(super) fn distortion(&self, f: &Matrix3<f64>) -> f64 {
        match self.law {
            Law::NeoHookean => self.mu * (0.5 * (f.norm_squared() - 3.0) - f.determinant().ln()),
            Law::StableNeoHookean => {
                let strain = f.determinant() - 1.0;
                0.5 * self.mu * (f.norm_squared() - 3.0 - 2.0 * strain + strain * strain)
            }
            Law::Corotated => self.mu * (f - rotation(f)).norm_squared(),
            _ => self.mu * strain(f).norm_squared(),
        }
    }

    /// ∂w/∂F (Pa).
    pub(super) fn distortion_stress(&self, f: &Matrix3<f64>) -> Matrix3<f64> {
        match self.law {
            Law::NeoHookean => self.mu * (f - cofactor(f) / f.determinant()),
            Law::StableNeoHookean => self.mu * (f + (f.determinant() - 2.0) * cofactor(f)),
            Law::Corotated => 2.0 * self.mu * (f - rotation(f)),
            _ => 2.0 * self.mu * strain(f),
        }
    }

    /// First Piola–Kirchhoff stress P where the pressure is `pressure` (Pa).
    pub(super) fn stress(&self, f: &Matrix3<f64>, pressure: f64) -> Matrix3<f64> {
        self.distortion_stress(f) + pressure * self.dilatation_gradient(f)
    }

    /// Von Mises equivalent of the Cauchy stress P Fᵀ / J (Pa).
    pub(super) fn von_mises(&self, f: &Matrix3<f64>) -> f64 {
        // Parts of the Cauchy stress along the identity are hydrostatic and drop out: the pressure's,
        // and what cof F = J F⁻ᵀ makes.
        let (cauchy, scale) = match self.law {
            // Scaled last: at rest the deviator of 1 is nothing, that of μ 1 only to rounding.
            Law::NeoHookean | Law::StableNeoHookean => {
                (f * f.transpose(), self.mu / f.determinant())
            }
            Law::Corotated => (self.distortion_stress(f) * f.transpose(), 1.0 / f.determinant()),
            Law::Linear => (self.distortion_stress(f), 1.0),
        };
        let deviator = cauchy - Matrix3::identity() * (cauchy.trace() / 3.0);
        (1.5 * deviator.norm_squared()).sqrt() * scale
    }

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
    /// Second derivative of the energy density by the displacements of two nodes whose shape
    /// functions have the gradients `g` and `h` (Pa/m²).
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

    /// As a matrix over the entries of F.
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

    /// The nearest form that is positive along every direction: eigenvalues by absolute value
    /// (Chen et al. 2024, arXiv 2406.05928).
    pub(super) fn filtered(&self) -> Self {
        let full = self.full();
        let eigen = (0.5 * (full + full.transpose())).symmetric_eigen();
        let scaled = eigen.eigenvectors * SMatrix::from_diagonal(&eigen.eigenvalues.abs());
        Self::Full(Box::new(scaled * eigen.eigenvectors.transpose()))
    }
}

/// cof F = J F⁻ᵀ.
fn cofactor(f: &Matrix3<f64>) -> Matrix3<f64> {
    let (a, b, c) = (f.column(0), f.column(1), f.column(2));
    Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)])
}

fn axis(i: usize) -> Vector3<f64> {
    Vector3::ith(i, 1.0)
}

fn quadratic(modulus: f64, strain: f64) -> Volumetric {
    Volumetric {
        energy: 0.5 * modulus * strain * strain,
        pressure: modulus * strain,
        stiffness: modulus,
    }
}

/// Small strain sym(F − 1).
fn strain(f: &Matrix3<f64>) -> Matrix3<f64> {
    0.5 * (f + f.transpose()) - Matrix3::identity()
}

/// The rotation nearest to F.
fn rotation(f: &Matrix3<f64>) -> Matrix3<f64> {
    let svd = f.svd_unordered(true, true);
    let u = svd.u.expect("asked for");
    let v_t = svd.v_t.expect("asked for");
    u * v_t
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

    const GEL: Moduli = Moduli { young: 2e5, poisson: 0.47 };

    fn laws() -> impl Iterator<Item = (Law, Material)> {
        Law::NAMES.into_iter().map(|(_, law)| (law, Material::new(law, &GEL)))
    }

    /// A sheared, stretched and turned state.
    fn state() -> Matrix3<f64> {
        Matrix3::new(0.8, 0.3, -0.1, -0.2, 1.1, 0.25, 0.15, -0.3, 1.2)
    }

    fn energy(material: &Material, f: &Matrix3<f64>) -> f64 {
        material.distortion(f) + material.volumetric(material.dilatation(f)).energy
    }

    fn stress(material: &Material, f: &Matrix3<f64>) -> Matrix3<f64> {
        material.stress(f, material.volumetric(material.dilatation(f)).pressure)
    }

    #[test]
    fn stress_is_the_gradient_of_the_energy() {
        let step = 1e-6;
        for (law, material) in laws() {
            let exact = stress(&material, &state());
            for i in 0..9 {
                let energy_at = |d: f64| {
                    let mut f = state();
                    f[i] += d;
                    energy(&material, &f)
                };
                let difference = (energy_at(step) - energy_at(-step)) / (2.0 * step);
                // Truncation step² and rounding 1e-16/step, both relative, leave 1e-9.
                let error = (difference - exact[i]).abs() / exact.norm();
                assert!(error < 1e-8, "{law} {i}: {difference} Pa against {} Pa", exact[i]);
            }
        }
    }

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
    fn every_law_has_the_moduli_of_small_strain() {
        let strain = 1e-7;
        let f = Matrix3::from_diagonal(&[1.0 + strain, 1.0, 1.0].into());
        for (law, material) in laws() {
            let stress = stress(&material, &f) / strain;
            let exact = [GEL.lambda() + 2.0 * GEL.shear(), GEL.lambda()];
            for (found, exact) in [stress[(0, 0)], stress[(1, 1)]].into_iter().zip(exact) {
                // Second-order terms are 1e-7 times a few, rounding 1e-16/1e-7.
                assert!((found / exact - 1.0).abs() < 1e-6, "{law}: {found} Pa, exact {exact} Pa");
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

    #[test]
    fn a_body_at_rest_has_no_stress_at_all() {
        for (law, _) in laws() {
            for young in [1e3, 3.7e5, 1.3287e7, 9.9e8] {
                let material = Material::new(law, &Moduli { young, poisson: 0.474_178_7 });
                let stress = material.von_mises(&Matrix3::identity());
                assert!(stress == 0.0, "{law}, {young} Pa: {stress} Pa");
            }
        }
    }

    #[test]
    fn rotation_causes_no_stress_in_the_laws_of_large_strain() {
        let turn = nalgebra::Rotation3::new(Vector3::new(0.3, -1.2, 0.7)).into_inner();
        for (law, material) in laws().filter(|&(law, _)| law != Law::Linear) {
            let stress = stress(&material, &turn).norm() / GEL.lambda();
            assert!(stress < 1e-14, "{law}: {stress:.1e} of λ");
        }
    }
}
