//! Soft pads: an elastic foundation of bristles with implicit time integration, in place of
//! Rapier's rigid contact.
//!
//! The face of each pad carries bristles. A bristle inside the object presses along the object's
//! normal and sticks to the object up to Coulomb's limit ([`law`], [`touch`]). The bristle forces
//! are those at the end of a time step ([`balance`]), because forces from its beginning are
//! unstable for any object that a stiff gel can hold. They act on the object and on the finger
//! slides as external forces, on an object that only the pads touch as one impulse; the wrist bears
//! the other components. The pads touch distractors as they touch the object, all of them in one
//! solution; their bristles are those of each body as if it were alone.
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
use rapier3d::prelude::{Collider, PhysicsWorld, RigidBodyHandle, Vector};
use serde::{Deserialize, Serialize};

use super::{
    Fixture, Gripper, ObjectModel, SceneObject, SoftPads,
    gripper::{HandBodies, damping},
    units,
};
use crate::{deformation::Wrench, geometry::Shape};
use balance::{Bodies, Inertia, LoadedBristle, wrench_of};
use correction::Correction;
use law::FoundationLaw;
pub(super) use stops::FixtureContact;
use touch::{BristleAnchor, BristleContact, BristleFace, PlacedObject};

/// Elastic foundations of both pads of a scene.
#[derive(Serialize, Deserialize)]
pub(super) struct Foundations {
    law: FoundationLaw,
    /// Coulomb coefficient between pads and bodies.
    friction: f64,
    /// Sizes of the bodies relative to their models, the object first.
    scales: Vec<f64>,
    pads: [PadFoundation; 2],
    /// Wrench of the fixture on the object in the last step, about its centre of mass.
    fixture: Wrench,
    /// Data derived from settings and object, not part of a saved scene.
    #[serde(skip)]
    surroundings: Option<Surroundings>,
    /// Working memory, kept from step to step to save allocations.
    #[serde(skip)]
    touches: Vec<BristleContact>,
    #[serde(skip)]
    contacts: Vec<LoadedBristle>,
}

/// State of one pad.
#[derive(Clone, Serialize, Deserialize)]
struct PadFoundation {
    /// Contact with each body, the object first.
    contacts: Vec<PadBodyContact>,
    correction: Correction,
}

/// Contact of one pad with one body.
#[derive(Clone, Serialize, Deserialize)]
struct PadBodyContact {
    anchors: Vec<Option<BristleAnchor>>,
    /// Wrench on the pad, in its frame about its origin, in the last step.
    wrench: Wrench,
}

struct Surroundings {
    face: BristleFace,
    /// Bodies in their actual size, the object first, each with the radius of a sphere about the
    /// origin of its frame that contains it (m).
    bodies: Vec<(Shape, f64)>,
    /// Boxes of the fixture, as [`Fixture::boxes`] gives them; none without one.
    blocks: Vec<(Isometry3<f64>, Vector3<f64>)>,
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
    /// `true` for each body, the object first, that touched the table or another body in the last
    /// step.
    pub(super) is_supported: Vec<bool>,
}

/// Contacts and state at the beginning of a step, for [`Foundations::settle`] after it.
pub(super) struct Applied {
    contacts: Vec<LoadedBristle>,
    /// Bodies that the pads can touch, the object first.
    touched: Vec<TouchedBody>,
    bodies: Bodies,
    /// Poses of the pads in the world (m).
    poses: [Isometry3<f64>; 2],
    base: Twist,
}

/// Body that may be touched by a pad.
struct TouchedBody {
    /// Its number, 0 for the object.
    number: usize,
    handle: RigidBodyHandle,
    /// Its centre of mass (m).
    center: Vector3<f64>,
    /// Its poses in the frames of the pads (m).
    seen: [Isometry3<f64>; 2],
    /// Correction wrenches of the fingers on it, about its centre of mass.
    extra: [Wrench; 2],
}

impl PadFoundation {
    /// Wrench on the pad, in its frame about its origin, in the last step.
    fn wrench(&self) -> Wrench {
        let wrenches = self.contacts.iter().map(|contact| contact.wrench);
        wrenches.reduce(|sum, wrench| sum + wrench).unwrap_or_default()
    }

