//! Check that a parallel gripper reaches a grasp without touching the object elsewhere.
//!
//! Tool frame: the origin midway between the apexes of the pads, x from one to the other, z to the
//! wrist. The hand moves along −z with its pads apart, then they close along x. The swept volume
//! consists of boxes. A box is shown to be free of the solid by distances at the centres of its
//! parts, since a distance changes no faster than the point at which it is measured moves.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, Vector3};

use crate::{
    geometry::{PadOutline, Shape},
    sensor::Sensor,
};

/// Largest distance between the pads of the hand of the rigid scene (m).
pub(crate) const OPENING: f64 = 0.08;
/// Extent of its finger bodies behind their pads, along the grip axis (m).
pub(crate) const FINGER_DEPTH: f64 = 0.010;
/// Height of their tops above the tool centre (m).
pub(crate) const FINGER_TOP: f64 = 0.070;

/// Dimensions of a parallel gripper that matter for collisions.
#[derive(Clone, Debug, PartialEq)]
pub struct Hand {
    /// Undeformed pads, with y along the fingers.
    pub pad: PadOutline,
    /// Largest distance between the apexes of the pads (m).
    pub opening: f64,
    /// Extent of a finger behind its pad (m).
    pub finger_depth: f64,
    /// Height of the palm above the middle of the pads (m).
    pub palm: f64,
}

impl Default for Hand {
    /// The hand of the rigid scene, with the pads of a GelSight Mini.
    fn default() -> Self {
        let sensor = Sensor::named("gelsight-mini").expect("a sensor that is built in");
        Self { pad: sensor.outline, opening: OPENING, finger_depth: FINGER_DEPTH, palm: FINGER_TOP }
    }
}

/// Box in the tool frame, by its lower and upper corner (m).
type Aabb = [Vector3<f64>; 2];

/// Edge length below which a part of a box that is not shown to be free counts as occupied (m).
const RESOLUTION: f64 = 2.5e-4;
/// Numbers of points across and along a pad's face from which the gap to the object is measured.
const FACE_POINTS: [u32; 2] = [9, 11];

impl Hand {
    /// Poses of the two pads' frames, that at −x first, in the frame in which the pose `tool` is
    /// given, with their apexes `apart` (m).
    pub fn pads(tool: &Isometry3<f64>, apart: f64) -> [Isometry3<f64>; 2] {
        [1.0, -1.0].map(|side| {
            let axes = [side * Vector3::y(), Vector3::z(), side * Vector3::x()];
            let turn = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&axes));
            let shift = Translation3::new(-side * 0.5 * apart, 0.0, 0.0);
            tool * Isometry3::from_parts(shift, turn.into())
        })
    }

    /// Greatest depth of the object in a pad's gel (m) beside the apexes when these just touch it
    /// `width` apart, at points distributed over the faces. The pads close from `clearance` (m)
    /// each.
    pub(super) fn intrusion(
        &self,
        shape: &Shape,
        tool: &Isometry3<f64>,
        width: f64,
        clearance: f64,
    ) -> f64 {
        let pads = Self::pads(tool, width + 2.0 * clearance);
        let gaps = pads.iter().flat_map(|pad| {
            let closing = pad * Vector3::z();
            self.face().filter_map(move |point| shape.ray_gap(&(pad * point), &closing))
        });
        clearance - gaps.fold(f64::INFINITY, f64::min)
    }

    /// Points distributed over a pad's face, in its frame (m).
    fn face(&self) -> impl Iterator<Item = Point3<f64>> {
        let even = |i: u32, n: u32, extent: f64| extent * (f64::from(i) / f64::from(n - 1) - 0.5);
        let [across, along] = FACE_POINTS;
        (0..across * along).map(move |i| {
            let x = even(i % across, across, self.pad.width);
            let y = even(i / across, along, self.pad.length);
            Point3::new(x, y, self.pad.height(x, y))
        })
    }

    /// Returns whether the fingers stay clear of the object while the hand moves down past all of
    /// it below `top` (m, tool frame) and the pads close from `clearance` (m) each to `width` (m).
    pub(super) fn fingers_are_free(
        &self,
        shape: &Shape,
        tool: &Isometry3<f64>,
        [width, clearance, top]: [f64; 3],
    ) -> bool {
        let face = 0.5 * width;
        let back = face + clearance + self.pad.thickness + self.finger_depth;
        let finger = |inner: f64, top: f64| {
            let [y, low] = [0.5 * self.pad.width, -0.5 * self.pad.length];
            [Vector3::new(inner, -y, low), Vector3::new(back, y, top.max(-low))]
        };
        let coming = finger(face + clearance, top);
        let closing = finger(face + self.pad.thickness, self.palm.min(top));
        [coming, closing]
            .into_iter()
            .all(|swept| is_free(shape, tool, &swept) && is_free(shape, tool, &mirrored(swept)))
    }

    /// Lowest z of the hand in the frame in which the pose `tool` is given (m), with the pads
    /// `apart` (m).
    pub(super) fn lowest(&self, tool: &Isometry3<f64>, apart: f64) -> f64 {
        let half = Vector3::new(
            0.5 * apart + self.pad.thickness + self.finger_depth,
            0.5 * self.pad.width,
            0.5 * (self.palm + 0.5 * self.pad.length),
        );
        let middle = tool * Point3::new(0.0, 0.0, self.palm - half.z);
        let up = tool.inverse_transform_vector(&Vector3::z()).abs();
        middle.z - up.dot(&half)
    }
}

