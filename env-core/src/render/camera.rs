//! Camera of a picture, and its projection.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use crate::{Error, Result, scene::SceneState};

/// Smallest distance along the view axis that is drawn (m).
const NEAR: f64 = 0.01;
/// Largest distance from the eye that is drawn (m).
pub(super) const FAR: f64 = 20.0;

/// Pinhole camera in the world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PinholeCamera {
    /// Position of the pinhole (m).
    pub eye: Point3<f64>,
    /// Point at the middle of the picture (m).
    pub target: Point3<f64>,
    /// Direction that points up in the picture.
    pub up: Vector3<f64>,
    /// Angle between the top and the bottom of the picture (rad).
    pub vertical_fov: f64,
}

impl Default for PinholeCamera {
    /// View from the front right on a gripper that works near the origin.
    fn default() -> Self {
        Self::new([0.30, -0.42, 0.28], [0.0, 0.0, 0.09], 0.60)
    }
}

/// Place from which a scene is seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Viewpoint {
    /// Front right; rises with an object that is lifted.
    #[default]
    Corner,
    /// Front, along y; rises likewise.
    Front,
    /// Right, against x, from higher up, since a finger is in the way; rises likewise.
    Side,
    /// In front of the wrist, down on the fingers; moves with the hand.
    Wrist,
    /// Middle of the palm, between the fingers; moves with the hand.
    Palm,
    /// Camera that stands still.
    Fixed(PinholeCamera),
}

impl Viewpoint {
    /// Viewpoints that have a name, the default first.
    pub const NAMED: [(&'static str, Self); 5] = [
        ("corner", Self::Corner),
        ("front", Self::Front),
        ("side", Self::Side),
        ("wrist", Self::Wrist),
        ("palm", Self::Palm),
    ];

    /// Returns the viewpoint of that name.
    pub fn named(name: &str) -> Result<Self> {
        let known = Self::NAMED.iter().find(|(known, _)| *known == name);
        known.map(|&(_, viewpoint)| viewpoint).ok_or_else(|| {
            let names = Self::NAMED.map(|(name, _)| name).join(", ");
            Error::invalid("camera", name, format!("one of {names}"))
        })
    }

    /// Camera from this viewpoint.
    pub(super) fn camera(&self, state: &SceneState) -> PinholeCamera {
        let rising = |camera: PinholeCamera| camera.raised_to(state.object.pose.translation.z);
        let held = |camera: PinholeCamera| camera.moved(&state.wrist.pose);
        match self {
            Self::Corner => rising(PinholeCamera::default()),
            Self::Front => rising(PinholeCamera::new([0.0, -0.56, 0.21], [0.0, 0.0, 0.09], 0.60)),
            Self::Side => rising(PinholeCamera::new([0.53, 0.0, 0.29], [0.0, 0.0, 0.09], 0.60)),
            Self::Wrist => held(PinholeCamera::new([0.0, -0.10, 0.11], [0.0, 0.02, -0.05], 0.90)),
            Self::Palm => held(PinholeCamera::new([0.0, 0.0, 0.072], [0.0, 0.0, -0.15], 1.10)),
            Self::Fixed(camera) => *camera,
        }
    }
}

/// Camera with the raster onto which it projects.
#[derive(Clone, Debug)]
pub(super) struct View {
    pub(super) eye: Point3<f64>,
    /// Rows: right, up, forward.
    rotation: Matrix3<f64>,
    /// Clip-space units per tangent, along x and y.
    focal: [f64; 2],
    /// Raster size (samples).
    size: [f64; 2],
}

impl PinholeCamera {
    /// Creates a camera at `position` that looks to `target` (m), with z up in the picture, or y if
    /// it looks along z.
    pub fn new(position: [f64; 3], target: [f64; 3], vertical_fov: f64) -> Self {
        let (eye, target) = (Point3::from(position), Point3::from(target));
        let is_vertical = (target - eye).xy().norm() < 1e-6 * (target - eye).norm();
        let up = if is_vertical { Vector3::y() } else { Vector3::z() };
        Self { eye, target, up, vertical_fov }
    }

