//! Soft objects: their material and their stress limit.

use serde::{Deserialize, Serialize};

use super::Range;

/// Settings of soft objects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Softness {
    /// Young's modulus (Pa).
    pub young: Range,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Von Mises stress, relative to Young's modulus, at which an object is crushed.
    pub crush: f64,
}

impl Default for Softness {
    fn default() -> Self {
        Self { young: [3e4, 1.5e5], poisson: 0.45, crush: 0.3 }
    }
}
