//! Soft pads: an elastic foundation of bristles with implicit time integration, in place of
//! Rapier's rigid contact.
//!
//! The face of each pad carries bristles. A bristle inside the object presses along the object's
//! normal and sticks to the object up to Coulomb's limit ([`law`], [`touch`]). The bristle forces
//! are those at the end of a time step ([`balance`]), because forces from its beginning are
//! unstable for any object that a stiff gel can hold. They act on the object and on the finger
//! slides as external forces, on an object that only the pads touch as one impulse; the wrist bears
//! the other components.
//!
//! The rigid contact of the object with a fixture is solved with them ([`stops`]). That with the
//! table is Rapier's and comes after, so the forces include a part of the weight of an object that
//! stands on it. Slip is therefore determined from the actual
//! motion in the step: bristles that are loaded only in the prediction keep their anchors. A more
//! accurate model corrects the foundation once per control step ([`correction`]).
//!
//! Known limits: a sharp edge is sensed only by the bristles that it meets, 2.6 mm apart; the gel
//! does not move sideways, so bristles beside a contact are unaffected by it except through the
//! coupling of the law.

mod balance;
mod correction;
mod law;
mod stops;
mod touch;

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use rapier3d::prelude::{PhysicsWorld, RigidBodyHandle, Vector};
use serde::{Deserialize, Serialize};

use super::{
    Gripper, ObjectModel, SceneObject, SoftPads,
    gripper::{HandBodies, damping},
    units,
};
use crate::{deformation::Wrench, geometry::Shape};
use balance::{Bodies, LoadedBristle, Velocities};
use correction::Correction;
use law::FoundationLaw;
pub(super) use stops::{FixtureContact, stops};
use touch::{BristleAnchor, BristleContact, BristleFace, PlacedObject};

/// Elastic foundations of both pads of a scene.
#[derive(Serialize, Deserialize)]
pub(super) struct Foundations {
    law: FoundationLaw,
    /// Coulomb coefficient between pads and object.
    friction: f64,
    /// Size of the object relative to its model.
    scale: f64,
    pads: [PadFoundation; 2],
    /// Wrench of the fixture on the object in the last step, about its centre of mass.
    fixture: Wrench,
    /// Data derived from settings and object, not part of a saved scene.
    #[serde(skip)]
    surroundings: Option<Surroundings>,
}

/// State of one pad.
#[derive(Clone, Serialize, Deserialize)]
struct PadFoundation {
    anchors: Vec<Option<BristleAnchor>>,
    correction: Correction,
    /// Wrench on the pad, in its frame about its origin, in the last step.
    wrench: Wrench,
}

struct Surroundings {
    face: BristleFace,
    /// The object in its actual size.
    shape: Shape,
    /// Radius of a sphere about the origin of the object's frame that contains the object (m).
    radius: f64,
}

/// Inputs of the elastic foundation for one Rapier step.
pub(super) struct FoundationStep {
    /// Duration (s).
    pub(super) time: f64,
    /// Gravity along −z (m/s²).
    pub(super) gravity: f64,
    /// External force on the object's centre of mass (N).
    pub(super) force: Vector3<f64>,
    /// Wrist poses at the beginning and at the end of the step (m).
    pub(super) wrist: [Isometry3<f64>; 2],
    /// Grip force (N).
    pub(super) grip: f64,
    /// `true` if the object touched the table in the last step.
    pub(super) on_table: bool,
}

/// Contacts and state at the beginning of a step, for [`Foundations::settle`] after it.
pub(super) struct Applied {
    contacts: Vec<LoadedBristle>,
    /// Correction wrenches of the fingers on the object, about its centre of mass.
    extra: [Wrench; 2],
    bodies: Bodies,
    /// Poses of the pads in the world (m).
    poses: [Isometry3<f64>; 2],
    /// Poses of the object in the frames of the pads (m).
    seen: [Isometry3<f64>; 2],
    /// Centre of mass of the object (m).
    center: Vector3<f64>,
    base: Twist,
}

impl Foundations {
    /// Creates the elastic foundations of a new scene.
    pub(super) fn new(pads: &SoftPads, object: &SceneObject) -> Self {
        let face = BristleFace::new(&pads.outline);
        let pad = PadFoundation {
            anchors: vec![None; face.count()],
            correction: Correction::default(),
            wrench: Wrench::default(),
        };
        let (friction, scale) = (object.friction, object.scale);
        let mut foundation = Self {
            law: FoundationLaw::new(pads),
            friction,
            scale,
            pads: [pad.clone(), pad],
            fixture: Wrench::default(),
            surroundings: None,
        };
        foundation.attach(pads, object.model);
        foundation
    }

