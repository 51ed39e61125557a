//! The scene: time stepping, state and corrections.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use rapier3d::prelude::{ColliderHandle, Group, PhysicsWorld, RigidBodyHandle, Vector};
use serde::{Deserialize, Serialize};

use super::{
    BodyState, Failure, FingerState, MOST_DISTRACTORS, ObjectModel, Pads, SceneConfig, SceneObject,
    SceneState, WristState, contact,
    foundation::{FixtureContact, FoundationStep, Foundations},
    gripper::{HandBodies, OBJECT},
    setup::{insert_fixture, insert_solid, integration_parameters, table},
    units,
};
use crate::{Error, Result, deformation::Wrench};

/// Command to the hand for one control period.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Command {
    /// Target velocity of the tool centre in the world (m/s).
    pub velocity: Vector3<f64>,
    /// Target yaw rate (rad/s).
    pub yaw_rate: f64,
    /// Grip force of each finger (N), closing if positive.
    pub grip: f64,
}

/// A gripper over a table with a free object, and with distractors if there are any.
#[derive(Serialize, Deserialize)]
pub struct Scene {
    config: SceneConfig,
    world: PhysicsWorld,
    hand: HandBodies,
    object: RigidBodyHandle,
    object_collider: ColliderHandle,
    /// Free bodies beside the object.
    distractors: Vec<(RigidBodyHandle, ColliderHandle)>,
    table: ColliderHandle,
    /// Parts of the fixture, if there is one and the pads are rigid.
    fixture: Vec<ColliderHandle>,
    /// Elastic foundations of soft pads.
    foundation: Option<Foundations>,
    gravity: f64,
    /// The kinematic wrist, kept in double precision.
    wrist: WristState,
    failure: Option<Failure>,
}

impl Scene {
    /// Creates a scene with the open hand at `tool_center` (m) and `yaw` (rad).
    pub fn new(
        config: &SceneConfig,
        object: &SceneObject,
        tool_center: &Vector3<f64>,
        yaw: f64,
    ) -> Result<Self> {
        Self::with_distractors(config, object, &[], tool_center, yaw)
    }

    /// Creates a scene as [`Scene::new`] does, with further free bodies beside the object. The hand
    /// and the object touch them, with the object's coefficient of friction. More than
    /// [`MOST_DISTRACTORS`] are an error.
    pub fn with_distractors(
        config: &SceneConfig,
        object: &SceneObject,
        distractors: &[SceneObject],
        tool_center: &Vector3<f64>,
        yaw: f64,
    ) -> Result<Self> {
        config.validate()?;
        if distractors.len() > MOST_DISTRACTORS {
            let expected = format!("0 to {MOST_DISTRACTORS}");
            return Err(Error::invalid("distractors", distractors.len(), expected));
        }
        let solids: Vec<_> = [object].into_iter().chain(distractors).collect();
        solids.iter().try_for_each(|solid| solid.validate(&config.gripper))?;
        let friction = object.friction;
        let mut world = PhysicsWorld::new();
        world.gravity = Vector::new(0.0, 0.0, -units::scalar(config.physics.gravity));
        world.integration_parameters = integration_parameters(config);
        let wrist = WristState::at(config.workspace.clamp(tool_center), yaw);
        let table = world.colliders.insert(table());
        // Contact with soft pads and contact with a fixture have to be solved together.
        let fixture = config.fixture.as_ref().filter(|_| matches!(config.pads, Pads::Rigid));
        let fixture =
            fixture.map(|fixture| insert_fixture(&mut world, fixture)).unwrap_or_default();
        let foundation = match &config.pads {
            Pads::Rigid => None,
            Pads::Soft(pads) => Some(Foundations::new(pads, &solids, config.fixture.as_ref())),
        };
        // An object that is alone does not need to meet others.
        let others = if distractors.is_empty() { Group::empty() } else { OBJECT };
        let insert = |world: &mut PhysicsWorld, solid| insert_solid(world, solid, friction, others);
        let (object, object_collider) = insert(&mut world, object)?;
        let hand = HandBodies::insert(&mut world, &config.gripper, &config.pads, &wrist.pose);
        let distractors = distractors.iter().map(|solid| insert(&mut world, solid));
        let distractors = distractors.collect::<Result<_>>()?;
        Ok(Self {
            config: config.clone(),
            world,
            hand,
            object,
            object_collider,
            distractors,
            table,
            fixture,
            foundation,
            gravity: config.physics.gravity,
            wrist,
            failure: None,
        })
    }

