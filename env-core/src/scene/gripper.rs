//! The hand: a kinematic wrist and two fingers on prismatic joints.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rapier3d::prelude::{
    ColliderBuilder, ColliderHandle, GenericJoint, Group, ImpulseJointHandle, InteractionGroups,
    InteractionTestMode, JointAxis, MassProperties, MotorModel, PhysicsWorld,
    PrismaticJointBuilder, RigidBodyBuilder, RigidBodyHandle, Vector,
};
use serde::{Deserialize, Serialize};

use super::{Gripper, Pads, units};
use crate::objects::{FINGER_DEPTH, FINGER_TOP};

/// Rigid fraction of a soft pad's thickness, at its base; the gel is not compressed further.
const CORE: f64 = 0.25;
/// Lower bound of the grip force in the damping of a finger (N), so that an idle finger stays
/// still.
const LEAST_FORCE: f64 = 1.0;

/// Collision groups: the table, the object, the hand.
pub(super) const TABLE: Group = Group::GROUP_1;
pub(super) const OBJECT: Group = Group::GROUP_2;
pub(super) const HAND: Group = Group::GROUP_3;

/// Rapier handles of one finger.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub(super) struct FingerBody {
    pub(super) body: RigidBodyHandle,
    pub(super) pad: ColliderHandle,
    joint: ImpulseJointHandle,
    /// Direction in which the finger closes along the wrist's x: +1 for the finger on −x.
    side: f32,
}

/// Rapier handles of the hand.
#[derive(Clone, Copy, Serialize, Deserialize)]
pub(super) struct HandBodies {
    pub(super) wrist: RigidBodyHandle,
    pub(super) fingers: [FingerBody; 2],
}

impl HandBodies {
    /// Inserts an open hand at `pose` (m).
    pub(super) fn insert(
        world: &mut PhysicsWorld,
        gripper: &Gripper,
        pads: &Pads,
        pose: &Isometry3<f64>,
    ) -> Self {
        let kinematic = RigidBodyBuilder::kinematic_position_based().pose(units::pose(pose));
        let wrist = world.insert_body(kinematic);
        let core = match pads {
            Pads::Rigid => 1.0,
            Pads::Soft(_) => CORE,
        };
        let fingers =
            [1.0, -1.0].map(|side| FingerBody::insert(world, gripper, core, pose, wrist, side));
        Self { wrist, fingers }
    }

    /// Moves the pads' faces `opening` (m) apart about the wrist at `pose`.
    pub(super) fn open_to(&self, world: &mut PhysicsWorld, pose: &Isometry3<f64>, opening: f64) {
        for finger in &self.fingers {
            let offset = Translation3::new(-0.5 * f64::from(finger.side) * opening, 0.0, 0.0);
            world.bodies[finger.body].set_position(units::pose(&(pose * offset)), false);
        }
    }

    /// Drives each finger with the force `grip` (N), closing if positive.
    ///
    /// The force is applied to the finger; the joint's motor adds damping, which sets the speed of
    /// a free finger, and a spring on the common displacement of the fingers.
    pub(super) fn drive(&self, world: &mut PhysicsWorld, gripper: &Gripper, grip: f64) {
        let [(x0, v0), (x1, v1)] = self.fingers.map(|finger| finger.travel(world, self.wrist));
        let (gap, rate) = (0.5 * (x1 - x0), 0.5 * (v1 - v0));
        // Position of a centred finger at the end of the step; with the present one as target, the
        // spring would brake it.
        let target = gap + rate * world.integration_parameters.dt;
        let axis = world.bodies[self.wrist].rotation() * Vector::X;
        let stiffness = gripper.centering_stiffness as f32;
        let damping = damping(gripper, grip) as f32;
        for finger in &self.fingers {
            let joint = finger.motor(world);
            joint.set_motor(JointAxis::LinX, -finger.side * target, 0.0, stiffness, damping);
            let body = &mut world.bodies[finger.body];
            body.reset_forces(false);
            body.add_force(axis * (finger.side * units::scalar(grip)), false);
        }
    }
}

impl HandBodies {
    /// Motion of each finger.
    pub(super) fn slides(&self, world: &PhysicsWorld) -> [Slide; 2] {
        self.fingers.map(|finger| {
            let body = &world.bodies[finger.body];
            Slide {
                place: units::si_vector(body.translation()),
                velocity: units::si_vector(body.linvel()),
            }
        })
    }

    /// Force on each finger along the wrist's x (N) from `grip` (N) and the centring spring,
    /// without dampers.
    pub(super) fn drives(&self, world: &PhysicsWorld, gripper: &Gripper, grip: f64) -> [f64; 2] {
        let travel = self.fingers.map(|finger| units::si(finger.travel(world, self.wrist).0));
        let common = 0.5 * (travel[0] + travel[1]);
        self.fingers
            .map(|finger| f64::from(finger.side) * grip - gripper.centering_stiffness * common)
    }
}

/// Damping of each slide under the force `grip` (N s/m).
pub(super) fn damping(gripper: &Gripper, grip: f64) -> f64 {
    grip.abs().max(LEAST_FORCE) / gripper.closing_speed
}

