//! Signed distance from a point to a shape, its gradient, and the gap along a ray.

use nalgebra::{Point3, Vector3};

use super::Shape;

/// Where a point stands to a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// Distance to the surface (m), negative inside.
    pub value: f64,
    /// Gradient of the distance: the outward unit normal at the nearest surface point.
    pub normal: Vector3<f64>,
}

impl Shape {
    /// Signed distance and its gradient at `point`, in the shape's frame (m).
    pub fn distance(&self, point: &Point3<f64>) -> Distance {
        let p = point.coords;
        match self {
            Self::Sphere { radius } => Distance {
                value: p.norm() - radius,
                normal: p.try_normalize(0.0).unwrap_or(Vector3::z()),
            },
            Self::HalfSpace => Distance { value: p.z, normal: Vector3::z() },
            _ => unimplemented!("distance to {self:?}"),
        }
    }
}