    /// Part of the correction that acts on body number `body`: as large as its part of the normal
    /// force.
    fn correction_of(&self, body: usize) -> Wrench {
        let [all, own] = [self.wrench(), self.contacts[body].wrench].map(|wrench| -wrench.force.z);
        let share = if all > 0.0 { (own / all).clamp(0.0, 1.0) } else { 0.0 };
        let Wrench { force, torque } = self.correction.at(all);
        Wrench { force: share * force, torque: share * torque }
    }
}

impl Foundations {
    /// Creates the elastic foundations of a new scene with these bodies, the object first.
    pub(super) fn new(pads: &SoftPads, bodies: &[&SceneObject], fixture: Option<&Fixture>) -> Self {
        let contact =
            PadBodyContact { anchors: vec![None; BristleFace::COUNT], wrench: Wrench::default() };
        let contacts = vec![contact; bodies.len()];
        let pad = PadFoundation { contacts, correction: Correction::default() };
        let mut foundation = Self {
            law: FoundationLaw::new(pads),
            friction: bodies[0].friction,
            scales: bodies.iter().map(|body| body.scale).collect(),
            pads: [pad.clone(), pad],
            fixture: Wrench::default(),
            surroundings: None,
            touches: Vec::new(),
            contacts: Vec::new(),
        };
        let models: Vec<_> = bodies.iter().map(|body| body.model).collect();
        foundation.attach(pads, &models, fixture);
        foundation
    }

    /// Restores the data that a saved scene does not contain, unless these are not the `models` of
    /// all bodies.
    pub(super) fn attach(
        &mut self,
        pads: &SoftPads,
        models: &[&ObjectModel],
        fixture: Option<&Fixture>,
    ) {
        let sized = |(model, &scale): (&&ObjectModel, &f64)| {
            (model.sampled().scaled(scale), scale * model.radius())
        };
        let bodies: Vec<_> = models.iter().zip(&self.scales).map(sized).collect();
        let face = BristleFace::new(&pads.outline);
        let blocks = fixture.map(Fixture::boxes).unwrap_or_default();
        let is_whole = models.len() == self.scales.len();
        self.surroundings = is_whole.then_some(Surroundings { face, bodies, blocks });
    }

    /// Returns whether the bodies are attached.
    pub(super) fn is_attached(&self) -> bool {
        self.surroundings.is_some()
    }

    /// Wrench of all bodies on a pad in the last step, in the pad's frame about its origin.
    pub(super) fn wrench(&self, finger: usize) -> Wrench {
        self.pads[finger].wrench()
    }

    /// Wrench of the object alone on a pad, likewise.
    pub(super) fn wrench_of_object(&self, finger: usize) -> Wrench {
        self.pads[finger].contacts[0].wrench
    }

    /// Wrench of the fixture on the object in the last step, in the world about the centre of mass.
    pub(super) fn fixture(&self) -> Wrench {
        self.fixture
    }

    /// Points at which the `object`, whose centre of mass is `center` (m), is next to the fixture.
    pub(super) fn stops(&self, object: &Collider, center: &Vector3<f64>) -> Vec<FixtureContact> {
        let blocks = self.surroundings.iter().flat_map(|surroundings| &surroundings.blocks);
        stops::stops(blocks, object, center)
    }

    /// Corrects a finger towards the wrench `model` on its pad, computed by a more accurate model
    /// at `poses` of the bodies in the pad's frame.
    pub(super) fn correct(&mut self, finger: usize, poses: &[Isometry3<f64>], model: &Wrench) {
        let touches = self.all_touches(finger, poses);
        let friction = self.friction;
        self.pads[finger].correction.toward(model, |gain| at_rest(&touches, gain, friction));
    }

    /// Corrects only the normal force of a finger, towards `force` (N); see
    /// [`Foundations::correct`].
    pub(super) fn correct_pressing(&mut self, finger: usize, poses: &[Isometry3<f64>], force: f64) {
        let touches = self.all_touches(finger, poses);
        let friction = self.friction;
        self.pads[finger].correction.press(force, |gain| at_rest(&touches, gain, friction));
    }

    /// Greatest depth of the undeformed face inside the object at `pose` in the pad's frame (m), 0
    /// outside.
    pub(super) fn indentation(&self, finger: usize, pose: &Isometry3<f64>) -> f64 {
        match &self.surroundings {
            Some(surroundings) => {
                let obstacle = surroundings.obstacle(0, pose);
                surroundings.face.indentation(&obstacle, &self.touches(finger, 0, pose))
            }
            None => 0.0,
        }
    }

