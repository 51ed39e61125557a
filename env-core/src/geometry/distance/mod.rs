//! Signed distance from a point to a shape, its gradient, and the gap along a ray.
//!
//! Points, normals and rays are in the shape's own frame ([`super::Shape`]). Distances are exact
//! for solids with a closed form; converged to rounding by a Newton iteration for ellipsoids and
//! star-shaped solids; those of the nearest triangle, exact in f64, for meshes; and interpolated
//! for sampled solids. On the medial axis, where the gradient does not exist, the normal is that of
//! one of the nearest surface points.

pub(super) mod ellipsoid;
mod facets;
mod hollow;
pub(super) mod ray;
pub(super) mod solids;
mod star;
mod triangles;

use nalgebra::Vector3;

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

#[cfg(test)]
mod tests;
