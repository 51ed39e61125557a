//! The frame of a grip: z from the first finger to the second, x along the first finger's width.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use crate::{Error, Result, deformation::Press, geometry::Shape};

/// Two fingers with flat faces, in the object's frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grip {
    /// Poses of the faces, z into the object.
    pub(super) faces: [Isometry3<f64>; 2],
    /// Half of the width and length of a face (m).
    pub(super) half: [f64; 2],
}

impl Grip {
    /// Half-extents of the fingers of a press; an error unless they are two equal cuboids.
    pub(super) fn half_extents(press: &Press) -> Result<Vector3<f64>> {
        match press.shapes() {
            [Shape::Cuboid { half_extents: a }, Shape::Cuboid { half_extents: b }] if a == b => {
                Ok(*a)
            }
            shapes => {
                let found = format!("{} shapes", shapes.len());
                Err(Error::invalid("shapes", found, "two equal cuboids: the fingers"))
            }
        }
    }

    /// Returns the grip of two cuboids at `poses` that press with their sides at +z.
    pub(super) fn of(half_extents: &Vector3<f64>, poses: &[Isometry3<f64>]) -> Self {
        let face = |i: usize| poses[i] * Isometry3::translation(0.0, 0.0, half_extents.z);
        Self { faces: [face(0), face(1)], half: [half_extents.x, half_extents.y] }
    }

    /// Middle between the faces.
    pub(super) fn middle(&self) -> Point3<f64> {
        let [a, b] = self.faces.map(|face| face.translation.vector);
        Point3::from(0.5 * (a + b))
    }

    /// Axes of the grip as rows: the rotation from the object's frame to the grip's.
    pub(super) fn turn(&self) -> Matrix3<f64> {
        let [a, b] = self.faces.map(|face| face.rotation * Vector3::z());
        let z = (a - b).normalize();
        let width = self.faces[0].rotation * Vector3::x();
        let x = (width - z * z.dot(&width)).normalize();
        Matrix3::from_rows(&[x.transpose(), z.cross(&x).transpose(), z.transpose()])
    }

    /// Index of the finger nearer to a place.
    pub(super) fn nearer(&self, place: &Point3<f64>) -> usize {
        let height = self.faces.map(|face| face.inverse_transform_point(place).z.abs());
        usize::from(height[1] < height[0])
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;

    #[test]
    fn its_axis_leads_from_finger_to_finger() {
        let half = Vector3::new(0.01, 0.012, 0.002);
        let flip = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let turn = UnitQuaternion::from_euler_angles(0.3, -0.8, 1.1);
        let away = |z: f64| Isometry3::translation(0.0, 0.0, z);
        let poses = [away(-0.03), away(0.03) * flip].map(|pose| turn * pose);
        let grip = Grip::of(&half, &poses);
        let z = grip.turn() * (turn * Vector3::z());
        assert!((z - Vector3::z()).norm() < 1e-12, "{z}");
        assert!(grip.middle().coords.norm() < 1e-12, "{}", grip.middle());
        assert_eq!(grip.nearer(&(turn * Point3::new(0.0, 0.0, 0.02))), 1);
    }
}