    fn touches(&self, finger: usize, body: usize, pose: &Isometry3<f64>) -> Vec<BristleContact> {
        let mut touches = Vec::new();
        self.find_touches(finger, body, pose, &mut touches);
        touches
    }

    /// Replaces `touches` by those of a finger with a body at `pose` in the pad's frame.
    fn find_touches(
        &self,
        finger: usize,
        body: usize,
        pose: &Isometry3<f64>,
        touches: &mut Vec<BristleContact>,
    ) {
        touches.clear();
        if let Some(surroundings) = &self.surroundings {
            let obstacle = surroundings.obstacle(body, pose);
            let anchors = &self.pads[finger].contacts[body].anchors;
            surroundings.face.touches(&obstacle, &self.law, anchors, touches);
        }
    }

    /// Touches of a finger with all bodies, at `poses` in the pad's frame.
    fn all_touches(&self, finger: usize, poses: &[Isometry3<f64>]) -> Vec<BristleContact> {
        let of = |(body, pose): (usize, &Isometry3<f64>)| self.touches(finger, body, pose);
        poses.iter().enumerate().flat_map(of).collect()
    }

    /// Applies the foundation's forces of one step to fingers and `solids`, the object first. The
    /// result goes to [`Foundations::settle`] after Rapier has taken the step.
    pub(super) fn apply(
        &mut self,
        world: &mut PhysicsWorld,
        hand: &HandBodies,
        solids: &[RigidBodyHandle],
        gripper: &Gripper,
        step: &FoundationStep,
        stops: &[FixtureContact],
    ) -> Applied {
        let poses = hand.fingers.map(|finger| finger.pad_pose(world));
        let base = Twist::of(&step.wrist, step.time);
        for &handle in solids {
            let solid = &mut world.bodies[handle];
            solid.reset_forces(false);
            solid.reset_torques(false);
        }
        let (touched, mut contacts) = self.touched_bodies(world, solids, &poses, &base);
        let mut bodies = bodies(world, hand, &touched, gripper, step, &base);
        let mut loads = std::mem::take(&mut bodies.loads);
        add_corrections(&mut loads, &bodies, &touched);
        bodies.loads = loads;
        let (mut forces, fixture) = bodies.balance(&mut contacts, stops, self.friction);
        self.fixture = fixture;
        add_corrections(&mut forces, &bodies, &touched);
        let applied = Applied { contacts, touched, bodies, poses, base };
        applied.exert(world, hand, step, &forces);
        applied
    }

    /// Bodies that the pads may touch in a step, the object first, and the bristles inside them.
    fn touched_bodies(
        &mut self,
        world: &PhysicsWorld,
        solids: &[RigidBodyHandle],
        poses: &[Isometry3<f64>; 2],
        base: &Twist,
    ) -> (Vec<TouchedBody>, Vec<LoadedBristle>) {
        let mut touched: Vec<TouchedBody> = Vec::new();
        let mut touches = std::mem::take(&mut self.touches);
        let mut contacts = std::mem::take(&mut self.contacts);
        contacts.clear();
        for (number, &handle) in solids.iter().enumerate() {
            let solid = &world.bodies[handle];
            let pose = units::si_pose(solid.position());
            let seen = poses.map(|pad| pad.inv_mul(&pose));
            let center = units::si_vector(solid.center_of_mass());
            let (body, before, mut extra) = (touched.len(), contacts.len(), [Wrench::default(); 2]);
            for (finger, pose) in poses.iter().enumerate() {
                self.find_touches(finger, number, &seen[finger], &mut touches);
                let (pad, turn) = (&self.pads[finger], &pose.rotation);
                if !touches.is_empty() {
                    extra[finger] = on_object(&pad.correction_of(number), pose, &center);
                }
                contacts.extend(touches.iter().map(|touch| {
                    let place = (pose * Point3::from(touch.place())).coords;
                    let (gain, arm, velocity) =
                        (pad.correction.gain, place - center, base.at(&place));
                    LoadedBristle::new(finger, body, *touch, gain, turn, arm, velocity)
                }));
            }
            if number == 0 || contacts.len() > before {
                touched.push(TouchedBody { number, handle, center, seen, extra });
            }
        }
        self.touches = touches;
        (touched, contacts)
    }