    /// Applies `command` for one control period. A scene that has failed stays as it is.
    pub fn step(&mut self, command: &Command) {
        self.step_under(command, |_| Vector3::zeros(), |_| ());
    }

    /// Steps as [`Scene::step`] does while a `force` (N), a function of the time since the
    /// beginning of the step (s), acts on the object's centre of mass. `seen` is called with the
    /// scene after each time step.
    pub fn step_under(
        &mut self,
        command: &Command,
        force: impl Fn(f64) -> Vector3<f64>,
        mut seen: impl FnMut(&Self),
    ) {
        for step in 0..self.config.physics.steps() {
            let force = force(step as f64 * self.config.physics.time_step);
            self.advance_to(self.wrist.toward(command, &self.config), command.grip, force);
            seen(self);
        }
    }

    /// Takes one Rapier step in which the wrist moves to `target` (m) under a grip force (N).
    pub fn advance(&mut self, target: &Isometry3<f64>, grip: f64) {
        let wrist = self.wrist.moved_to(target, self.config.physics.time_step);
        self.advance_to(wrist, grip, Vector3::zeros());
    }

    fn advance_to(&mut self, wrist: WristState, grip: f64, force: Vector3<f64>) {
        if self.failure.is_some() {
            return;
        }
        if self.foundation.as_ref().is_some_and(|foundation| !foundation.is_attached()) {
            self.failure = Some(Failure::Detached);
            return;
        }
        self.world.bodies[self.hand.wrist].set_next_kinematic_position(units::pose(&wrist.pose));
        let around = self.foundation.as_ref().map(|foundation| {
            (self.stops(foundation), self.solids().collect::<Vec<_>>(), self.are_supported())
        });
        let gripper = &self.config.gripper;
        self.hand.drive(&mut self.world, gripper, grip);
        let pairs = self.foundation.as_mut().zip(around);
        let applied = pairs.map(|(foundation, (stops, solids, is_supported))| {
            let (time, gravity) = (self.config.physics.time_step, self.gravity);
            let wrist = [self.wrist.pose, wrist.pose];
            let step = FoundationStep { time, gravity, force, wrist, grip, is_supported };
            foundation.apply(&mut self.world, &self.hand, &solids, gripper, &step, &stops)
        });
        if applied.is_none() {
            self.world.bodies[self.object].reset_forces(false);
        }
        self.world.bodies[self.object].add_force(units::vector(&force), false);
        self.world.step();
        if let (Some(foundation), Some(applied)) = (&mut self.foundation, applied) {
            foundation.settle(&self.world, &self.hand, applied);
        }
        self.wrist = wrist;
        if !self.world.quarantine().is_empty() || !self.is_finite() {
            self.failure = Some(Failure::NonFinite);
        }
    }

    /// Current state of the scene.
    pub fn state(&self) -> SceneState {
        let object = &self.world.bodies[self.object];
        let pose = units::si_pose(object.position());
        let origin = Point3::from(pose.translation.vector);
        SceneState {
            wrist: self.wrist,
            fingers: [0, 1].map(|finger| self.finger_state(finger, &pose)),
            table: self.wrench_of(&[self.table], &origin),
            fixture: match &self.foundation {
                Some(foundation) => moved(
                    &foundation.fixture(),
                    &units::si_vector(object.center_of_mass()),
                    &origin,
                ),
                None => self.wrench_of(&self.fixture, &origin),
            },
            object: self.body_state(self.object),
            distractors: self.distractors.iter().map(|(body, _)| self.body_state(*body)).collect(),
            failure: self.failure,
        }
    }

