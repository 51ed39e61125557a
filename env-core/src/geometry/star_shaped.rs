//! Smooth star-shaped solids: fruit, potatoes, blobs.

use nalgebra::Vector3;

use super::{Surface, cached::Cached, shape::lengths};
use crate::{Error, Result};

/// An ellipsoid modulated by plane waves over the unit sphere:
/// r(d) = r₀(d) (1 + Σᵢ aᵢ cos(kᵢ·d + φᵢ)), |d| = 1, r₀ the ellipsoid's radius along d.
#[derive(Clone, Debug, PartialEq)]
pub struct StarShaped {
    semi_axes: Vector3<f64>,
    waves: Vec<Wave>,
    pub(super) facets: Cached<Surface>,
}

/// One modulation of a [`StarShaped`] solid.
#[derive(Clone, Debug, PartialEq)]
pub struct Wave {
    /// Relative amplitude a.
    pub amplitude: f64,
    /// Wave vector k (rad), over the unit sphere.
    pub vector: Vector3<f64>,
    /// Phase φ (rad).
    pub phase: f64,
}

impl Wave {
    /// What the wave adds to the relative radius along the unit vector `direction`.
    pub(super) fn value(&self, direction: &Vector3<f64>) -> f64 {
        self.amplitude * (self.vector.dot(direction) + self.phase).cos()
    }
}

impl StarShaped {
    /// The solid of an ellipsoid's semi-axes (m) and waves whose amplitudes add up to less than 0.5.
    pub fn new(semi_axes: Vector3<f64>, waves: Vec<Wave>) -> Self {
        Self { semi_axes, waves, facets: Cached::default() }
    }

    /// Semi-axes of the unmodulated ellipsoid (m).
    pub fn semi_axes(&self) -> &Vector3<f64> {
        &self.semi_axes
    }

    /// The modulations.
    pub fn waves(&self) -> &[Wave] {
        &self.waves
    }

    /// Distance from the origin to the surface along the unit vector `direction` (m).
    pub fn radius(&self, direction: &Vector3<f64>) -> f64 {
        let ellipsoid = 1.0 / direction.component_div(&self.semi_axes).norm();
        ellipsoid * (1.0 + self.waves.iter().map(|w| w.value(direction)).sum::<f64>())
    }

    /// The same solid, `factor` times as large.
    pub(super) fn scaled(&self, factor: f64) -> Self {
        Self::new(self.semi_axes * factor, self.waves.clone())
    }

    pub(super) fn validate(&self) -> Result<()> {
        lengths("semi_axes", &self.semi_axes)?;
        let sum: f64 = self.waves.iter().map(|w| w.amplitude.abs()).sum();
        let finite =
            self.waves.iter().all(|w| w.vector.iter().chain([&w.phase]).all(|x| x.is_finite()));
        if !(sum < 0.5 && finite) {
            let expected = "finite waves whose amplitudes add up to less than 0.5";
            return Err(Error::invalid("waves", format!("amplitudes of {sum}"), expected));
        }
        Ok(())
    }
}
