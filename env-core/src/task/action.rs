//! Actions: five numbers in [−1, 1].

use nalgebra::Vector3;

use crate::scene::{Command, Gripper};

/// Wrist velocity along x, y, z, yaw rate, grip force.
pub const ACTION_SIZE: usize = 5;

/// The command that `action` stands for: each component scaled by the gripper's limit. Components
/// outside [−1, 1] count as the nearer bound.
pub fn command(action: &[f32; ACTION_SIZE], gripper: &Gripper) -> Command {
    let [x, y, z, yaw, grip] = action.map(|a| f64::from(a).clamp(-1.0, 1.0));
    Command {
        velocity: Vector3::new(x, y, z) * gripper.max_speed,
        yaw_rate: yaw * gripper.max_yaw_rate,
        grip: grip * gripper.max_force,
    }
}
