//! State of the rigid world after a step, in SI and without Rapier types.

use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

use crate::deformation::Wrench;

/// State of a scene: everything that tasks, sensors and rendering read.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneState {
    /// The wrist.
    pub wrist: WristState,
    /// The finger on the wrist's −x side, then the one on +x.
    pub fingers: [FingerState; 2],
    /// The free object.
    pub object: BodyState,
    /// Other free bodies on the table, if there are any.
    pub distractors: Vec<BodyState>,
    /// Wrench of the table on the object, in the world frame about the object's origin.
    pub table: Wrench,
    /// Wrench of the fixture on the object, likewise; 0 without a fixture.
    pub fixture: Wrench,
    /// Reason why the scene stopped, if it did; the other fields then hold the last finite state.
    pub failure: Option<Failure>,
}

/// Pose and velocity of the tool centre.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WristState {
    /// Pose of the wrist frame, origin at the tool centre (m).
    pub pose: Isometry3<f64>,
    /// Rotation about z (rad), in (−π, π].
    pub yaw: f64,
    /// Velocity of the tool centre (m/s).
    pub velocity: Vector3<f64>,
    /// Rate of yaw (rad/s).
    pub yaw_rate: f64,
}

/// One finger and its pad.
///
/// The pad's frame has its origin at the centre of the undeformed face, z out of the gel towards
/// the other finger, y along the finger (the wrist's z) and x across it.
#[derive(Clone, Debug, PartialEq)]
pub struct FingerState {
    /// Distance of the pad face from the tool centre (m), 0 when closed.
    pub position: f64,
    /// Rate of `position` (m/s), negative when closing.
    pub velocity: f64,
    /// Pose of the pad's frame in the world (m).
    pub pad: Isometry3<f64>,
    /// Wrench of all bodies on the pad, in the pad's frame about its origin.
    pub wrench: Wrench,
    /// Part of the object in the normal force on the pad (N), positive in compression; all of it
    /// without distractors.
    pub object_force: f64,
    /// Pose of the object's frame in the pad's frame (m), which is that of
    /// [`crate::geometry::PadMesh`].
    pub object: Isometry3<f64>,
}

impl FingerState {
    /// Normal force on the pad (N), positive in compression.
    pub fn normal_force(&self) -> f64 {
        -self.wrench.force.z
    }

    /// Returns whether anything exerted a force on the pad in the last step.
    pub fn touches(&self) -> bool {
        self.wrench != Wrench::default()
    }
}

/// Pose and velocity of a rigid body.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyState {
    /// Pose of the body's frame (m).
    pub pose: Isometry3<f64>,
    /// Velocity of the centre of mass (m/s).
    pub velocity: Vector3<f64>,
    /// Angular velocity (rad/s).
    pub angular_velocity: Vector3<f64>,
}

/// Reason why a scene can no longer be stepped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Failure {
    /// A pose or velocity became infinite or not a number, and Rapier froze the body.
    NonFinite,
    /// A scene with soft pads was read from bytes and not given its bodies by
    /// [`super::Scene::attach`].
    Detached,
}

impl SceneState {
    /// Distance between the pad faces (m).
    pub fn opening(&self) -> f64 {
        self.fingers[0].position + self.fingers[1].position
    }

    /// Pose of the object's frame in the wrist's frame, whose origin is the tool centre (m).
    pub fn object_in_wrist(&self) -> Isometry3<f64> {
        self.wrist.pose.inv_mul(&self.object.pose)
    }
}
