//! What a bristle answers: the force law of a gel on rigid ground, lumped into a bed.
//!
//! The bed stores U = E h³ k Σ^q with Σ = ∫ δ² dA / h⁴, δ the depth at which the undeformed face
//! stands in the object, h the gel's thickness. The pressure is −∂U/∂δ: 2 q k E Σ^(q−1) δ/h. With
//! q = 1 this is Winkler's foundation; q < 1 lets a large touch be softer than its parts, as a
//! half-space is, q > 1 stiffer, as a thin incompressible layer is. For a sphere of radius R the
//! force goes as R^q δ^(3q−1). Sideways, the touched area A resists with the stiffness
//! t E h (A/h²)^s, shared out by area.

use serde::{Deserialize, Serialize};

use crate::{scene::SoftPads, sensor::Bristles};

/// Least Σ and A/h², so that a touch at a point has a finite stiffness.
const FAINTEST: f64 = 1e-9;

/// The law of one pad.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Law {
    /// Young's modulus (Pa).
    pub(super) young: f64,
    /// Thickness of the gel (m).
    pub(super) thickness: f64,
    pub(super) bristles: Bristles,
}

/// How deep a bristle's cell stands in the object.
#[derive(Clone, Copy, Debug)]
pub(super) struct Depth {
    /// Depth at the bristle (m), negative outside.
    pub(super) middle: f64,
    /// Half of the range over which the depth varies within the cell (m).
    pub(super) spread: f64,
}

impl Depth {
    /// Share of the cell that touches.
    pub(super) fn cover(&self) -> f64 {
        if self.spread <= 0.0 {
            return f64::from(u8::from(self.middle > 0.0));
        }
        (0.5 * (1.0 + self.middle / self.spread)).clamp(0.0, 1.0)
    }

    /// Mean of the depth over the cell, 0 where it does not touch (m).
    pub(super) fn mean(&self) -> f64 {
        if self.middle <= -self.spread {
            0.0
        } else if self.middle >= self.spread {
            self.middle
        } else {
            0.25 * (self.middle + self.spread).powi(2) / self.spread
        }
    }

    /// Mean of its square (m²).
    pub(super) fn mean_square(&self) -> f64 {
        if self.middle <= -self.spread {
            0.0
        } else if self.middle >= self.spread {
            self.middle * self.middle + self.spread * self.spread / 3.0
        } else {
            (self.middle + self.spread).powi(3) / (6.0 * self.spread)
        }
    }

    /// The same cell, the object moved into it by `way` (m).
    pub(super) fn moved(&self, way: f64) -> Self {
        Self { middle: self.middle + way, ..*self }
    }
}

impl Law {
    pub(super) fn new(pads: &SoftPads) -> Self {
        let SoftPads { outline, young, bristles } = *pads;
        Self { young, thickness: outline.thickness, bristles }
    }

    /// Pressure over mean depth (Pa/m) where ∫ δ² dA is `squares` (m⁴).
    pub(super) fn foundation(&self, squares: f64) -> f64 {
        let Bristles { normal, coupling: q, .. } = self.bristles;
        let sum = (squares / self.thickness.powi(4)).max(FAINTEST);
        2.0 * q * normal * self.young / self.thickness * sum.powf(q - 1.0)
    }

    /// Traction over sideways motion (Pa/m) of a touched `area` (m²).
    pub(super) fn shear_foundation(&self, area: f64) -> f64 {
        let Bristles { shear, spread, .. } = self.bristles;
        let size = (area / (self.thickness * self.thickness)).max(FAINTEST);
        shear * self.young / self.thickness * size.powf(spread - 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_half_in_gives_the_mean_of_its_part_inside() {
        // Depth from −1 to 3 mm over the cell.
        let depth = Depth { middle: 1.0, spread: 2.0 };
        let n = 100_000;
        let at = |i: u32| f64::max(-1.0 + 4.0 * (f64::from(i) + 0.5) / f64::from(n), 0.0);
        let mean = |power: i32| (0..n).map(|i| at(i).powi(power)).sum::<f64>() / f64::from(n);
        assert!((depth.cover() - 0.75).abs() < 1e-12, "{} of the cell", depth.cover());
        assert!((depth.mean() - mean(1)).abs() < 1e-6, "{} m", depth.mean());
        assert!((depth.mean_square() - mean(2)).abs() < 1e-6, "{} m²", depth.mean_square());
    }

    #[test]
    fn outside_there_is_nothing() {
        for spread in [0.0, 1e-4] {
            let depth = Depth { middle: -1.1e-4, spread };
            assert_eq!([depth.cover(), depth.mean(), depth.mean_square()], [0.0; 3]);
        }
    }
}
