//! Motion of the kinematic wrist: limits of velocity, acceleration and workspace.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::{Command, SceneConfig, WristState};

impl WristState {
    /// The wrist at rest at `position` (m) and `yaw` (rad).
    pub(super) fn at(position: Vector3<f64>, yaw: f64) -> Self {
        let pose = wrist_pose(&position, yaw);
        Self { pose, yaw, velocity: Vector3::zeros(), yaw_rate: 0.0 }
    }

    /// Returns the wrist after one time step, with limited acceleration, braking in time for the
    /// limits of the workspace.
    pub(super) fn toward(&self, command: &Command, config: &SceneConfig) -> Self {
        let (gripper, dt) = (&config.gripper, config.physics.time_step);
        let position = self.pose.translation.vector;
        let acceleration = gripper.max_acceleration;
        let velocity = Vector3::from_fn(|axis, _| {
            let wanted = command.velocity[axis].clamp(-gripper.max_speed, gripper.max_speed);
            let change = acceleration * dt;
            let v = self.velocity[axis] + (wanted - self.velocity[axis]).clamp(-change, change);
            let brake = |room: f64| (2.0 * acceleration * room.max(0.0)).sqrt();
            v.clamp(
                -brake(position[axis] - config.workspace.low[axis]),
                brake(config.workspace.high[axis] - position[axis]),
            )
        });
        let wanted = command.yaw_rate.clamp(-gripper.max_yaw_rate, gripper.max_yaw_rate);
        let change = gripper.max_yaw_acceleration * dt;
        let yaw_rate = self.yaw_rate + (wanted - self.yaw_rate).clamp(-change, change);
        let position = config.workspace.clamp(&(position + velocity * dt));
        let yaw = PI - (PI - self.yaw - yaw_rate * dt).rem_euclid(TAU);
        Self { pose: wrist_pose(&position, yaw), yaw, velocity, yaw_rate }
    }

    /// Returns the wrist after a move to `target` within `dt` (s).
    pub(super) fn moved_to(&self, target: &Isometry3<f64>, dt: f64) -> Self {
        let turn = target.rotation * self.pose.rotation.inverse();
        Self {
            pose: *target,
            yaw: target.rotation.euler_angles().2,
            velocity: (target.translation.vector - self.pose.translation.vector) / dt,
            yaw_rate: turn.scaled_axis().z / dt,
        }
    }
}

fn wrist_pose(position: &Vector3<f64>, yaw: f64) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    Isometry3::from_parts(Translation3::from(*position), rotation)
}