    /// Restores the data that a saved scene does not contain.
    pub(super) fn attach(&mut self, pads: &SoftPads, model: &ObjectModel) {
        let radius = self.scale * model.radius();
        let (face, shape) = (BristleFace::new(&pads.outline), model.sampled().scaled(self.scale));
        self.surroundings = Some(Surroundings { face, shape, radius });
    }

    /// Returns whether an object is attached.
    pub(super) fn is_attached(&self) -> bool {
        self.surroundings.is_some()
    }

    /// Wrench of the object on a pad in the last step, in the pad's frame about its origin.
    pub(super) fn wrench(&self, finger: usize) -> Wrench {
        self.pads[finger].wrench
    }

    /// Wrench of the fixture on the object in the last step, in the world about the centre of mass.
    pub(super) fn fixture(&self) -> Wrench {
        self.fixture
    }

    /// Corrects a finger towards the wrench `model` on its pad, computed by a more accurate model
    /// at `pose` of the object in the pad's frame.
    pub(super) fn correct(&mut self, finger: usize, pose: &Isometry3<f64>, model: &Wrench) {
        let touches = self.touches(finger, pose);
        let friction = self.friction;
        self.pads[finger].correction.toward(model, |gain| at_rest(&touches, gain, friction));
    }

    /// Corrects only the normal force of a finger, towards `force` (N); see [`Foundations::correct`].
    pub(super) fn correct_pressing(&mut self, finger: usize, pose: &Isometry3<f64>, force: f64) {
        let touches = self.touches(finger, pose);
        let friction = self.friction;
        self.pads[finger].correction.press(force, |gain| at_rest(&touches, gain, friction));
    }

    /// Greatest depth of the undeformed face inside an object at `pose` in the pad's frame (m), 0
    /// outside.
    pub(super) fn indentation(&self, finger: usize, pose: &Isometry3<f64>) -> f64 {
        match &self.surroundings {
            Some(surroundings) => {
                let obstacle = surroundings.obstacle(pose);
                surroundings.face.indentation(&obstacle, &self.touches(finger, pose))
            }
            None => 0.0,
        }
    }

    fn touches(&self, finger: usize, pose: &Isometry3<f64>) -> Vec<BristleContact> {
        let mut touches = Vec::new();
        if let Some(surroundings) = &self.surroundings {
            let obstacle = surroundings.obstacle(pose);
            let anchors = &self.pads[finger].anchors;
            surroundings.face.touches(&obstacle, &self.law, anchors, &mut touches);
        }
        touches
    }

    /// Applies the foundation's forces of one step to object and fingers. The result goes to
    /// [`Foundations::settle`] after Rapier has taken the step.
    pub(super) fn apply(
        &mut self,
        world: &mut PhysicsWorld,
        hand: &HandBodies,
        object: RigidBodyHandle,
        gripper: &Gripper,
        step: &FoundationStep,
        stops: &[FixtureContact],
    ) -> Applied {
        let poses = hand.fingers.map(|finger| finger.pad_pose(world));
        let seen = poses.map(|pad| pad.inv_mul(&units::si_pose(world.bodies[object].position())));
        let touches = [0, 1].map(|finger| self.touches(finger, &seen[finger]));
        let center = units::si_vector(world.bodies[object].center_of_mass());
        let base = Twist::of(&step.wrist, step.time);
        let mut bodies = bodies(world, hand, object, gripper, step, &base);
        let mut contacts = Vec::with_capacity(touches[0].len() + touches[1].len());
        let mut extra = [Wrench::default(); 2];
        for (finger, touches) in touches.into_iter().enumerate() {
            let (pad, pose) = (&self.pads[finger], &poses[finger]);
            let touching = !touches.is_empty();
            for touch in touches {
                let place = (pose * Point3::from(touch.place)).coords;
                let (arm, gain) = (place - center, pad.correction.gain);
                let rest = base.at(&place);
                contacts.push(LoadedBristle::new(finger, touch, gain, &pose.rotation, arm, rest));
            }
            if touching {
                extra[finger] = on_object(&pad.correction.at(-pad.wrench.force.z), pose, &center);
                bodies.loads += bodies.loads_of(finger, &extra[finger]);
            }
        }
        let (mut forces, stopped) = bodies.balance(&contacts, stops, self.friction);
        self.fixture = wrench_of(&stopped);
        forces += stopped;
        for (finger, extra) in extra.iter().enumerate() {
            forces += bodies.loads_of(finger, extra);
        }
        let other = step.force - Vector3::z() * (bodies.mass * step.gravity);
        let only_pads = !(contacts.is_empty() || step.on_table);
        let sudden = only_pads.then_some((other, step.time));
        push(world, hand, object, &bodies.axis, &forces, sudden);
        Applied { contacts, extra, bodies, poses, seen, center, base }
    }