    fn moved(&self, pose: &Isometry3<f64>) -> Self {
        Self { eye: pose * self.eye, target: pose * self.target, up: pose * self.up, ..*self }
    }

    /// Returns this camera raised so that it does not look up to a point at `height` (m).
    #[must_use]
    fn raised_to(&self, height: f64) -> Self {
        let by = Vector3::z() * (height - self.target.z).max(0.0);
        Self { eye: self.eye + by, target: self.target + by, ..*self }
    }

    /// Returns the view on a raster of `width` × `height` samples, or an error if the viewing
    /// direction or the angle is invalid.
    pub(super) fn view(&self, width: usize, height: usize) -> Result<View> {
        let fov = self.vertical_fov;
        if !(fov > 0.01 && fov < 3.0) {
            let found = format!("{fov} rad");
            return Err(Error::invalid("vertical_fov", found, "0.01 to 3 rad"));
        }
        let rotation = self.rotation().ok_or_else(|| {
            let found = format!("eye {}, target {}, up {:?}", self.eye, self.target, self.up);
            Error::invalid("camera", found, "finite, eye off target, up off the view axis")
        })?;
        let vertical = 1.0 / (0.5 * fov).tan();
        let size = [width as f64, height as f64];
        let focal = [vertical * size[1] / size[0], vertical];
        Ok(View { eye: self.eye, rotation, focal, size })
    }

    fn rotation(&self) -> Option<Matrix3<f64>> {
        let forward = direction(self.target - self.eye)?;
        let right = direction(forward.cross(&direction(self.up)?))?;
        let up = right.cross(&forward);
        Some(Matrix3::from_rows(&[right.transpose(), up.transpose(), forward.transpose()]))
    }
}

fn direction(v: Vector3<f64>) -> Option<Vector3<f64>> {
    let norm = v.norm();
    (norm.is_finite() && norm > 1e-9).then(|| v / norm)
}

impl View {
    /// Map from the frame at `pose` to clip space: x, y, z, w with w the distance along the view
    /// axis (m).
    pub(super) fn clip_from(&self, pose: &Isometry3<f64>) -> impl Fn(&Point3<f64>) -> [f32; 4] {
        let rotation = self.rotation * pose.rotation.to_rotation_matrix().matrix();
        let shift = self.rotation * (pose.translation.vector - self.eye.coords);
        let [fx, fy] = self.focal;
        let (scale, offset) = ((FAR + NEAR) / (FAR - NEAR), -2.0 * FAR * NEAR / (FAR - NEAR));
        move |p| {
            let q = rotation * p.coords + shift;
            [fx * q.x, fy * q.y, scale * q.z + offset, q.z].map(|x| x as f32)
        }
    }

    /// Vector from the eye to the point at sample position (x, y) at unit distance along the view
    /// axis, in the world frame.
    pub(super) fn ray(&self, x: f64, y: f64) -> Vector3<f64> {
        let across = (2.0 * x / self.size[0] - 1.0) / self.focal[0];
        let along = (1.0 - 2.0 * y / self.size[1]) / self.focal[1];
        self.rotation.transpose() * Vector3::new(across, along, 1.0)
    }

    /// Width of a sample at unit distance (m/m).
    pub(super) fn sample_size(&self) -> f64 {
        2.0 / (self.focal[1] * self.size[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_raised_camera_has_what_it_was_raised_to_in_the_middle() {
        let camera = PinholeCamera::default();
        assert_eq!(camera.raised_to(0.05), camera);
        for height in [0.1, 0.25, 1.0] {
            let view = camera.raised_to(height).view(320, 240).unwrap();
            let [x, y, _, w] =
                view.clip_from(&Isometry3::identity())(&Point3::new(0.0, 0.0, height));
            assert!(w > 0.0 && x.abs() < 1e-6 && y.abs() < 1e-6, "{height} m at ({x}, {y})");
        }
    }
}
