//! Actions: five numbers in [−1, 1].

use nalgebra::{Rotation3, Vector3};

use super::TaskConfig;
use crate::scene::Command;

/// Number of components of an action: wrist velocity along the wrist's x, y and z, yaw rate, grip
/// force.
pub const ACTION_SIZE: usize = 5;

/// Converts `action` to a command for a wrist turned by `yaw` (rad): each component is scaled by
/// the gripper's limit. The grip force starts from `before` (N) and moves towards its target at the
/// gripper's greatest rate, or changes by a factor if the task has a [`super::GradualGrip`].
/// Components outside [−1, 1] count as the nearer bound.
pub fn command(action: &[f32; ACTION_SIZE], config: &TaskConfig, yaw: f64, before: f64) -> Command {
    let gripper = &config.scene.gripper;
    let [x, y, z, yaw_rate, grip] = action.map(|a| f64::from(a).clamp(-1.0, 1.0));
    let time = config.scene.physics.control_period;
    let (most, change) = (gripper.max_force, gripper.max_force_rate * time);
    Command {
        velocity: Rotation3::from_axis_angle(&Vector3::z_axis(), yaw)
            * Vector3::new(x, y, z)
            * gripper.max_speed,
        yaw_rate: yaw_rate * gripper.max_yaw_rate,
        grip: config.task.gradual_grip().map_or_else(
            || before + (grip * most - before).clamp(-change, change),
            |gradual| gradual.changed(before, grip, time, most),
        ),
    }
}
