//! Conversion between SI and Rapier's decimetres: lengths ×10, forces ×10, torques ×100. Masses,
//! times, angles, and stiffness and damping of a motor (force over length) are unchanged.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rapier3d::math::{Pose, Rotation, Vector};

/// Decimetres per metre.
pub(super) const UNIT: f64 = 10.0;

/// Converts a length (m), velocity (m/s) or force (N) to Rapier's unit.
pub(super) fn scalar(si: f64) -> f32 {
    (si * UNIT) as f32
}

/// Converts a vector of lengths, velocities or forces to Rapier's unit.
pub(super) fn vector(si: &Vector3<f64>) -> Vector {
    Vector::new(scalar(si.x), scalar(si.y), scalar(si.z))
}

/// Converts a pose (m) to Rapier's unit.
pub(super) fn pose(si: &Isometry3<f64>) -> Pose {
    Pose::from_parts(vector(&si.translation.vector), rotation(&si.rotation))
}

/// Converts a rotation to Rapier's quaternion.
pub(super) fn rotation(si: &UnitQuaternion<f64>) -> Rotation {
    let q = si.as_ref();
    Rotation::from_xyzw(q.i as f32, q.j as f32, q.k as f32, q.w as f32).normalize()
}

/// Converts a length, velocity or force from Rapier's unit to SI.
pub(super) fn si(length: f32) -> f64 {
    f64::from(length) / UNIT
}

/// Converts a vector of lengths, velocities or forces from Rapier's unit to SI.
pub(super) fn si_vector(v: Vector) -> Vector3<f64> {
    si_angular(v) / UNIT
}

/// Converts a vector without length unit (rad/s) from Rapier's type.
pub(super) fn si_angular(v: Vector) -> Vector3<f64> {
    Vector3::new(f64::from(v.x), f64::from(v.y), f64::from(v.z))
}

/// Converts a pose from Rapier's unit to SI.
pub(super) fn si_pose(pose: &Pose) -> Isometry3<f64> {
    let q = pose.rotation;
    let q = Quaternion::new(f64::from(q.w), f64::from(q.x), f64::from(q.y), f64::from(q.z));
    let translation = Translation3::from(si_vector(pose.translation));
    Isometry3::from_parts(translation, UnitQuaternion::from_quaternion(q))
}
