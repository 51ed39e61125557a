//! Signed distance from a point to a shape, its gradient, and the gap along a ray.
//!
//! Points, normals and rays are in the shape's own frame ([`Shape`]). Distances are exact for
//! solids with a closed form; converged to rounding by a Newton iteration for ellipsoids and
//! star-shaped solids; those of the nearest triangle, exact in f64, for meshes; and interpolated
//! for sampled solids. On the medial axis, where the gradient does not exist, the normal is that of
//! one of the nearest surface points.

mod ellipsoid;
mod hollow;
mod ray;
mod solids;
mod star;
mod triangles;

use nalgebra::{Point3, Vector3};

use super::Shape;
pub(super) use solids::revolved;
pub(super) use triangles::TriangleTree;

/// Signed distance from a point to a shape, with its gradient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// Distance to the surface (m), negative inside.
    pub value: f64,
    /// Gradient of the distance: the outward unit normal at the nearest surface point.
    pub normal: Vector3<f64>,
}

impl Distance {
    /// Returns the distance given by the vector `offset` from a sharp edge or corner to the point.
    /// It is positive on the side that `outward` points to; on the edge itself the normal is along
    /// `outward`.
    fn from_edge(offset: &Vector3<f64>, outward: &Vector3<f64>) -> Self {
        let sign = if offset.dot(outward) < 0.0 { -1.0 } else { 1.0 };
        let (length, normal) = length_and_direction(offset, outward);
        Self { value: sign * length, normal: sign * normal }
    }
}

/// Length of `v` and its direction, or that of `fallback` where `v` has none.
fn length_and_direction(v: &Vector3<f64>, fallback: &Vector3<f64>) -> (f64, Vector3<f64>) {
    // Scaled first, so that the square of a tiny length does not vanish.
    let scale = v.amax();
    let unit = if scale > 0.0 { v / scale } else { *fallback };
    (v.norm(), unit.normalize())
}

impl Shape {
    /// Signed distance and its gradient at `point`, in the shape's frame (m).
    pub fn distance(&self, point: &Point3<f64>) -> Distance {
        let p = &point.coords;
        match self {
            Self::Sphere { radius } => solids::sphere(p, *radius),
            Self::Cuboid { half_extents } => solids::cuboid(p, half_extents),
            Self::Cylinder { radius, half_height } => solids::cylinder(p, *radius, *half_height),
            Self::Capsule { radius, half_height } => solids::capsule(p, *radius, *half_height),
            Self::Prism { sides, radius, half_height } => {
                solids::prism(p, *sides, *radius, *half_height)
            }
            Self::Annulus { outer, inner, half_height } => {
                solids::annulus(p, *outer, *inner, *half_height)
            }
            Self::Cone { radius: r, half_height: h } => {
                solids::revolved(p, &Self::cone_profile(*r, *h))
            }
            Self::Cup { bottom, rim, half_height, wall } => {
                solids::revolved(p, &Self::cup_profile(*bottom, *rim, *half_height, *wall))
            }
            Self::Ellipsoid { semi_axes } => ellipsoid::distance(p, semi_axes),
            Self::StarShaped(star) => star.distance(point),
            Self::Hollow(hollow) => hollow.distance(point),
            Self::Rounded(rounded) => rounded.distance(point),
            Self::HalfSpace => Distance { value: p.z, normal: Vector3::z() },
            Self::Mesh(surface) => surface.distance(point),
            Self::Sampled(sampled) => sampled.distance(point),
        }
    }

    /// Bound of the error of [`Shape::distance`] (m): 0 if it is exact to rounding, infinite if it
    /// has none.
    pub fn distance_error(&self) -> f64 {
        match self {
            Self::StarShaped(_) | Self::Hollow(_) => f64::INFINITY,
            Self::Rounded(rounded) => rounded.distance_error(),
            Self::Sampled(sampled) => sampled.distance_error(),
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests;