fn mirrored([low, high]: Aabb) -> Aabb {
    [Vector3::new(-high.x, low.y, low.z), Vector3::new(-low.x, high.y, high.z)]
}

/// Returns whether no point of the box lies in the solid, within [`RESOLUTION`].
fn is_free(shape: &Shape, tool: &Isometry3<f64>, &[low, high]: &Aabb) -> bool {
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    let distance = shape.distance(&(tool * Point3::from(middle))).value;
    if distance > half.norm() {
        return true;
    }
    let longest = half.imax();
    if distance < half.min() || half[longest] < 0.5 * RESOLUTION {
        return false;
    }
    let (mut below, mut above) = (high, low);
    below[longest] = middle[longest];
    above[longest] = middle[longest];
    is_free(shape, tool, &[low, below]) && is_free(shape, tool, &[above, high])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pads_face_each_other() {
        let tool = Isometry3::new(Vector3::new(0.01, 0.02, 0.03), Vector3::new(0.3, -0.2, 0.5));
        let [left, right] = Hand::pads(&tool, 0.04);
        for (pad, side) in [(left, 1.0), (right, -1.0)] {
            let apex = tool.inverse() * pad * Point3::origin();
            assert!((apex.x + side * 0.02).abs() < 1e-15, "apex at {apex}");
            let out = tool.inverse() * pad * Vector3::z();
            assert!((out - side * Vector3::x()).norm() < 1e-15, "out of the gel: {out}");
            let along = tool.inverse() * pad * Vector3::y();
            assert!((along - Vector3::z()).norm() < 1e-15, "along the finger: {along}");
        }
    }

    #[test]
    fn a_box_beside_a_ball_is_free_and_one_that_cuts_it_is_not() {
        let (ball, here) = (Shape::Sphere { radius: 0.02 }, Isometry3::identity());
        let free = |gap: f64| {
            let low = Vector3::new(0.02 + gap, -0.01, -0.01);
            is_free(&ball, &here, &[low, low + Vector3::repeat(0.03)])
        };
        assert!(free(2.0 * RESOLUTION), "clear of the ball by two resolutions");
        assert!(!free(-1e-4), "a face 0.1 mm inside the ball");
    }

    #[test]
    fn a_flat_wall_stands_in_the_gel_by_the_tangent_of_its_tilt() {
        let hand = Hand::default();
        let wall = Shape::Cuboid { half_extents: Vector3::new(0.01, 0.04, 0.04) };
        let tilt: f64 = 0.1;
        let tool = Isometry3::rotation(Vector3::y() * tilt);
        let width = 0.02 / tilt.cos();
        let found = hand.intrusion(&wall, &tool, width, 0.005);
        let exact = hand.face().map(|p| p.z + p.y.abs() * tilt.tan()).fold(0.0, f64::max);
        assert!((found - exact).abs() < 1e-12, "{found} m against {exact} m");
    }
}
