//! Actions: five numbers in [−1, 1].

use nalgebra::Vector3;

use super::Config;
use crate::scene::Command;

/// Wrist velocity along x, y, z, yaw rate, grip force.
pub const ACTION_SIZE: usize = 5;

/// The command that `action` stands for: each component scaled by the gripper's limit, but for a grip
/// that closes by factors, which changes that of `before` (N). Components outside [−1, 1] count as the
/// nearer bound.
pub fn command(action: &[f32; ACTION_SIZE], config: &Config, before: f64) -> Command {
    let gripper = &config.scene.gripper;
    let [x, y, z, yaw, grip] = action.map(|a| f64::from(a).clamp(-1.0, 1.0));
    let time = config.scene.physics.control_period;
    let most = gripper.max_force;
    Command {
        velocity: Vector3::new(x, y, z) * gripper.max_speed,
        yaw_rate: yaw * gripper.max_yaw_rate,
        grip: (config.closing.as_ref())
            .map_or(grip * most, |c| c.changed(before, grip, time, most)),
    }
}
