//! Parts of a scene beside the hand: Rapier's settings, the table, a fixture, free bodies.

use nalgebra::{Isometry3, Unit, Vector3};
use rapier3d::prelude::{
    CoefficientCombineRule, ColliderBuilder, ColliderHandle, FrictionModel, Group,
    IntegrationParameters, InteractionGroups, InteractionTestMode, PhysicsWorld, RigidBodyBuilder,
    RigidBodyHandle, SpringCoefficients, Vector,
};

use super::{
    Fixture, SceneConfig, SceneObject,
    gripper::{HAND, OBJECT, TABLE},
    units,
};
use crate::Result;

/// Rapier's settings for stiff, frictional contact of hand-sized objects.
pub(super) fn integration_parameters(config: &SceneConfig) -> IntegrationParameters {
    let physics = &config.physics;
    let substep = physics.time_step / physics.iterations as f64;
    // As stiff as a substep can resolve, and overdamped: softer contact lets held objects creep.
    let softness = SpringCoefficients::new((0.5 / substep) as f32, 5.0);
    // On the table, hulls of flat faces chatter on contact of that stiffness and wander by a
    // millimetre in ten seconds; on contact softer than this a thin plate falls over. A held peg
    // cannot chatter, and pressed with 10 N it would sink into such contact by a clearance.
    let of_the_table = SpringCoefficients::new((0.15 / substep) as f32, 5.0);
    IntegrationParameters {
        dt: physics.time_step as f32,
        num_solver_iterations: physics.iterations,
        contact_softness: softness,
        static_contact_softness: if config.fixture.is_some() { softness } else { of_the_table },
        // Recycled contacts become inaccurate within centimetres, the size of everything here.
        contact_recycling: false,
        friction_model: FrictionModel::Coulomb,
        // Tolerances are relative to this length (2 cm).
        length_unit: units::scalar(0.02),
        // With Rapier's default of 3, an object of grams gripped by the weight of kilograms is
        // ejected.
        normalized_max_corrective_velocity: 100.0,
        // 20 m/s, so that every velocity has a bound.
        normalized_max_linear_velocity: 1000.0,
        max_ccd_substeps: 0,
        ..IntegrationParameters::default()
    }
}

/// Collider of the table: an infinite plane, for which Rapier has the exact normal. The table's
/// edges end the episode but not the contact.
pub(super) fn table() -> ColliderBuilder {
    ColliderBuilder::halfspace(Unit::new_unchecked(Vector::Z))
        .friction(f32::MAX)
        .collision_groups(InteractionGroups::new(TABLE, OBJECT, InteractionTestMode::And))
}

/// Inserts the boxes of a fixture.
pub(super) fn insert_fixture(world: &mut PhysicsWorld, fixture: &Fixture) -> Vec<ColliderHandle> {
    let groups = InteractionGroups::new(TABLE, OBJECT, InteractionTestMode::And);
    let collider = |(pose, half): (Isometry3<f64>, Vector3<f64>)| {
        let [x, y, z] = [half.x, half.y, half.z].map(units::scalar);
        ColliderBuilder::cuboid(x, y, z)
            .position(units::pose(&pose))
            .friction(f32::MAX)
            .collision_groups(groups)
    };
    fixture.boxes().into_iter().map(collider).map(|c| world.colliders.insert(c)).collect()
}

/// Inserts a free body that touches the table, the hand and the `others`.
pub(super) fn insert_solid(
    world: &mut PhysicsWorld,
    object: &SceneObject,
    friction: f64,
    others: Group,
) -> Result<(RigidBodyHandle, ColliderHandle)> {
    let groups = InteractionGroups::new(OBJECT, TABLE | HAND | others, InteractionTestMode::And);
    let collider = object
        .model
        .scaled(object.scale)?
        .friction(friction as f32)
        .friction_combine_rule(CoefficientCombineRule::Min)
        .collision_groups(groups);
    let body = RigidBodyBuilder::dynamic()
        .pose(units::pose(&object.pose))
        .can_sleep(false)
        .additional_mass_properties(object.model.mass_properties(object.mass, object.scale));
    Ok(world.insert(body, collider))
}