    /// Wrench of `others` on the object about `origin` (m).
    fn wrench_of(&self, others: &[ColliderHandle], origin: &Point3<f64>) -> Wrench {
        let of = |&other| contact::wrench(&self.world, self.object_collider, other, origin);
        others.iter().map(of).fold(Wrench::default(), |sum, wrench| sum + wrench)
    }

    /// Bodies of the object and of the distractors.
    fn solids(&self) -> impl Iterator<Item = RigidBodyHandle> + '_ {
        [self.object].into_iter().chain(self.distractors.iter().map(|(body, _)| *body))
    }

    /// Returns for the object and each distractor whether it touched the table or another of them
    /// in the last step.
    fn are_supported(&self) -> Vec<bool> {
        let distractors = self.distractors.iter().map(|(_, collider)| *collider);
        let solids: Vec<_> = [self.object_collider].into_iter().chain(distractors).collect();
        let touch = |one, other| contact::exists(&self.world, one, other);
        let others = |one| solids.iter().filter(move |other| **other != one);
        let is_supported = |&one: &ColliderHandle| {
            touch(one, self.table) || others(one).any(|&other| touch(one, other))
        };
        solids.iter().map(is_supported).collect()
    }

    fn body_state(&self, body: RigidBodyHandle) -> BodyState {
        let body = &self.world.bodies[body];
        BodyState {
            pose: units::si_pose(body.position()),
            velocity: units::si_vector(body.linvel()),
            angular_velocity: units::si_angular(body.angvel()),
        }
    }

    /// Points at which the fixture is next to the object.
    fn stops(&self, foundation: &Foundations) -> Vec<FixtureContact> {
        let center = units::si_vector(self.world.bodies[self.object].center_of_mass());
        foundation.stops(&self.world.colliders[self.object_collider], &center)
    }

    /// Rotation of the wrist about z (rad).
    pub fn yaw(&self) -> f64 {
        self.wrist.yaw
    }

    /// Poses of the object and then of the distractors in the frame of each pad (m), see
    /// [`FingerState::object`].
    pub fn bodies_in_pads(&self) -> [Vec<Isometry3<f64>>; 2] {
        [0, 1].map(|finger| self.bodies_in_pad(finger))
    }

    fn bodies_in_pad(&self, finger: usize) -> Vec<Isometry3<f64>> {
        let pad = self.hand.fingers[finger].pad_pose(&self.world);
        let seen = |body: RigidBodyHandle| {
            pad.inv_mul(&units::si_pose(self.world.bodies[body].position()))
        };
        self.solids().map(seen).collect()
    }

    fn finger_state(&self, index: usize, object: &Isometry3<f64>) -> FingerState {
        let finger = &self.hand.fingers[index];
        let (position, velocity) = finger.position(&self.world, self.hand.wrist);
        let pad = finger.pad_pose(&self.world);
        let center = Point3::from(pad.translation.vector);
        let rigid = |&other| contact::wrench(&self.world, finger.pad, other, &center);
        let of_object = rigid(&self.object_collider);
        let of_distractors = self.distractors.iter().map(|(_, collider)| rigid(collider));
        let wrench = of_distractors.fold(of_object, |sum, wrench| sum + wrench).seen_from(&pad);
        let of_object = of_object.seen_from(&pad);
        let object = pad.inv_mul(object);
        let (wrench, of_object) = match &self.foundation {
            Some(foundation) => {
                (wrench + foundation.wrench(index), of_object + foundation.wrench_of_object(index))
            }
            None => (wrench, of_object),
        };
        let object_force = -of_object.force.z;
        FingerState { position, velocity, pad, wrench, object_force, object }
    }

    /// Greatest depths of the undeformed faces of soft pads inside the object (m), 0 without
    /// contact and for rigid pads.
    pub fn indentations(&self) -> [f64; 2] {
        let Some(foundation) = &self.foundation else { return [0.0; 2] };
        let object = units::si_pose(self.world.bodies[self.object].position());
        [0, 1].map(|finger| {
            let pad = self.hand.fingers[finger].pad_pose(&self.world);
            foundation.indentation(finger, &pad.inv_mul(&object))
        })
    }

    /// Corrects the elastic foundation of a soft pad towards `model`: the wrench on pad `finger`,
    /// in its frame about its origin (N, N m), that a more accurate model of the gel computes at
    /// the present poses of the object, [`FingerState::object`], and of the distractors.
    ///
    /// To be called once per control step and finger. The foundation then exerts the wrench of the
    /// model, within limits: a factor of 4 on the normal force, half of the normal force sideways,
    /// 3 mm of lever. Rigid pads are unaffected.
    pub fn correct(&mut self, finger: usize, model: &Wrench) {
        let poses = self.bodies_in_pad(finger);
        if let Some(foundation) = &mut self.foundation {
            foundation.correct(finger, &poses, model);
        }
    }

    /// Corrects only the normal force of a soft pad, towards `force` (N); see [`Scene::correct`].
    /// Suits a model without the object's weight: friction stays that of the elastic foundation.
    pub fn correct_pressing(&mut self, finger: usize, force: f64) {
        let poses = self.bodies_in_pad(finger);
        if let Some(foundation) = &mut self.foundation {
            foundation.correct_pressing(finger, &poses, force);
        }
    }

    /// Attaches the models of the object and then of the distractors to a scene that was read from
    /// bytes, which do not contain them. Without all of them a scene with soft pads fails when
    /// stepped.
    pub fn attach(&mut self, models: &[&ObjectModel]) {
        if let (Some(foundation), Pads::Soft(pads)) = (&mut self.foundation, &self.config.pads) {
            foundation.attach(pads, models, self.config.fixture.as_ref());
        }
    }

    /// Settings of the scene.
    pub fn config(&self) -> &SceneConfig {
        &self.config
    }

    /// Sets gravity along −z (m/s²).
    pub fn set_gravity(&mut self, gravity: f64) {
        self.gravity = gravity;
        self.world.gravity = Vector::new(0.0, 0.0, -units::scalar(gravity));
    }

    /// Moves the pads' faces `opening` (m) apart, at rest.
    pub(super) fn open_to(&mut self, opening: f64) {
        self.hand.open_to(&mut self.world, &self.wrist.pose, opening);
    }

    /// Lets the object come to rest under strong damping with the hand away, and returns its
    /// orientation.
    pub(super) fn settle(&mut self, steps: usize) -> UnitQuaternion<f64> {
        let body = &mut self.world.bodies[self.object];
        body.set_angular_damping(3.0);
        body.set_linear_damping(3.0);
        let wrist = self.wrist.pose;
        for _ in 0..steps {
            self.advance(&wrist, -1.0);
        }
        units::si_pose(self.world.bodies[self.object].position()).rotation
    }

    fn is_finite(&self) -> bool {
        let finite = |handle: RigidBodyHandle| {
            let body = &self.world.bodies[handle];
            body.position().is_finite() && body.linvel().is_finite() && body.angvel().is_finite()
        };
        self.solids().all(finite) && self.hand.fingers.iter().all(|finger| finite(finger.body))
    }
}

