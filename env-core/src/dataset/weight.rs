//! Weight of a grasped object, which the pads take over from a table as they grip.
//!
//! Gravity acts along the fingers, away from the wrist. Two pads pressed with N hold at most 2 μ N,
//! and less where the centre of mass lies beside the line between them, because its weight turns
//! the object about that line. The pads bear half of that limit, or the whole weight if it is less;
//! the table bears the rest.

use nalgebra::{Isometry3, Point3, Vector3};

use super::config::GelConfig;
use crate::{deformation::Wrench, objects::Object};

/// Weight of an object held by two pads.
pub(super) struct Weight {
    /// Weight (N), in the object's initial frame.
    force: Vector3<f64>,
    /// Centre of mass in the object's frame.
    center: Point3<f64>,
    /// Distance of the centre of mass from the line between the contacts (m).
    lever: f64,
    /// Friction coefficient of the pads.
    friction: f64,
}

/// Standard gravity (m/s²).
const GRAVITY: f64 = 9.806_65;
/// Share of the friction limit that the pads bear.
const SHARE: f64 = 0.5;
/// Lever arm (m) at which the torque of the weight counts as much as the weight: the size of a
/// contact.
const PATCH: f64 = 0.003;

impl Weight {
    /// Returns the weight of an `object` of `density` (kg/m³), held at `tool` by pads of `gel`.
    pub(super) fn new(
        object: &Object,
        density: f64,
        tool: &Isometry3<f64>,
        gel: &GelConfig,
    ) -> Self {
        let solid = object.mass_properties(1.0);
        let force = tool * Vector3::new(0.0, 0.0, -density * solid.mass * GRAVITY);
        let seen = tool.inverse_transform_point(&solid.center);
        Self { force, center: solid.center, lever: seen.y.hypot(seen.z), friction: gel.friction }
    }

    /// Part of the weight that pads pressed with `grip` (N) bear: force (N) and torque (N m) about
    /// the origin of the object at `pose`.
    pub(super) fn borne(&self, grip: f64, pose: &Isometry3<f64>) -> Wrench {
        let limit = 2.0 * SHARE * self.friction * grip / (1.0 + self.lever / PATCH);
        let force = self.force.cap_magnitude(limit);
        Wrench { force, torque: (pose * self.center.coords).cross(&force) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{dataset::DatasetConfig, objects::catalogue};

    #[test]
    fn pads_bear_all_of_a_weight_once_they_grip_well() {
        let object = &catalogue(0)[20];
        let (mass, tool) =
            (object.mass_properties(1000.0), Isometry3::rotation(Vector3::x() * 0.7));
        let gel = &DatasetConfig::default().gels[0];
        let weight = Weight::new(object, 1000.0, &tool, gel);
        let pose = Isometry3::identity();
        let full = weight.borne(100.0, &pose);
        let exact = tool * Vector3::new(0.0, 0.0, -9.806_65 * mass.mass);
        assert!((full.force - exact).norm() < 1e-12, "{} N for {exact} N", full.force);
        let torque = mass.center.coords.cross(&exact);
        assert!((full.torque - torque).norm() < 1e-12, "{} N m for {torque} N m", full.torque);
        let grip = 0.1 * exact.norm();
        let little = weight.borne(grip, &pose).force.norm();
        assert!(little < 0.5 * 2.0 * gel.friction * grip * (1.0 + 1e-12), "{little} N at {grip} N");
        assert_eq!(weight.borne(0.0, &pose), Wrench::default());
    }
}
