//! Force law of the elastic foundation, which represents a gel on a rigid base.
//!
//! The foundation stores the energy U = E h³ k Σ^q with Σ = ∫ δ² dA / h⁴, where δ is the depth of
//! the undeformed face inside the object and h the gel's thickness. The pressure is ∂U/∂δ per area:
//! 2 q k E Σ^(q−1) δ/h. With q = 1 this is Winkler's foundation. With q < 1 a large contact is
//! softer than the sum of its parts, as on a half-space; with q > 1 it is stiffer, as on a thin
//! incompressible layer. For a sphere of radius R the force is proportional to R^q δ^(3q−1).
//! Sideways, the contact area A has the stiffness t E h (A/h²)^s, distributed by area.
//! [`ElasticFoundation`] holds k, q, t and s as `normal`, `coupling`, `shear` and `spread`.

use serde::{Deserialize, Serialize};

use crate::{scene::SoftPads, sensor::ElasticFoundation};

/// Lower bound of Σ and A/h², so that a point contact has a finite stiffness.
const FAINTEST: f64 = 1e-9;

/// Force law of one pad.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct FoundationLaw {
    /// Young's modulus (Pa).
    pub(super) young: f64,
    /// Thickness of the gel (m).
    pub(super) thickness: f64,
    pub(super) coefficients: ElasticFoundation,
}

/// Depth of a bristle's cell inside the object, distributed evenly over `middle` ± `spread`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Depth {
    /// Depth at the bristle (m), negative outside.
    pub(super) middle: f64,
    /// Half the range of the depth within the cell (m).
    pub(super) spread: f64,
}

impl Depth {
    /// Fraction of the cell in contact.
    pub(super) fn cover(&self) -> f64 {
        if self.spread <= 0.0 {
            return f64::from(u8::from(self.middle > 0.0));
        }
        (0.5 * (1.0 + self.middle / self.spread)).clamp(0.0, 1.0)
    }

    /// Mean depth over the cell, 0 where it does not touch (m).
    pub(super) fn mean(&self) -> f64 {
        if self.middle <= -self.spread {
            0.0
        } else if self.middle >= self.spread {
            self.middle
        } else {
            0.25 * (self.middle + self.spread).powi(2) / self.spread
        }
    }

    /// Mean squared depth (m²).
    pub(super) fn mean_square(&self) -> f64 {
        if self.middle <= -self.spread {
            0.0
        } else if self.middle >= self.spread {
            self.middle * self.middle + self.spread * self.spread / 3.0
        } else {
            (self.middle + self.spread).powi(3) / (6.0 * self.spread)
        }
    }

    /// Returns the depth after the object has moved into the cell by `travel` (m).
    pub(super) fn moved(&self, travel: f64) -> Self {
        Self { middle: self.middle + travel, ..*self }
    }
}

impl FoundationLaw {
    pub(super) fn new(pads: &SoftPads) -> Self {
        let SoftPads { outline, young, foundation } = *pads;
        Self { young, thickness: outline.thickness, coefficients: foundation }
    }

    /// Pressure per mean depth (Pa/m) for ∫ δ² dA = `squares` (m⁴).
    pub(super) fn foundation(&self, squares: f64) -> f64 {
        let ElasticFoundation { normal, coupling: q, .. } = self.coefficients;
        let sum = (squares / self.thickness.powi(4)).max(FAINTEST);
        2.0 * q * normal * self.young / self.thickness * sum.powf(q - 1.0)
    }

    /// Traction per sideways motion (Pa/m) of a contact `area` (m²).
    pub(super) fn shear_foundation(&self, area: f64) -> f64 {
        let ElasticFoundation { shear, spread, .. } = self.coefficients;
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
