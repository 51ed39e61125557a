//! Check that the gripper reaches a sampled grasp without touching the object on its way.
//!
//! The grasps of a dataset are sampled by distances ([`crate::objects::GraspSampler`]); here Rapier
//! moves the hand to one. The object floats without gravity, so any contact moves it. The hand
//! descends along its fingers, opened as far as the sampler requires, then closes until both pads
//! touch.

use std::fmt;

use nalgebra::{Isometry3, Vector3};

use super::{ObjectModel, Physics, Scene, SceneConfig, SceneObject, Workspace};
use crate::{Result, objects::FINGER_TOP};

/// Reason why the hand does not reach a grasp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ApproachFailure {
    /// The hand touched the object on its way down.
    Coming,
    /// A finger touched the object before the pads did while they closed.
    Closing,
    /// The pads closed and did not both touch the object.
    Missed,
}

impl fmt::Display for ApproachFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Coming => "the hand meets the object on its way to the grasp",
            Self::Closing => "a finger meets the object before the pads do",
            Self::Missed => "the pads close and do not both touch the object",
        })
    }
}

/// Check of grasps of one object by a simulated hand.
#[derive(Clone, Debug)]
pub struct Approach {
    model: ObjectModel,
    config: SceneConfig,
    /// Clearance of each pad before it touches (m).
    clearance: f64,
}

/// Height of a grasp above the table (m), more than the reach of hand and object.
const HEIGHT: f64 = 0.5;
/// Speed of the hand (m/s): 1 mm per step.
const SPEED: f64 = 0.25;
/// Displacement of the object above which it counts as touched (m). Single precision resolves 3e-8
/// m there.
const TOUCHED: f64 = 1e-6;
/// Grip force while closing (N).
const GRIP: f64 = 2.0;
/// Longest closing time, relative to the time in which a pad covers its clearance.
const PATIENCE: f64 = 4.0;

impl Approach {
    /// Creates a check of grasps of `model`, with pads that stand `clearance` (m) off the contacts
    /// until they close.
    pub fn new(model: ObjectModel, clearance: f64) -> Self {
        let config = SceneConfig {
            physics: Physics { gravity: 0.0, ..Physics::default() },
            workspace: Workspace { low: [-1.0, -1.0, 0.1], high: [1.0; 3] },
            ..SceneConfig::default()
        };
        Self { model, config, clearance }
    }

    /// Returns the reason why the hand does not reach a grasp, or `None` if it does. The grasp's
    /// tool frame, with x from pad to pad and z towards the wrist, is at `tool` in the object's
    /// frame; its contacts are `width` (m) apart. An error if the hand cannot open so wide.
    pub fn obstacle(&self, tool: &Isometry3<f64>, width: f64) -> Result<Option<ApproachFailure>> {
        let mut config = self.config.clone();
        config.gripper.max_opening = width + 2.0 * self.clearance;
        let goal = Isometry3::translation(0.0, 0.0, HEIGHT);
        let pose = goal * tool.inverse();
        let object = SceneObject { model: &self.model, scale: 1.0, mass: 0.1, friction: 1.0, pose };
        let descent = FINGER_TOP + config.gripper.pad_length;
        let above = Vector3::new(0.0, 0.0, HEIGHT + descent);
        let mut scene = Scene::new(&config, &object, &above, 0.0)?;
        let moved = |scene: &Scene| {
            let now = scene.state().object.pose.translation.vector;
            (now - pose.translation.vector).norm() > TOUCHED
        };
        let dt = config.physics.time_step;
        let steps = (descent / (SPEED * dt)).ceil();
        for step in 1..=steps as u32 {
            let left = descent * (1.0 - f64::from(step) / steps);
            scene.advance(&(goal * Isometry3::translation(0.0, 0.0, left)), -GRIP);
            if moved(&scene) {
                return Ok(Some(ApproachFailure::Coming));
            }
        }
        let steps = PATIENCE * self.clearance / (config.gripper.closing_speed * dt);
        // A pad that has touched pushes the object and may lose contact for a moment.
        let mut touched = [false; 2];
        for _ in 0..steps.ceil() as u32 {
            scene.advance(&goal, GRIP);
            let fingers = scene.state().fingers;
            touched = [0, 1].map(|i| touched[i] || fingers[i].touches());
            match touched {
                [true, true] => return Ok(None),
                [false, false] if moved(&scene) => return Ok(Some(ApproachFailure::Closing)),
                _ => {}
            }
        }
        Ok(Some(ApproachFailure::Missed))
    }
}
