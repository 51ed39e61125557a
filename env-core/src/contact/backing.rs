//! Held faces of a body: they are rigid, shapes must not enter them, and contact there exerts no
//! force.

use nalgebra::{Isometry3, Point3, Vector3};

use super::{
    groups::{PointGroup, ball},
    leap::runs_through,
};
use crate::{
    Error, Result,
    error::StepDefect,
    geometry::{Distance, Shape},
};

/// Most moves of a shape out of the held faces. A second is needed at a concave side or a corner.
const MOVES: usize = 20;

/// Depth of a point that counts as none (m).
const ROUNDING: f64 = 1e-9;

/// Points on the held faces of a body.
pub struct Backing {
    groups: Vec<PointGroup>,
    /// Ball that contains all points: centre and radius (m).
    ball: (Point3<f64>, f64),
}

impl Backing {
    /// Groups the fixed points at these `places` (m).
    pub fn new(places: impl Iterator<Item = Point3<f64>>) -> Self {
        let groups = PointGroup::groups((0..).zip(places));
        let all: Vec<_> = groups.iter().flat_map(|group| &group.places).copied().collect();
        Self { groups, ball: ball(&all) }
    }

    /// Moves a shape at `pose` that contains points out of the held faces, along its normal at the
    /// deepest point as far as that is deep. A shape that still contains points after a number of
    /// such moves, as if skewered, stays at `pose`.
    pub fn outside(&self, shape: &Shape, pose: &Isometry3<f64>) -> Isometry3<f64> {
        let mut moved = *pose;
        for _ in 0..MOVES {
            let Some(Distance { value, normal }) = self.deepest(shape, &moved) else {
                return moved;
            };
            moved.translation.vector += moved.rotation * normal * value;
        }
        *pose
    }

    /// Distance of the deepest point inside `shape` at `pose`, with the normal in the shape's
    /// frame; `None` if there is none deeper than [`ROUNDING`].
    fn deepest(&self, shape: &Shape, pose: &Isometry3<f64>) -> Option<Distance> {
        let distance = |place| shape.distance(&pose.inverse_transform_point(place));
        let (centre, radius) = &self.ball;
        if distance(centre).value > *radius {
            return None;
        }
        let mut deepest = Distance { value: -ROUNDING, normal: Vector3::zeros() };
        for PointGroup { centre, radius, places, .. } in &self.groups {
            let at_centre = distance(centre).value;
            // From place to place, a distance changes by at most the way between them.
            if at_centre - radius >= deepest.value {
                continue;
            }
            for place in places {
                if at_centre - (place - centre).norm() < deepest.value {
                    let found = distance(place);
                    if found.value < deepest.value {
                        deepest = found;
                    }
                }
            }
        }
        (deepest.value < -ROUNDING).then_some(deepest)
    }

    /// Returns an error if one of the `shapes` contains a point deeper than `most` (m) at its pose
    /// `to`, or moved over one by as much from its pose `from` to there.
    pub fn check(
        &self,
        shapes: &[Shape],
        [from, to]: [&[Isometry3<f64>]; 2],
        most: f64,
    ) -> Result<()> {
        let (mut deepest, mut through) = (0f64, false);
        for (shape, (from, to)) in shapes.iter().zip(from.iter().zip(to)) {
            let gap = |p: &Point3<f64>| shape.distance(p).value;
            let path = |p: &Point3<f64>| [from, to].map(|pose| pose.inverse_transform_point(p));
            let angle = from.rotation.angle_to(&to.rotation);
            for PointGroup { centre, radius, places, .. } in &self.groups {
                let [begin, end] = path(centre);
                let at_centre = gap(&end);
                if at_centre > (1.0 + angle) * radius + (end - begin).norm() {
                    continue;
                }
                for place in places {
                    let [begin, end] = path(place);
                    // A distance changes by at most the distance moved, in time as from place to
                    // place.
                    let moved = (end - begin).norm();
                    if at_centre > (place - centre).norm() + moved {
                        continue;
                    }
                    let ahead = gap(&end);
                    deepest = deepest.max(-ahead);
                    if ahead > moved {
                        continue;
                    }
                    let sunk = gap(&begin).min(0.0);
                    through |= runs_through(gap, &begin, &end, [most - sunk, 0.0]);
                }
            }
        }
        if deepest > most {
            return Err(Error::Penetrated { depth: deepest, most });
        }
        if through {
            return Err(Error::StepTooLong { defect: StepDefect::PassedBacking });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points 0.5 mm apart on a square of 20 mm in the plane z = −4 mm.
    fn plate() -> Backing {
        let along = |i: i32| 5e-4 * f64::from(i);
        let row = |i| (-20..=20).map(move |j| Point3::new(along(i), along(j), -4e-3));
        Backing::new((-20..=20).flat_map(row))
    }

    #[test]
    fn a_shape_is_moved_out_of_held_faces_by_its_depth_in_them() {
        let block = Shape::Cuboid { half_extents: Vector3::repeat(5e-3) };
        let moved = |x: f64, z: f64| {
            let pose = Isometry3::translation(x, 3e-3, z);
            plate().outside(&block, &pose).translation.vector - pose.translation.vector
        };
        let error = (moved(-14.7e-3, -3e-3) - Vector3::new(-3e-4, 0.0, 0.0)).norm();
        assert!(error < 1e-8, "from the side: {error} m");
        let error = (moved(0.0, 2e-4) - Vector3::new(0.0, 0.0, 8e-4)).norm();
        assert!(error < 1e-8, "from the front: {error} m");
        assert_eq!(moved(-15.1e-3, -3e-3), Vector3::zeros(), "beside them");
        assert_eq!(moved(0.0, 1.1e-3), Vector3::zeros(), "in front of them");
    }

    #[test]
    fn a_shape_moved_out_of_held_faces_is_accepted_there() {
        let ring = Shape::Annulus { outer: 12e-3, inner: 8e-3, half_height: 3e-3 };
        let pose = Isometry3::new(Vector3::new(-2e-3, -20e-3, -3e-3), Vector3::new(0.4, 0.3, 0.2));
        let check = |pose| plate().check(std::slice::from_ref(&ring), [&[pose], &[pose]], 2e-5);
        assert!(matches!(check(pose), Err(Error::Penetrated { .. })), "{:?}", check(pose));
        assert_eq!(check(plate().outside(&ring, &pose)), Ok(()));
    }

    #[test]
    fn a_step_that_leads_a_shape_through_held_faces_is_too_long() {
        let ball = [Shape::Sphere { radius: 1e-3 }];
        let path = [2e-3, -9e-3].map(|z| [Isometry3::translation(0.0, 0.0, z)]);
        let found = plate().check(&ball, [&path[0], &path[1]], 2e-5).unwrap_err();
        assert_eq!(found, Error::StepTooLong { defect: StepDefect::PassedBacking });
    }
}
