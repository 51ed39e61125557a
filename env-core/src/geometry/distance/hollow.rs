//! Distance to a solid with a cavity: the larger of the signed distances to the outer solid and to
//! the outside of the cavity. The distance to the cavity is that of the solid at another scale.

use nalgebra::{Point3, Vector3};

use super::Distance;
use crate::geometry::Hollow;

impl Hollow {
    pub(in crate::geometry) fn distance(&self, point: &Point3<f64>) -> Distance {
        let outer = self.solid().distance(point);
        let cavity = self.solid().distance(&(point / self.cavity()));
        let inner = Distance { value: -self.cavity() * cavity.value, normal: -cavity.normal };
        if outer.value > inner.value { outer } else { inner }
    }

    /// Returns [`crate::geometry::Shape::ray_gap`] of this solid.
    pub(super) fn ray_gap(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let scale = self.cavity();
        let to_cavity = |along: &Vector3<f64>| {
            self.solid().ray_gap(&(origin / scale), along).map(|gap| scale * gap)
        };
        // Outside the outer surface, the ray enters the solid through it.
        let entered = self.solid().ray_gap(origin, direction)?;
        if entered >= 0.0 {
            return Some(entered);
        }
        match to_cavity(&-direction) {
            Some(back) if back < 0.0 => Some(-back),
            Some(back) => Some(entered.max(-back)),
            None => Some(entered),
        }
    }
}
