//! Motion of an indenter over the face of a pad, and what it covers of the face.
//!
//! It touches with a drawn orientation at a drawn place, goes down in steps to a drawn depth, and
//! in two of five presses moves on sideways, twists and rolls, with the friction coefficient of the
//! press.

use std::{collections::HashSet, f64::consts::FRAC_PI_4};

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::geometry::{PadOutline, Shape};

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
/// Distance between the places at which the face is searched for the indenter (m), coarse and fine.
const APART: [f64; 2] = [4e-4, 1e-4];
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
        let mut places = face(outline, APART[0]);
        let gap = |places: &[Point3<f64>], z: f64| {
            let pose = at(z);
            let gaps =
                places.iter().map(|p| shape.distance(&pose.inverse_transform_point(p)).value);
            gaps.fold(f64::INFINITY, f64::min)
        };
        // The smallest gap is at most the distance that is left.
        let lower = |places: &[Point3<f64>], mut z: f64| {
            for _ in 0..500 {
                let gap = gap(places, z);
                if gap < 1e-7 {
                    break;
                }
                z -= gap;
            }
            z
        };
        let z = lower(&places, above(shape));
        let pose = at(z + APART[0]);
        let near = |p: &Point3<f64>| shape.distance(&pose.inverse_transform_point(p)).value;
        places.retain(|p| near(p) < 4.0 * APART[0]);
        let around: Vec<_> = places.iter().flat_map(|p| finer(outline, p)).collect();
        let touch = at(lower(&around, z + APART[0]));
        let down = |part: f64| Translation3::new(0.0, 0.0, -part * self.depth) * touch;
        let mut path: Vec<_> = DOWN.iter().map(|part| down(*part)).collect();
        if let Some(([x, y], rotation)) = self.onward {
            let bottom = down(1.0);
            // It turns about the place where it touched first.
            let pose = touch;
            let near = |p: &Point3<f64>| shape.distance(&pose.inverse_transform_point(p)).value;
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

/// Places on the face, `apart` (m) from each other.
fn face(outline: &PadOutline, apart: f64) -> Vec<Point3<f64>> {
    let line = |extent: f64| {
        let count = (extent / apart).ceil() as usize;
        (0..=count).map(move |i| (i as f64 / count as f64 - 0.5) * extent)
    };
    let place = |x: f64, y: f64| Point3::new(x, y, outline.height(x, y));
    line(outline.width).flat_map(|x| line(outline.length).map(move |y| place(x, y))).collect()
}

/// Places on the face around one of those that are [`APART`].
fn finer(outline: &PadOutline, place: &Point3<f64>) -> Vec<Point3<f64>> {
    let count = (APART[0] / APART[1]).ceil() as i32;
    let (x, y) = (place.x, place.y);
    let step = |i: i32| f64::from(i) * APART[1];
    let all = (-count / 2..=count / 2)
        .flat_map(|i| (-count / 2..=count / 2).map(move |j| (x + step(i), y + step(j))));
    let within =
        |(x, y): &(f64, f64)| x.abs() <= 0.5 * outline.width && y.abs() <= 0.5 * outline.length;
    all.filter(within).map(|(x, y)| Point3::new(x, y, outline.height(x, y))).collect()
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
    let ends = [DOWN.len() - 1, DOWN.len() + 1].map(|end| path[last.min(end)]);
    let gap = |p: &Point3<f64>| {
        let gaps = ends.iter().map(|pose| shape.distance(&pose.inverse_transform_point(p)).value);
        gaps.fold(f64::INFINITY, f64::min)
    };
    let coarse = face(outline, APART[0]).into_iter().filter(|p| gap(p) < APART[0]);
    let mut fine: Vec<_> = coarse.flat_map(|p| finer(outline, &p)).collect();
    let least = fine.iter().map(gap).fold(f64::INFINITY, f64::min);
    fine.retain(|p| gap(p) < f64::max(0.0, least + 0.2 * depth));
    let square = |p: &Point3<f64>| [p.x, p.y].map(|x| (x / APART[1]).round() as i64);
    fine.sort_unstable_by_key(square);
    fine.dedup_by_key(|p| square(p));
    let width = width_of(&fine.iter().map(square).collect());
    // Wide contact needs fewer.
    let every = fine.len().div_ceil(4000).max(1);
    (width, fine.into_iter().step_by(every).collect())
}

/// Mean width (m) of a region of `squares` with sides of [`APART`]: four times its area over its
/// perimeter, which is the diameter of a disc and twice the thickness of a ring.
fn width_of(squares: &HashSet<[i64; 2]>) -> f64 {
    let sides = |[x, y]: &[i64; 2]| {
        let around = [[x - 1, *y], [x + 1, *y], [*x, y - 1], [*x, y + 1]];
        around.iter().filter(|square| !squares.contains(*square)).count()
    };
    // Along a smooth boundary there are 4/π times as many sides as it is long, on average.
    let perimeter = FRAC_PI_4 * squares.iter().map(sides).sum::<usize>() as f64;
    4.0 * squares.len() as f64 / perimeter.max(1.0) * APART[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disc_is_as_wide_as_its_diameter_and_a_ring_as_twice_its_thickness() {
        let between = |low: f64, high: f64| {
            let squares = (-60..=60).flat_map(|x| (-60..=60).map(move |y| [x, y]));
            let far = |[x, y]: &[i64; 2]| (*x as f64).hypot(*y as f64);
            squares.filter(|square| (low..high).contains(&far(square))).collect()
        };
        for (low, high, width) in [(0.0, 20.0, 40.0), (0.0, 50.0, 100.0), (40.0, 46.0, 12.0)] {
            let found = width_of(&between(low, high)) / APART[1];
            assert!((found / width - 1.0).abs() < 0.05, "{found} for {width}");
        }
        assert!(width_of(&HashSet::new()) == 0.0);
    }
}
