//! Distance to a solid round a cavity: the one of its two surfaces that is nearer, seen from
//! within; the cavity's is the solid's own at another scale.

use nalgebra::{Point3, Vector3};

use super::Distance;
use crate::geometry::Hollow;

impl Hollow {
    pub(super) fn distance(&self, point: &Point3<f64>) -> Distance {
        let outer = self.solid().distance(point);
        let cavity = self.solid().distance(&(point / self.cavity()));
        let inner = Distance { value: -self.cavity() * cavity.value, normal: -cavity.normal };
        if outer.value > inner.value { outer } else { inner }
    }

    /// [`crate::geometry::Shape::ray_gap`].
    pub(super) fn ray_gap(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let scale = self.cavity();
        let to_cavity = |along: &Vector3<f64>| {
            self.solid().ray_gap(&(origin / scale), along).map(|gap| scale * gap)
        };
        // Into the solid from outside, out of the cavity from within it.
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
