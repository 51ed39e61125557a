//! Material of a soft body, which defines the units of its network.

use nalgebra::Vector3;

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

    /// Displacement in m (V) of one in units (V, 3).
    pub(super) fn displacement(&self, numbers: &[f32]) -> Vec<Vector3<f64>> {
        vectors(numbers, self.thickness)
    }

    /// Forces in N (V) of those in units (V, 3).
    pub(super) fn forces(&self, numbers: &[f32]) -> Vec<Vector3<f64>> {
        vectors(numbers, self.force())
    }

    /// Von Mises stress in Pa (T) of that in units (T); negative numbers become 0.
    pub(super) fn von_mises(&self, numbers: &[f32]) -> Vec<f64> {
        let shear = self.moduli.shear();
        numbers.iter().map(|stress| f64::from(stress.max(0.0)) * shear).collect()
    }
}

fn vectors(numbers: &[f32], unit: f64) -> Vec<Vector3<f64>> {
    let vector = |&v: &[f32; 3]| Vector3::from(v).cast::<f64>() * unit;
    numbers.as_chunks::<3>().0.iter().map(vector).collect()
}