    /// Updates wrenches and anchors from the motion of bodies and fingers in the step.
    pub(super) fn settle(&mut self, world: &PhysicsWorld, hand: &HandBodies, applied: Applied) {
        let Applied { mut contacts, touched, bodies, poses, base } = applied;
        let motion = motion(world, hand, &touched, &bodies.axis, &base);
        let wrenches = bodies.exerted(&mut contacts, &motion, self.friction);
        for (finger, pad) in self.pads.iter_mut().enumerate() {
            for contact in &mut pad.contacts {
                contact.wrench = Wrench::default();
            }
            for (of, wrenches) in touched.iter().zip(&wrenches) {
                let wrench = wrenches[finger] + of.extra[finger];
                pad.contacts[of.number].wrench = on_pad(&wrench, &poses[finger], &of.center);
            }
        }
        self.stick(&contacts, &touched, &poses);
        self.contacts = contacts;
    }

    /// Stores the anchors of the bristles; a pad without contact loses its anchors and its
    /// correction.
    fn stick(
        &mut self,
        contacts: &[LoadedBristle],
        touched: &[TouchedBody],
        poses: &[Isometry3<f64>; 2],
    ) {
        for (finger, pad) in self.pads.iter_mut().enumerate() {
            for contact in &mut pad.contacts {
                contact.anchors.fill(None);
            }
            let mut touching = false;
            for contact in contacts.iter().filter(|contact| contact.finger == finger) {
                let of = &touched[contact.body];
                let stretch = contact.stretch_left(&poses[finger].rotation);
                let anchor = contact.touch.anchor(&stretch, &of.seen[finger]);
                pad.contacts[of.number].anchors[contact.touch.bristle] = Some(anchor);
                touching = true;
            }
            if !touching {
                pad.correction = Correction::default();
            }
        }
    }
}

impl Applied {
    /// Applies the `forces` on the unknowns, from [`Bodies::balance`], to Rapier's bodies and
    /// slides.
    fn exert(
        &self,
        world: &mut PhysicsWorld,
        hand: &HandBodies,
        step: &FoundationStep,
        forces: &[f64],
    ) {
        for (body, of) in self.touched.iter().enumerate() {
            let external = if of.number == 0 { step.force } else { Vector3::zeros() };
            let other = external - Vector3::z() * (self.bodies.inertias[body].mass * step.gravity);
            let is_touched = self.contacts.iter().any(|contact| contact.body == body);
            let only_pads = is_touched && !step.is_supported[of.number];
            let sudden = only_pads.then_some((other, step.time));
            push(world, of.handle, &wrench_of(forces, body), sudden);
        }
        for (finger, force) in hand.fingers.iter().zip(&forces[6 * self.touched.len()..]) {
            let force = units::vector(&(self.bodies.axis * *force));
            world.bodies[finger.body].add_force(force, false);
        }
    }
}

impl Surroundings {
    /// Returns body number `body` at `pose` in a pad's frame.
    fn obstacle(&self, body: usize, pose: &Isometry3<f64>) -> PlacedObject<'_> {
        let (shape, radius) = &self.bodies[body];
        PlacedObject::new(shape, *radius, pose)
    }
}

