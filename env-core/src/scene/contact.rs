//! Contact wrenches from the impulses that Rapier's solver applied in the last step.
//!
//! Only solver contacts count: the manifolds of a pair also contain points that are no longer
//! solved but still hold their last impulse. A contact's impulse is p = p_n d + p₁ t₁ + p₂ t₂ on
//! the first body, with d = −normal, t₁ Rapier's orthonormal vector of d and t₂ = d × t₁.

use nalgebra::{Isometry3, Point3};
use rapier3d::{
    prelude::{ColliderHandle, PhysicsWorld, Vector},
    utils::OrthonormalBasis,
};

use super::units;
use crate::deformation::Wrench;

/// Wrench of `other` on `collider` through their contact, in the world frame about `origin` (m).
pub(super) fn wrench(
    world: &PhysicsWorld,
    collider: ColliderHandle,
    other: ColliderHandle,
    origin: &Point3<f64>,
) -> Wrench {
    let mut sum = Wrench::default();
    let Some(pair) = world.narrow_phase.contact_pair(collider, other) else { return sum };
    let on_first = if pair.collider1 == collider { 1.0 } else { -1.0 };
    for manifold in pair.solver_manifolds() {
        let direction = -manifold.data.normal;
        let first = direction.orthonormal_vector();
        let second = direction.cross(first);
        for contact in &manifold.data.solver_contacts {
            let point = &manifold.points[contact.contact_indices()[0] as usize].data;
            let [along, across] = [point.tangent_impulse.x, point.tangent_impulse.y];
            let impulse: Vector = direction * point.impulse + first * along + second * across;
            let force =
                units::si_vector(impulse) * (on_first / f64::from(world.integration_parameters.dt));
            let (p1, p2) = manifold.data.solver_contact_world_points(contact, &world.bodies);
            let at = units::si_vector((p1 + p2) * 0.5);
            sum.add_force(&force, &(at - origin.coords));
        }
    }
    sum
}

/// Returns whether two colliders exerted any force on each other.
pub(super) fn exists(world: &PhysicsWorld, one: ColliderHandle, other: ColliderHandle) -> bool {
    let Some(pair) = world.narrow_phase.contact_pair(one, other) else { return false };
    pair.solver_manifolds().iter().any(|manifold| {
        manifold.data.solver_contacts.iter().any(|contact| {
            let point = &manifold.points[contact.contact_indices()[0] as usize].data;
            let parts = [point.impulse, point.tangent_impulse.x, point.tangent_impulse.y];
            parts.iter().any(|part| *part != 0.0)
        })
    })
}

impl Wrench {
    /// Returns the wrench in the axes of `frame`, about the same point.
    pub(super) fn seen_from(&self, frame: &Isometry3<f64>) -> Self {
        let turn = |v| frame.rotation.inverse_transform_vector(v);
        Self { force: turn(&self.force), torque: turn(&self.torque) }
    }
}