/// Returns a wrench about `from` (m) as one about `to`.
fn moved(wrench: &Wrench, from: &Vector3<f64>, to: &Point3<f64>) -> Wrench {
    let arm = from - to.coords;
    Wrench { force: wrench.force, torque: wrench.torque + arm.cross(&wrench.force) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{geometry::Shape, scene::SoftPads, sensor::Sensor};

    const HEIGHT: f64 = 0.1;

    fn soft() -> SceneConfig {
        let sensor = Sensor::named("gelsight-mini").unwrap();
        SceneConfig::default().with_pads(SoftPads::new(&sensor, &sensor.calibrations[0]))
    }

    fn ball(radius: f64) -> ObjectModel {
        ObjectModel::new(Shape::Sphere { radius }).unwrap()
    }

    fn at(model: &ObjectModel, x: f64, y: f64, z: f64) -> SceneObject<'_> {
        let pose = Isometry3::translation(x, y, z);
        SceneObject { model, scale: 1.0, mass: 0.05, friction: 0.8, pose }
    }

    /// Scene with these bodies, the object first, around which the hand has closed for a second in
    /// weightlessness.
    fn gripped(config: &SceneConfig, bodies: &[SceneObject], grip: f64) -> Scene {
        let (object, distractors) = bodies.split_first().unwrap();
        let place = Vector3::new(0.0, 0.0, HEIGHT);
        let mut scene = Scene::with_distractors(config, object, distractors, &place, 0.0).unwrap();
        scene.set_gravity(0.0);
        hold(&mut scene, grip, 25);
        scene
    }

    fn hold(scene: &mut Scene, grip: f64, periods: usize) {
        for _ in 0..periods {
            scene.step(&Command { grip, ..Command::default() });
        }
    }

    #[test]
    fn a_distractor_is_felt_as_an_object_is() {
        let (ball, grip) = (ball(0.015), 5.0);
        for config in [soft(), SceneConfig::default()] {
            let here = || at(&ball, 0.0, 0.0, HEIGHT);
            let object = gripped(&config, &[here(), at(&ball, 0.1, 0.1, 0.3)], grip);
            let mut other = gripped(&config, &[at(&ball, 0.1, 0.1, 0.3), here()], grip);
            let (object, state) = (object.state(), other.state());
            let motion = object.object.pose.inv_mul(&state.distractors[0].pose);
            assert!(motion.translation.vector.norm() < 1e-4, "{motion} apart");
            for (one, two) in object.fingers.iter().zip(&state.fingers) {
                let apart = (one.wrench.force - two.wrench.force).norm();
                assert!(apart < 0.05 * grip, "{apart} N of {grip} N apart");
                assert!((one.object_force - one.normal_force()).abs() < 1e-9);
                assert_eq!(two.object_force.abs(), 0.0);
            }
            other.set_gravity(9.81);
            hold(&mut other, grip, 25);
            let fall = HEIGHT - other.state().distractors[0].pose.translation.vector.z;
            assert!(fall < 1e-3, "it fell by {fall} m");
        }
    }

    #[test]
    fn a_grip_of_two_bodies_is_shared() {
        let (ball, grip) = (ball(0.005), 8.0);
        let beside = [-0.006, 0.006].map(|y| at(&ball, 0.0, y, HEIGHT));
        let mut scene = gripped(&soft(), &beside, grip);
        scene.set_gravity(9.81);
        for period in 0..50 {
            hold(&mut scene, grip, 1);
            let state = scene.state();
            assert_eq!(state.failure, None);
            for finger in &state.fingers {
                let force = finger.normal_force();
                assert!((force / grip - 1.0).abs() < 0.05, "{force} N, period {period}");
                let share = finger.object_force / force;
                assert!((share - 0.5).abs() < 0.05, "{share} of it, period {period}");
            }
        }
        let state = scene.state();
        for body in [&state.object, &state.distractors[0]] {
            let fall = HEIGHT - body.pose.translation.vector.z;
            assert!(fall < 1e-3, "it fell by {fall} m");
        }
    }

    #[test]
    fn as_many_bodies_as_there_may_be_are_held_at_once() {
        let (ball, grip) = (ball(0.004), 12.0);
        let places =
            [(-0.005, -0.005), (-0.005, 0.005), (0.005, -0.005), (0.005, 0.005), (0.0, 0.0)];
        // The last is smaller than the gap between the pads and touches nothing.
        let pin = self::ball(0.001);
        let body = |(i, &(y, z)): (usize, &(f64, f64))| {
            at(if i < 4 { &ball } else { &pin }, 0.0, y, HEIGHT + z)
        };
        let bodies: Vec<_> = places.iter().enumerate().map(body).collect();
        let mut scene = gripped(&soft(), &bodies, grip);
        hold(&mut scene, grip, 25);
        let state = scene.state();
        assert_eq!(state.failure, None);
        for finger in &state.fingers {
            let force = finger.normal_force();
            assert!((force / grip - 1.0).abs() < 0.05, "{force} N");
            let share = finger.object_force / force;
            assert!((share - 0.25).abs() < 0.05, "{share} of it");
        }
    }

    #[test]
    fn a_held_object_pushes_a_distractor() {
        let (ball, grip) = (ball(0.015), 5.0);
        for config in [soft(), SceneConfig::default()] {
            // In line along y, on which nothing of the hand is.
            let bodies = [at(&ball, 0.0, 0.0, HEIGHT), at(&ball, 0.0, 0.032, HEIGHT)];
            let mut scene = gripped(&config, &bodies, grip);
            let velocity = Vector3::new(0.0, 0.05, 0.0);
            for _ in 0..25 {
                scene.step(&Command { velocity, grip, ..Command::default() });
            }
            let state = scene.state();
            let apart =
                state.distractors[0].pose.translation.vector - state.object.pose.translation.vector;
            assert!(apart.y > 0.0299, "{apart:?} m apart");
            assert!(state.distractors[0].velocity.y > 0.04, "{:?}", state.distractors[0].velocity);
        }
    }

    #[test]
    fn a_saved_scene_with_distractors_goes_on_bit_for_bit() {
        let (ball, pin) = (ball(0.005), self::ball(0.004));
        let bodies = [at(&ball, 0.0, -0.006, HEIGHT), at(&pin, 0.0, 0.006, HEIGHT)];
        let mut scene = gripped(&soft(), &bodies, 5.0);
        let push = Wrench { force: Vector3::new(0.1, 0.2, -6.0), torque: Vector3::zeros() };
        scene.correct(0, &push);
        let bytes = postcard::to_stdvec(&scene).unwrap();
        let mut lost: Scene = postcard::from_bytes(&bytes).unwrap();
        lost.attach(&[&ball]);
        hold(&mut lost, 5.0, 1);
        assert_eq!(lost.state().failure, Some(Failure::Detached));
        let mut other: Scene = postcard::from_bytes(&bytes).unwrap();
        other.attach(&[&ball, &pin]);
        for step in 0..50 {
            let velocity = Vector3::new(0.1 * f64::from(step).sin(), 0.05, 0.05);
            let command = Command { velocity, yaw_rate: 0.3, grip: 5.0 };
            scene.step(&command);
            other.step(&command);
            assert_eq!(scene.state(), other.state(), "step {step}");
        }
        assert_eq!(postcard::to_stdvec(&scene).unwrap(), postcard::to_stdvec(&other).unwrap());
    }

    #[test]
    fn too_many_distractors_are_refused() {
        let ball = ball(0.01);
        let five: Vec<_> = (1..=5).map(|i| at(&ball, 0.05 * f64::from(i), 0.0, 0.01)).collect();
        let place = Vector3::new(0.0, 0.0, HEIGHT);
        let config = SceneConfig::default();
        let scene =
            Scene::with_distractors(&config, &at(&ball, 0.0, 0.0, 0.01), &five, &place, 0.0);
        let message = scene.err().unwrap().to_string();
        assert_eq!(message, "distractors: found 5, expected 0 to 4");
    }
}