    /// Updates wrenches and anchors from the motion of object and fingers in the step.
    pub(super) fn settle(
        &mut self,
        world: &PhysicsWorld,
        hand: &HandBodies,
        object: RigidBodyHandle,
        applied: Applied,
    ) {
        let Applied { mut contacts, extra, bodies, poses, seen, center, base } = applied;
        let motion = motion(world, hand, object, &bodies.axis, &base);
        let wrenches = bodies.exerted(&mut contacts, &motion, self.friction);
        for finger in 0..2 {
            let wrench = wrenches[finger] + extra[finger];
            self.pads[finger].wrench = on_pad(&wrench, &poses[finger], &center);
        }
        self.stick(&contacts, &poses, &seen);
    }

    /// Stores the anchors of the bristles; a pad without contact loses its anchors and its
    /// correction.
    fn stick(
        &mut self,
        contacts: &[LoadedBristle],
        poses: &[Isometry3<f64>; 2],
        seen: &[Isometry3<f64>; 2],
    ) {
        for finger in 0..2 {
            let pad = &mut self.pads[finger];
            pad.anchors.fill(None);
            let mut touching = false;
            for contact in contacts.iter().filter(|contact| contact.finger == finger) {
                let stretch = contact.stretch_left(&poses[finger].rotation);
                let anchor = contact.touch.anchor(&stretch, &seen[finger]);
                pad.anchors[contact.touch.bristle] = Some(anchor);
                touching = true;
            }
            if !touching {
                pad.correction = Correction::default();
            }
        }
    }
}

impl Surroundings {
    /// Returns the object at `pose` in a pad's frame.
    fn obstacle(&self, pose: &Isometry3<f64>) -> PlacedObject<'_> {
        PlacedObject::new(&self.shape, self.radius, pose)
    }
}

/// Wrench of touches at rest on their pad, in its frame about its origin.
fn at_rest(touches: &[BristleContact], gain: f64, friction: f64) -> Wrench {
    let mut sum = Wrench::default();
    for touch in touches {
        let force = -touch.at_rest(gain, friction).0;
        sum.force += force;
        sum.torque += touch.place.cross(&force);
    }
    sum
}

impl SoftPads {
    /// Wrenches on one pad, in its frame about its origin (N, N m), of an `object` that moves
    /// slowly through `path`, poses in the pad's frame. Uses the elastic foundation alone, without
    /// a gripper.
    pub fn wrenches(
        &self,
        object: &ObjectModel,
        friction: f64,
        path: &[Isometry3<f64>],
    ) -> Vec<Wrench> {
        let law = FoundationLaw::new(self);
        let (face, radius) = (BristleFace::new(&self.outline), object.radius());
        let surroundings = Surroundings { face, shape: object.sampled().clone(), radius };
        let mut anchors = vec![None; surroundings.face.count()];
        let mut touches = Vec::new();
        let frame = |pose: &Isometry3<f64>| {
            let obstacle = surroundings.obstacle(pose);
            surroundings.face.touches(&obstacle, &law, &anchors, &mut touches);
            anchors.fill(None);
            for touch in &touches {
                let stretch = touch.at_rest(1.0, friction).1;
                anchors[touch.bristle] = Some(touch.anchor(&stretch, pose));
            }
            at_rest(&touches, 1.0, friction)
        };
        path.iter().map(frame).collect()
    }
}

/// Part of forces on the unknowns that acts on the object.
fn wrench_of(forces: &Velocities) -> Wrench {
    Wrench { force: forces.fixed_rows::<3>(0).into(), torque: forces.fixed_rows::<3>(3).into() }
}

/// Velocity of the wrist as a rigid motion: of its origin, and angular.
struct Twist {
    origin: Vector3<f64>,
    linear: Vector3<f64>,
    angular: Vector3<f64>,
}

impl Twist {
    fn of(wrist: &[Isometry3<f64>; 2], time: f64) -> Self {
        let [from, to] = wrist;
        let way = to.translation.vector - from.translation.vector;
        let turn = (to.rotation * from.rotation.inverse()).scaled_axis();
        Self { origin: from.translation.vector, linear: way / time, angular: turn / time }
    }

    fn at(&self, place: &Vector3<f64>) -> Vector3<f64> {
        self.linear + self.angular.cross(&(place - self.origin))
    }
}

