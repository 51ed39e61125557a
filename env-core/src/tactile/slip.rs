//! Sliding share of a contact.
//!
//! Slip begins at the rim of the contact and spreads inwards: while the middle still sticks, the
//! skin slides where the friction limit is reached. Optical fingertips detect this in the
//! non-uniform motion of their markers (Hu et al., arXiv:2303.00935, on a GelSight Mini); here it
//! is computed from the nodal forces.

use super::skin::Skin;
use crate::{deformation::Deformation, geometry::Shape};

/// Fraction of the friction limit from which a node counts as sliding.
const USED_UP: f64 = 0.98;

/// Share of the normal force that sliding nodes carry, 0 without contact. The `object` is at the
/// pose of the solution.
pub(super) fn share(skin: &Skin, answer: &Deformation, object: &Shape, friction: f64) -> f64 {
    let Some(pose) = answer.poses.first() else { return 0.0 };
    let (mut sliding, mut all) = (0.0, 0.0);
    let nodes = answer.contact_force.iter().zip(&answer.displacement).zip(&skin.places);
    for ((force, moved), place) in nodes.filter(|((force, _), _)| force.norm_squared() > 0.0) {
        let place = pose.inverse_transform_point(&(place + moved));
        let normal = pose.rotation * object.distance(&place).normal;
        let pressing = force.dot(&normal).max(0.0);
        all += pressing;
        if (force - normal * pressing).norm() >= USED_UP * friction * pressing {
            sliding += pressing;
        }
    }
    if all > 0.0 { sliding / all } else { 0.0 }
}
