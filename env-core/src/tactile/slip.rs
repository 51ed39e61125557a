//! How much of a contact slides.
//!
//! A grip gives way from the rim of its contact inwards: while the middle still sticks, the skin already
//! slides where friction is used up. Optical fingertips see that in the unevenness of their markers'
//! motion (Hu et al., arXiv:2303.00935, on a GelSight Mini); here it is read from the nodal forces.

use super::skin::Skin;
use crate::{deformation::Deformation, geometry::Shape};

/// Share of what friction can bear from which a node counts as sliding.
const USED_UP: f64 = 0.98;

/// Share of the normal force on the skin that is borne where friction is used up, 0 without any. The
/// `object` is at the answer's pose.
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
