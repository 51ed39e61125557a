//! Hyperelastic materials: energy density and stress at one point. Their tangents are in
//! [`super::tangent`].
//!
//! Every law is split into a distortion and a dilatation part, ψ(F) = w(F) + U(θ(F)), θ = det F
//! (for the linear law θ = tr F − 2), so that an element may evaluate U at the dilatation averaged
//! over its neighbourhood. U holds the terms that grow with λ; the others stay in w, which is
//! convex at rest and keeps each element from inverting. With the pressure-like p = U′ the stress
//! is P = ∂w/∂F + p ∂θ/∂F. The laws and their sources are listed at [`Law`].
//!
//! All laws but the linear one are used for J = det F > 0 only.

use nalgebra::Matrix3;

use crate::deformation::{Law, Moduli};

/// An isotropic elastic material.
#[derive(Clone, Copy, Debug)]
pub(super) struct Material {
    pub(super) law: Law,
    pub(super) mu: f64,
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

impl Material {
    pub(super) fn new(law: Law, moduli: &Moduli) -> Self {
        Self { law, mu: moduli.shear(), lambda: moduli.lambda() }
    }

    /// Dilatation θ.
    pub(super) fn dilatation(&self, f: &Matrix3<f64>) -> f64 {
        if self.law == Law::Linear { f.trace() - 2.0 } else { f.determinant() }
    }

    /// Gradient of the dilatation, ∂θ/∂F.
    pub(super) fn dilatation_gradient(&self, f: &Matrix3<f64>) -> Matrix3<f64> {
        if self.law == Law::Linear { Matrix3::identity() } else { cofactor(f) }
    }

    /// Returns whether `f` is a deformation gradient that the law describes.
    pub(super) fn admits(&self, f: &Matrix3<f64>) -> bool {
        self.law == Law::Linear || f.determinant() > 0.0
    }

    /// Energy U and its derivatives at the dilatation `theta` (above 0 for the neo-Hookean law).
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

    /// Energy density w of distortion (Pa).
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

    /// Stress of distortion, ∂w/∂F (Pa).
    fn distortion_stress(&self, f: &Matrix3<f64>) -> Matrix3<f64> {
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

    /// Cauchy stress P Fᵀ / J where the pressure is `pressure`; for small strains P (Pa).
    pub(super) fn cauchy(&self, f: &Matrix3<f64>, pressure: f64) -> Matrix3<f64> {
        let stress = self.stress(f, pressure);
        match self.law {
            Law::Linear => stress,
            _ => stress * f.transpose() / f.determinant(),
        }
    }

    /// Von Mises equivalent of the Cauchy stress P Fᵀ / |J| (Pa).
    pub(super) fn von_mises(&self, f: &Matrix3<f64>) -> f64 {
        // Parts of the Cauchy stress along the identity are hydrostatic and drop out: those from
        // the pressure and from cof F = J F⁻ᵀ.
        // A quadratic element whose integration points all have J > 0 may have others that do not.
        let volume = f.determinant().abs();
        let (cauchy, scale) = match self.law {
            // Scaled last: at rest the deviator of the identity is exactly zero, that of μ times
            // the identity only to rounding.
            Law::NeoHookean | Law::StableNeoHookean => (f * f.transpose(), self.mu / volume),
            Law::Corotated => (self.distortion_stress(f) * f.transpose(), 1.0 / volume),
            Law::Linear => (self.distortion_stress(f), 1.0),
        };
        let deviator = cauchy - Matrix3::identity() * (cauchy.trace() / 3.0);
        (1.5 * deviator.norm_squared()).sqrt() * scale
    }
}

/// cof F = J F⁻ᵀ.
pub(super) fn cofactor(f: &Matrix3<f64>) -> Matrix3<f64> {
    let (a, b, c) = (f.column(0), f.column(1), f.column(2));
    Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)])
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

/// Rotation nearest to F.
pub(super) fn rotation(f: &Matrix3<f64>) -> Matrix3<f64> {
    let svd = f.svd_unordered(true, true);
    let u = svd.u.expect("asked for");
    let v_t = svd.v_t.expect("asked for");
    u * v_t
}

#[cfg(test)]
pub(super) mod tests {
    use nalgebra::Vector3;

    use super::*;

    pub(in super::super) const GEL: Moduli = Moduli { young: 2e5, poisson: 0.47 };

    pub(in super::super) fn laws() -> impl Iterator<Item = (Law, Material)> {
        Law::NAMES.into_iter().map(|(_, law)| (law, Material::new(law, &GEL)))
    }

    /// A sheared, stretched and turned state.
    pub(in super::super) fn state() -> Matrix3<f64> {
        Matrix3::new(0.8, 0.3, -0.1, -0.2, 1.1, 0.25, 0.15, -0.3, 1.2)
    }

    fn energy(material: &Material, f: &Matrix3<f64>) -> f64 {
        material.distortion(f) + material.volumetric(material.dilatation(f)).energy
    }

    pub(in super::super) fn stress(material: &Material, f: &Matrix3<f64>) -> Matrix3<f64> {
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
    fn no_inverted_state_has_a_negative_equivalent_stress() {
        let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
        for (law, material) in laws() {
            let [upright, inverted] = [state(), state() * mirror].map(|f| material.von_mises(&f));
            assert!(upright > 0.0 && inverted > 0.0, "{law:?}: {inverted} Pa");
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