/// Wrench of touches at rest on their pad, in its frame about its origin.
fn at_rest(touches: &[BristleContact], gain: f64, friction: f64) -> Wrench {
    let force = |touch: &BristleContact| (-touch.at_rest(gain, friction).0, touch.place());
    Wrench::of_forces(touches.iter().map(force))
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
        let bodies = vec![(object.sampled().clone(), object.radius())];
        let face = BristleFace::new(&self.outline);
        let surroundings = Surroundings { face, bodies, blocks: Vec::new() };
        let mut anchors = vec![None; BristleFace::COUNT];
        let mut touches = Vec::new();
        let frame = |pose: &Isometry3<f64>| {
            let obstacle = surroundings.obstacle(0, pose);
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

/// Velocity of the wrist as a rigid motion: of its origin, and angular.
struct Twist {
    origin: Vector3<f64>,
    linear: Vector3<f64>,
    angular: Vector3<f64>,
}

impl Twist {
    fn of(wrist: &[Isometry3<f64>; 2], time: f64) -> Self {
        let [from, to] = wrist;
        let travel = to.translation.vector - from.translation.vector;
        let turn = (to.rotation * from.rotation.inverse()).scaled_axis();
        Self { origin: from.translation.vector, linear: travel / time, angular: turn / time }
    }

    fn at(&self, place: &Vector3<f64>) -> Vector3<f64> {
        self.linear + self.angular.cross(&(place - self.origin))
    }
}

/// Velocities of bodies and slides; those of the slides are relative to a wrist that moves as
/// `base`.
fn motion(
    world: &PhysicsWorld,
    hand: &HandBodies,
    touched: &[TouchedBody],
    axis: &Vector3<f64>,
    base: &Twist,
) -> Vec<f64> {
    let mut motion = Vec::with_capacity(6 * touched.len() + 2);
    for of in touched {
        let solid = &world.bodies[of.handle];
        motion.extend(&units::si_vector(solid.linvel()));
        motion.extend(&units::si_angular(solid.angvel()));
    }
    let slides = hand.slides(world);
    motion.extend(slides.map(|slide| axis.dot(&(slide.velocity - base.at(&slide.place)))));
    motion
}

/// Reads the touched bodies from Rapier, on a wrist that moves as `base`.
fn bodies(
    world: &PhysicsWorld,
    hand: &HandBodies,
    touched: &[TouchedBody],
    gripper: &Gripper,
    step: &FoundationStep,
    base: &Twist,
) -> Bodies {
    let axis = step.wrist[0].rotation * Vector3::x();
    let inertia = |of: &TouchedBody| {
        let solid = &world.bodies[of.handle];
        Inertia { mass: f64::from(solid.mass()), moments: inertia(solid.mass_properties()) }
    };
    let inertias: Vec<_> = touched.iter().map(inertia).collect();
    let mut loads = vec![0.0; 6 * touched.len()];
    loads[..3].copy_from_slice(step.force.as_slice());
    for (body, Inertia { mass, .. }) in inertias.iter().enumerate() {
        loads[6 * body + 2] -= mass * step.gravity;
    }
    loads.extend(hand.drives(world, gripper, step.grip));
    Bodies {
        time_step: step.time,
        inertias,
        motion: motion(world, hand, touched, &axis, base),
        loads,
        axis,
        finger_mass: gripper.finger_mass,
        slide_damping: damping(gripper, step.grip),
        centering: gripper.centering_stiffness,
    }
}

/// Adds the correction wrenches of the fingers to the `forces` on the unknowns.
fn add_corrections(forces: &mut [f64], bodies: &Bodies, touched: &[TouchedBody]) {
    for finger in 0..2 {
        for (body, of) in touched.iter().enumerate() {
            bodies.add(forces, body, finger, &of.extra[finger]);
        }
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

/// Converts a wrench on the object, in world axes about its centre of mass, to the opposite wrench
/// on a pad, in its frame about its origin: the inverse of [`on_object`].
fn on_pad(wrench: &Wrench, pad: &Isometry3<f64>, center: &Vector3<f64>) -> Wrench {
    let turn = |v: Vector3<f64>| -pad.rotation.inverse_transform_vector(&v);
    let arm = pad.translation.vector - center;
    Wrench { force: turn(wrench.force), torque: turn(wrench.torque - arm.cross(&wrench.force)) }
}

/// Applies a `wrench` of the pads about its centre of mass to a body of Rapier.
///
/// `sudden` are the other forces on a body that only the pads touch (N), and the duration of the
/// step (s). It gets all of them as one impulse, so that it moves through the step at the velocity
/// that was solved for. Forces would accelerate it from substep to substep: at an acceleration a it
/// would end (n − 1)/2n a h² short of where the gel was solved for, after n substeps in a time h.
/// On the table an impulse would kick it loose from the friction that Rapier balances in each
/// substep.
fn push(
    world: &mut PhysicsWorld,
    body: RigidBodyHandle,
    wrench: &Wrench,
    sudden: Option<(Vector3<f64>, f64)>,
) {
    let body = &mut world.bodies[body];
    let (force, torque) = (wrench.force, wrench.torque * units::UNIT);
    if let Some((other, time)) = sudden {
        body.add_force(units::vector(&-other), false);
        body.apply_impulse(units::vector(&((force + other) * time)), false);
        body.apply_torque_impulse(units::vector(&(torque * time)), false);
    } else {
        body.add_force(units::vector(&force), false);
        body.add_torque(units::vector(&torque), false);
    }
}
