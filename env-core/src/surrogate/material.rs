//! Material of a soft body, which defines the units of its network.

use crate::deformation::Moduli;

/// Material, friction and thickness of a pad, which define its units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PadMaterial {
    pub(super) moduli: Moduli,
    pub(super) friction: f64,
    /// Thickness L (m).
    pub(super) thickness: f64,
}

impl PadMaterial {
    /// Unit of force (N).
    pub(super) fn force(&self) -> f64 {
        self.moduli.young * self.thickness * self.thickness
    }
}