/// Motion of a finger.
pub(super) struct Slide {
    /// Position in the world (m).
    pub(super) place: Vector3<f64>,
    /// Velocity in the world (m/s).
    pub(super) velocity: Vector3<f64>,
}

impl FingerBody {
    /// Inserts a finger. Its frame is the wrist's, moved to the centre of the pad's face, so that
    /// the grip force has no lever arm about the guide.
    fn insert(
        world: &mut PhysicsWorld,
        gripper: &Gripper,
        core: f64,
        wrist_pose: &Isometry3<f64>,
        wrist: RigidBodyHandle,
        side: f64,
    ) -> Self {
        let travel = 0.5 * gripper.max_opening;
        let offset = Translation3::new(-side * travel, 0.0, 0.0);
        let mass = gripper.finger_mass as f32;
        let moment = mass * units::scalar(gripper.pad_length).powi(2) / 6.0;
        let body = RigidBodyBuilder::dynamic()
            .pose(units::pose(&(wrist_pose * offset)))
            .can_sleep(false)
            .gravity_scale(0.0)
            .additional_mass_properties(MassProperties::new(
                Vector::ZERO,
                mass,
                Vector::splat(moment),
            ));
        let (body, pad) = world.insert(body, touching(pad_box(gripper, core, side)));
        world.insert_collider(touching(body_box(gripper, side)), Some(body));
        let joint = PrismaticJointBuilder::new(Vector::X)
            .contacts_enabled(false)
            .motor_model(MotorModel::ForceBased)
            .motor_max_force(f32::MAX)
            .limits(if side > 0.0 {
                [units::scalar(-travel), 0.0]
            } else {
                [0.0, units::scalar(travel)]
            });
        let joint = world.insert_impulse_joint(wrist, body, joint.build());
        Self { body, pad, joint, side: side as f32 }
    }

    fn motor<'a>(&self, world: &'a mut PhysicsWorld) -> &'a mut GenericJoint {
        let joint = world.impulse_joints.get_mut(self.joint, false);
        &mut joint.expect("a scene never removes its joints").data
    }

    /// Position of the pad face along the wrist's x and its rate, in Rapier's units.
    fn travel(&self, world: &PhysicsWorld, wrist: RigidBodyHandle) -> (f32, f32) {
        let (wrist, body) = (&world.bodies[wrist], &world.bodies[self.body]);
        let axis = wrist.rotation() * Vector::X;
        let velocity = body.linvel() - wrist.velocity_at_point(body.translation());
        (axis.dot(body.translation() - wrist.translation()), axis.dot(velocity))
    }

    /// Distance of the pad face from the tool centre (m) and its rate (m/s).
    pub(super) fn position(&self, world: &PhysicsWorld, wrist: RigidBodyHandle) -> (f64, f64) {
        let (position, velocity) = self.travel(world, wrist);
        (units::si(-self.side * position), units::si(-self.side * velocity))
    }

    /// Pose of the pad's frame (m): see [`super::FingerState`].
    pub(super) fn pad_pose(&self, world: &PhysicsWorld) -> Isometry3<f64> {
        let face = units::si_pose(world.bodies[self.body].position());
        // The pad's z is ±x of the wrist, its y the wrist's z.
        let about_z = f64::from(self.side) * FRAC_PI_2;
        face * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), about_z)
            * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2)
    }
}

/// Collider of the fraction `core` of a pad's thickness, at its base.
fn pad_box(gripper: &Gripper, core: f64, side: f64) -> ColliderBuilder {
    let (thickness, soft) = (core * gripper.pad_thickness, (1.0 - core) * gripper.pad_thickness);
    let half = 0.5 * Vector3::new(thickness, gripper.pad_width, gripper.pad_length);
    ColliderBuilder::cuboid(units::scalar(half.x), units::scalar(half.y), units::scalar(half.z))
        .translation(Vector::new(units::scalar(-side * (soft + half.x)), 0.0, 0.0))
}

fn body_box(gripper: &Gripper, side: f64) -> ColliderBuilder {
    let (low, high) = (-0.5 * gripper.pad_length, FINGER_TOP.max(0.5 * gripper.pad_length));
    let x = -side * (gripper.pad_thickness + 0.5 * FINGER_DEPTH);
    let half = 0.5 * Vector3::new(FINGER_DEPTH, gripper.pad_width, high - low);
    ColliderBuilder::cuboid(units::scalar(half.x), units::scalar(half.y), units::scalar(half.z))
        .translation(units::vector(&Vector3::new(x, 0.0, f64::midpoint(low, high))))
}

/// Configures a part of the hand to collide with the object only. Friction is the object's.
fn touching(collider: ColliderBuilder) -> ColliderBuilder {
    let groups = InteractionGroups::new(HAND, OBJECT, InteractionTestMode::And);
    collider.density(0.0).friction(f32::MAX).collision_groups(groups)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::objects::Hand;

    #[test]
    fn grasps_are_sampled_for_this_hand() {
        let (hand, gripper) = (Hand::default(), Gripper::default());
        assert_eq!(hand.opening, gripper.max_opening);
        let pad = [hand.pad.width, hand.pad.length, hand.pad.thickness];
        assert_eq!(pad, [gripper.pad_width, gripper.pad_length, gripper.pad_thickness]);
    }
}
