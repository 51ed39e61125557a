//! Scenes that begin with the object in the hand.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::{Command, FingerState, ObjectModel, Scene, SceneConfig, SceneObject, SceneState};
use crate::{Error, Result};

/// Control periods within which the fingers reach any object that fits between them.
const MOST_PERIODS: usize = 50;
/// Fraction of the grip force at which a pad counts as pressing.
const FIRM: f64 = 0.9;
/// Control periods after which a gripped object hangs at rest.
const REST: usize = 8;

/// Clearance between each pad and the object before it is gripped (m).
const GAP: f64 = 5e-4;

impl Scene {
    /// Creates a scene with the pads of the hand, at `tool_center` (m), just clear of the object,
    /// which must have the orientation of [`ObjectModel::in_hand`].
    pub fn around(
        config: &SceneConfig,
        object: &SceneObject,
        tool_center: &Vector3<f64>,
    ) -> Result<Self> {
        let mut scene = Self::new(config, object, tool_center, 0.0)?;
        let opening = object.model.width_in_hand(object.scale) + 2.0 * GAP;
        scene.open_to(opening.min(config.gripper.max_opening));
        Ok(scene)
    }

    /// Creates a scene whose hand, at `tool_center` (m), has gripped the object with `grip` (N); an
    /// [`Error::NotHeld`] if the hand closes on nothing or the object slips out of it.
    ///
    /// The object starts at [`SceneObject::pose`] without gravity. Once both pads press, gravity
    /// acts and the object comes to rest in the hand. `seen` is called with the
    /// scene before the first touch and after each time step, so that the caller can record the
    /// contact history of the pads.
    pub fn holding(
        config: &SceneConfig,
        object: &SceneObject,
        tool_center: &Vector3<f64>,
        grip: f64,
        mut seen: impl FnMut(&Self),
    ) -> Result<Self> {
        let mut scene = Self::around(config, object, tool_center)?;
        scene.set_gravity(0.0);
        seen(&scene);
        let pressed = |state: SceneState| {
            state.fingers.iter().all(|finger| finger.normal_force() > FIRM * grip)
        };
        let closed = (0..MOST_PERIODS).any(|_| {
            scene.hold(grip, 1, &mut seen);
            pressed(scene.state())
        });
        if !closed {
            return Err(Error::NotHeld { grip });
        }
        scene.set_gravity(config.physics.gravity);
        scene.rest_in_hand(grip, seen);
        let is_held = scene.state().fingers.iter().all(FingerState::touches);
        if is_held { Ok(scene) } else { Err(Error::NotHeld { grip }) }
    }

    /// Lets the object come to rest in the hand, which stands still and grips with `grip` (N).
    /// `seen` is called after each time step.
    pub fn rest_in_hand(&mut self, grip: f64, seen: impl FnMut(&Self)) {
        self.hold(grip, REST, seen);
    }

    fn hold(&mut self, grip: f64, periods: usize, mut seen: impl FnMut(&Self)) {
        let command = Command { grip, ..Command::default() };
        for _ in 0..periods {
            self.step_under(&command, |_| Vector3::zeros(), &mut seen);
        }
    }
}

impl ObjectModel {
    /// Pose that brings the frame of the object, scaled by `scale`, to `place` (m), oriented as it
    /// rests on a table and with its narrower side along x.
    pub fn in_hand(&self, scale: f64, place: &Vector3<f64>) -> Isometry3<f64> {
        let rest = self.rest(scale, 0.0, 0.0, 0.0).rotation;
        let [across, along] = self.extents(&rest);
        let yaw = if across <= along { 0.0 } else { FRAC_PI_2 };
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
        Isometry3::from_parts(Translation3::from(*place), turn * rest)
    }

    /// Extent along x of the object in the pose of [`ObjectModel::in_hand`] (m).
    pub fn width_in_hand(&self, scale: f64) -> f64 {
        scale * self.extents(&self.in_hand(scale, &Vector3::zeros()).rotation)[0]
    }

    /// Extents along x and y of the turned model (m).
    fn extents(&self, rotation: &UnitQuaternion<f64>) -> [f64; 2] {
        let turned = self.surface().vertices().iter().map(|v| rotation * v);
        let ends = turned.fold(
            (Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3])),
            |(low, high), v| (low.inf(&v), high.sup(&v)),
        );
        [0, 1].map(|axis| ends.1[axis] - ends.0[axis])
    }
}