/// Velocities of object and slides; those of the slides are relative to a wrist that moves as
/// `base`.
fn motion(
    world: &PhysicsWorld,
    hand: &HandBodies,
    object: RigidBodyHandle,
    axis: &Vector3<f64>,
    base: &Twist,
) -> Velocities {
    let object = &world.bodies[object];
    let mut motion = Velocities::zeros();
    motion.fixed_rows_mut::<3>(0).copy_from(&units::si_vector(object.linvel()));
    motion.fixed_rows_mut::<3>(3).copy_from(&units::si_angular(object.angvel()));
    for (finger, slide) in hand.slides(world).iter().enumerate() {
        motion[6 + finger] = axis.dot(&(slide.velocity - base.at(&slide.place)));
    }
    motion
}

/// Reads the bodies from Rapier, on a wrist that moves as `base`.
fn bodies(
    world: &PhysicsWorld,
    hand: &HandBodies,
    object: RigidBodyHandle,
    gripper: &Gripper,
    step: &FoundationStep,
    base: &Twist,
) -> Bodies {
    let axis = step.wrist[0].rotation * Vector3::x();
    let mass = f64::from(world.bodies[object].mass());
    let mut loads = Velocities::zeros();
    loads.fixed_rows_mut::<3>(0).copy_from(&step.force);
    loads[2] -= mass * step.gravity;
    let drives = hand.drives(world, gripper, step.grip);
    loads.fixed_rows_mut::<2>(6).copy_from_slice(&drives);
    Bodies {
        time_step: step.time,
        mass,
        inertia: inertia(world.bodies[object].mass_properties()),
        motion: motion(world, hand, object, &axis, base),
        loads,
        axis,
        finger_mass: gripper.finger_mass,
        slide_damping: damping(gripper, step.grip),
        centering: gripper.centering_stiffness,
    }
}

/// Inertia of a body about its centre of mass along the world's axes (kg m²).
fn inertia(properties: &rapier3d::prelude::RigidBodyMassProps) -> Matrix3<f64> {
    let inverse = properties.effective_world_inv_inertia;
    let column = |axis: Vector| units::si_angular(inverse * axis) * units::UNIT.powi(2);
    let inverse = Matrix3::from_columns(&[column(Vector::X), column(Vector::Y), column(Vector::Z)]);
    inverse.try_inverse().unwrap_or_else(Matrix3::zeros)
}

/// Converts a wrench on a pad, in its frame about its origin, to the opposite wrench on the object,
/// in world axes about its centre of mass.
fn on_object(wrench: &Wrench, pad: &Isometry3<f64>, center: &Vector3<f64>) -> Wrench {
    let turn = |v: &Vector3<f64>| -(pad.rotation * v);
    let force = turn(&wrench.force);
    let arm = pad.translation.vector - center;
    Wrench { force, torque: turn(&wrench.torque) + arm.cross(&force) }
}

/// Computes the inverse of [`on_object`].
fn on_pad(wrench: &Wrench, pad: &Isometry3<f64>, center: &Vector3<f64>) -> Wrench {
    let turn = |v: Vector3<f64>| -pad.rotation.inverse_transform_vector(&v);
    let arm = pad.translation.vector - center;
    Wrench { force: turn(wrench.force), torque: turn(wrench.torque - arm.cross(&wrench.force)) }
}

/// Applies forces and torques on the unknowns to Rapier's bodies.
///
/// `sudden` are the other forces on an object that only the pads touch (N), and the duration of the
/// step (s). It gets all of them as one impulse, so that it moves through the step at the velocity
/// that was solved for. Forces would accelerate it from substep to substep: at an acceleration a it
/// would end (n − 1)/2n a h² short of where the gel was solved for, after n substeps in a time h. On
/// the table an impulse would kick it loose from the friction that Rapier balances in each substep.
fn push(
    world: &mut PhysicsWorld,
    hand: &HandBodies,
    object: RigidBodyHandle,
    axis: &Vector3<f64>,
    forces: &Velocities,
    sudden: Option<(Vector3<f64>, f64)>,
) {
    let body = &mut world.bodies[object];
    body.reset_forces(false);
    body.reset_torques(false);
    let (force, torque) = (forces.fixed_rows::<3>(0), forces.fixed_rows::<3>(3) * units::UNIT);
    if let Some((other, time)) = sudden {
        body.add_force(units::vector(&-other), false);
        body.apply_impulse(units::vector(&((force + other) * time)), false);
        body.apply_torque_impulse(units::vector(&(torque * time)), false);
    } else {
        body.add_force(units::vector(&force.into()), false);
        body.add_torque(units::vector(&torque), false);
    }
    for (k, finger) in hand.fingers.iter().enumerate() {
        let force = units::vector(&(axis * forces[6 + k]));
        world.bodies[finger.body].add_force(force, false);
    }
}
