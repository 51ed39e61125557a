//! Contact of a deformable surface with rigid shapes.
//!
//! Contact is evaluated at points of the surface. Each of them represents part of its area and is
//! interpolated from the nodes around it. [`ContactStep::touches`] finds the points inside a shape,
//! [`ContactLaw`] gives the energy of a touching point with its gradient and Hessian.

mod approach;
mod backing;
mod engulfing;
mod groups;
mod law;
mod leap;
mod near;
mod piercing;
mod touch;

pub use approach::{advance_to_contact, backed_off, between, clearance, gap, nearest};
pub use backing::Backing;
pub use engulfing::{check_first, engulfs_unfelt, holds, is_engulfed, is_within};
pub use groups::PointGroup;
pub(crate) use law::check_friction;
pub use law::{ContactLaw, Traction};
pub use leap::went_through;
pub use near::DistanceCache;
pub use piercing::DeformedSkin;
pub use touch::{Bend, ContactStep, Touch, first_touch};

use nalgebra::{Point3, Vector3};

/// A point of the surface at which contact is evaluated.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Nodes that the point is interpolated from, with their weights; the weights sum to 1.
    pub shares: Vec<(u32, f64)>,
    /// Area at rest that the point represents (m²).
    pub area: f64,
    /// Young's modulus of the material under the point (Pa).
    pub young: f64,
}

impl SurfacePoint {
    /// Interpolates a nodal field at this point.
    pub fn interpolate(&self, nodal: &[Vector3<f64>]) -> Vector3<f64> {
        self.shares.iter().map(|&(node, share)| nodal[node as usize] * share).sum()
    }

    /// Returns whether the point is interpolated from the same nodes as `other`.
    pub fn has_carriers_of(&self, other: &Self) -> bool {
        self.shares.len() == other.shares.len()
            && self.shares.iter().zip(&other.shares).all(|(a, b)| a.0 == b.0)
    }

    /// Adds `force` on this point to the nodal forces, distributed by the weights.
    pub fn spread(&self, force: &Vector3<f64>, nodal: &mut [Vector3<f64>]) {
        for &(node, share) in &self.shares {
            nodal[node as usize] += force * share;
        }
    }

    /// Position of the point when nodes with positions `places` at rest are displaced (m).
    pub fn place(&self, places: &[Point3<f64>], displacement: &[Vector3<f64>]) -> Point3<f64> {
        let at = |&(node, share): &(u32, f64)| {
            (places[node as usize].coords + displacement[node as usize]) * share
        };
        self.shares.iter().map(at).sum::<Vector3<f64>>().into()
    }
}
