//! Smooth star-shaped solids: fruit, potatoes, blobs.

use nalgebra::{Matrix3, Unit, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    Surface,
    cached::Cached,
    length::{length, lengths},
};
use crate::{Error, Result};

/// An ellipsoid modulated by plane waves and bumps over the unit sphere:
/// r(d) = r₀(d) (1 + Σᵢ aᵢ cos(kᵢ·d + φᵢ) + Σⱼ bⱼ exp(κⱼ (cⱼ·d − 1))), |d| = 1, r₀ the ellipsoid's
/// radius along d.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StarShaped {
    semi_axes: Vector3<f64>,
    waves: Vec<Wave>,
    bumps: Vec<Bump>,
    #[serde(skip)]
    pub(super) facets: Cached<Surface>,
}

/// One modulation of a [`StarShaped`] solid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Wave {
    /// Relative amplitude a.
    pub amplitude: f64,
    /// Wave vector k (rad), over the unit sphere.
    pub vector: Vector3<f64>,
    /// Phase φ (rad).
    pub phase: f64,
}

/// A bump or a dimple of a [`StarShaped`] solid, with the profile of a von Mises–Fisher
/// distribution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bump {
    /// Relative height b, negative for a dimple.
    pub amplitude: f64,
    /// Direction c of its top.
    pub axis: Unit<Vector3<f64>>,
    /// Concentration κ: the bump is about 1/√κ (rad) wide.
    pub concentration: f64,
}

/// Largest concentration of a bump that facets of 80 to the circle still resolve.
const SHARPEST: f64 = 60.0;

/// Value of a function over the unit sphere, with its gradient and Hessian over unconstrained
/// vectors.
#[derive(Default)]
pub(super) struct Modulation {
    pub(super) value: f64,
    pub(super) gradient: Vector3<f64>,
    pub(super) hessian: Matrix3<f64>,
}

impl Modulation {
    /// Adds a function of `vector`·d, given by its value and its first and second derivatives.
    fn add(&mut self, vector: &Vector3<f64>, [value, first, second]: [f64; 3]) {
        self.value += value;
        self.gradient += first * vector;
        self.hessian += second * vector * vector.transpose();
    }
}

impl Wave {
    fn value(&self, direction: &Vector3<f64>) -> f64 {
        self.amplitude * (self.vector.dot(direction) + self.phase).cos()
    }
}

impl Bump {
    fn value(&self, direction: &Vector3<f64>) -> f64 {
        self.amplitude * (self.concentration * (self.axis.dot(direction) - 1.0)).exp()
    }
}

impl StarShaped {
    /// Returns an ellipsoid of these semi-axes (m) with waves whose amplitudes add up to less than
    /// 0.5.
    pub fn new(semi_axes: Vector3<f64>, waves: Vec<Wave>) -> Self {
        Self { semi_axes, waves, bumps: Vec::new(), facets: Cached::default() }
    }

    /// Returns the same solid with its bumps replaced by these. Their amplitudes count towards the
    /// sum together with the waves'.
    #[must_use]
    pub fn with_bumps(self, bumps: Vec<Bump>) -> Self {
        Self { bumps, facets: Cached::default(), ..self }
    }

    /// Semi-axes of the unmodulated ellipsoid (m).
    pub fn semi_axes(&self) -> &Vector3<f64> {
        &self.semi_axes
    }

    /// Distance from the origin to the surface along the unit vector `direction` (m).
    pub fn radius(&self, direction: &Vector3<f64>) -> f64 {
        let ellipsoid = 1.0 / direction.component_div(&self.semi_axes).norm();
        ellipsoid * (1.0 + self.relative_height(direction))
    }

    /// Relative increase of the radius by waves and bumps along the unit vector `direction`.
    pub(super) fn relative_height(&self, direction: &Vector3<f64>) -> f64 {
        self.waves.iter().map(|wave| wave.value(direction)).sum::<f64>()
            + self.bumps.iter().map(|bump| bump.value(direction)).sum::<f64>()
    }

    /// [`Self::relative_height`] with its derivatives.
    pub(super) fn modulation(&self, direction: &Vector3<f64>) -> Modulation {
        let mut sum = Modulation::default();
        for Wave { amplitude, vector, phase } in &self.waves {
            let (sin, cos) = (vector.dot(direction) + phase).sin_cos();
            sum.add(vector, [cos, -sin, -cos].map(|x| amplitude * x));
        }
        for bump in &self.bumps {
            let (value, k) = (bump.value(direction), bump.concentration);
            sum.add(&bump.axis, [value, k * value, k * k * value]);
        }
        sum
    }

    /// The same solid, `factor` times as large.
    pub(super) fn scaled(&self, factor: f64) -> Self {
        Self::new(self.semi_axes * factor, self.waves.clone()).with_bumps(self.bumps.clone())
    }

    pub(super) fn validate(&self) -> Result<()> {
        lengths("semi_axes", &self.semi_axes)?;
        let waves = self.waves.iter().map(|w| w.amplitude.abs()).sum::<f64>();
        let sum = waves + self.bumps.iter().map(|b| b.amplitude.abs()).sum::<f64>();
        let finite =
            self.waves.iter().all(|w| w.vector.iter().chain([&w.phase]).all(|x| x.is_finite()));
        if !(sum < 0.5 && finite) {
            let expected = "finite waves and bumps whose amplitudes add up to less than 0.5";
            return Err(Error::invalid("waves", format!("amplitudes of {sum}"), expected));
        }
        for Bump { concentration, axis, .. } in &self.bumps {
            if !(*concentration > 0.0 && *concentration <= SHARPEST) {
                let expected = format!("above 0, at most {SHARPEST}");
                return Err(Error::invalid("concentration", concentration, expected));
            }
            // A `Unit` may come from a vector without direction.
            if !(1.0 - 1e-9..=1.0 + 1e-9).contains(&axis.norm()) {
                return Err(Error::invalid("axis", format!("{:?}", **axis), "a unit vector"));
            }
        }
        Ok(())
    }
}

/// A star-shaped solid with a concentric cavity of the same form, such as a hollow fruit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hollow {
    solid: StarShaped,
    cavity: f64,
}

impl Hollow {
    /// Returns `solid` minus a copy of it scaled by `cavity`, which is between 0 and 1, both
    /// excluded.
    pub fn new(solid: StarShaped, cavity: f64) -> Self {
        Self { solid, cavity }
    }

    /// The solid as it would be without the cavity.
    pub fn solid(&self) -> &StarShaped {
        &self.solid
    }

    /// Size of the cavity relative to the solid.
    pub fn cavity(&self) -> f64 {
        self.cavity
    }

    /// The same solid, `factor` times as large.
    pub(super) fn scaled(&self, factor: f64) -> Self {
        Self::new(self.solid.scaled(factor), self.cavity)
    }

    pub(super) fn validate(&self) -> Result<()> {
        self.solid.validate()?;
        if !(self.cavity > 0.0 && self.cavity < 1.0) {
            return Err(Error::invalid("cavity", self.cavity, "above 0 and below 1"));
        }
        length("wall", (1.0 - self.cavity) * self.solid.semi_axes.min())
    }
}
