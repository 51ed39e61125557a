//! Motion of an indenter over the face of a pad, and what it covers of the face.
//!
//! It touches with a drawn orientation at a drawn place, goes down in steps to a drawn depth, and
//! in two of five presses moves on sideways, twists and rolls, with the friction coefficient of the
//! press.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::geometry::{COARSE, Footprint, PadOutline, Shape, face, finer, gap};

/// Motion of an indenter, as drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Indentation {
    /// Coefficient of friction.
    pub friction: f64,
    /// Orientation in which it touches.
    pub turn: UnitQuaternion<f64>,
    /// Place of its centre in plan, over the half extents of the pad.
    pub spot: [f64; 2],
    /// Depth (m).
    pub depth: f64,
    /// Sideways motion over the depth, and rotation about the place of touch (rad), after it is
    /// down.
    pub onward: Option<([f64; 2], Vector3<f64>)>,
}

/// Parts of the depth at which frames are taken.
pub(super) const DOWN: [f64; 4] = [0.15, 0.4, 0.7, 1.0];
/// Parts of the onward motion at which frames are taken; the last goes back.
const ONWARD: [f64; 3] = [0.5, 1.0, 0.4];
/// Most frames of a press.
pub(super) const FRAMES: usize = DOWN.len() + ONWARD.len();
/// Coefficients of friction, each as frequent as the others.
pub(super) const FRICTIONS: [f64; 8] = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.0, 2.0];
/// The least and the greatest of them.
pub(super) const FRICTION: [f64; 2] = [0.0, 2.0];
/// Height of its origin at which a drawn indenter is above the face (m).
const ABOVE: f64 = 0.2;

/// Height of an indenter's origin (m) at which all of it is above the face.
fn above(shape: &Shape) -> f64 {
    match shape {
        Shape::Mesh(surface) => {
            surface.vertices().iter().map(|v| v.coords.norm() + 0.02).fold(ABOVE, f64::max)
        }
        _ => ABOVE,
    }
}

impl Indentation {
    /// Pose at first touch, and those of the frames.
    pub(super) fn path(
        &self,
        shape: &Shape,
        outline: &PadOutline,
    ) -> (Isometry3<f64>, Vec<Isometry3<f64>>) {
        let [x, y] = [0.5 * self.spot[0] * outline.width, 0.5 * self.spot[1] * outline.length];
        let at = |z: f64| Isometry3::from_parts(Translation3::new(x, y, z), self.turn);
        let mut places = face(outline, COARSE);
        let least = |places: &[Point3<f64>], z: f64| {
            let pose = at(z);
            places.iter().map(|p| gap(shape, &pose, p)).fold(f64::INFINITY, f64::min)
        };
        // The smallest gap is at most the distance that is left.
        let lower = |places: &[Point3<f64>], mut z: f64| {
            for _ in 0..500 {
                let gap = least(places, z);
                if gap < 1e-7 {
                    break;
                }
                z -= gap;
            }
            z
        };
        let z = lower(&places, above(shape));
        let pose = at(z + COARSE);
        places.retain(|p| gap(shape, &pose, p) < 4.0 * COARSE);
        let around: Vec<_> = places.iter().flat_map(|p| finer(outline, p)).collect();
        let touch = at(lower(&around, z + COARSE));
        let down = |part: f64| Translation3::new(0.0, 0.0, -part * self.depth) * touch;
        let mut path: Vec<_> = DOWN.iter().map(|part| down(*part)).collect();
        if let Some(([x, y], rotation)) = self.onward {
            let bottom = down(1.0);
            // It turns about the place where it touched first.
            let near = |p: &Point3<f64>| gap(shape, &touch, p);
            let pivot = around.iter().min_by(|a, b| near(a).total_cmp(&near(b)));
            let pivot = pivot.map_or(bottom.translation.vector, |p| p.coords);
            path.extend(ONWARD.iter().map(|part| {
                let turn = UnitQuaternion::from_scaled_axis(rotation * *part);
                let moved = Vector3::new(x, y, 0.0) * (self.depth * part);
                Translation3::from(moved + pivot) * turn * Translation3::from(-pivot) * bottom
            }));
        }
        (touch, path)
    }
}

/// Width (m) of what the indenter covers at the deepest and the last of its poses, and places on
/// the face there and beside it.
pub(super) fn covered(
    shape: &Shape,
    path: &[Isometry3<f64>],
    outline: &PadOutline,
    depth: f64,
) -> (f64, Vec<Point3<f64>>) {
    let last = path.len() - 1;
    let ends = [DOWN.len() - 1, DOWN.len() + 1].map(|end| (shape, path[last.min(end)]));
    let found = Footprint::new(outline, &ends, |least| f64::max(0.0, least + 0.2 * depth));
    // Wide contact needs fewer.
    (found.width(), found.places(4000))
}
