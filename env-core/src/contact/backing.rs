//! Held faces of a body: they are rigid, shapes must not enter them, and contact there exerts no
//! force.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3, Vector3};

use super::leap::runs_through;
use crate::{Error, Result, geometry::Shape};

/// Side of the cubes in which points are grouped (m).
const BOX: f64 = 3.5e-3;

/// Points on the held faces of a body.
pub struct Backing {
    groups: Vec<PointGroup>,
}

/// Points in one cube.
struct PointGroup {
    centre: Point3<f64>,
    /// Distance of the farthest point from the centre (m).
    radius: f64,
    places: Vec<Point3<f64>>,
}

impl Backing {
    /// Groups the fixed points at these `places` (m).
    pub fn new(places: impl Iterator<Item = Point3<f64>>) -> Self {
        let mut boxes: BTreeMap<[i64; 3], Vec<Point3<f64>>> = BTreeMap::new();
        for place in places {
            let index = [place.x, place.y, place.z].map(|x| (x / BOX).floor() as i64);
            boxes.entry(index).or_default().push(place);
        }
        let group = |places: Vec<Point3<f64>>| {
            let sum = places.iter().map(|p| p.coords).sum::<Vector3<f64>>();
            let centre = Point3::from(sum / places.len() as f64);
            let radius = places.iter().map(|p| (p - centre).norm()).fold(0.0, f64::max);
            PointGroup { centre, radius, places }
        };
        Self { groups: boxes.into_values().map(group).collect() }
    }

    /// Returns an error if one of the `shapes` contains a point deeper than `most` (m) at its pose
    /// `to`, or moved over one by as much from its pose `from` to there. The latter is reported as
    /// a step that has not converged to the `tolerance` (N).
    pub fn check(
        &self,
        shapes: &[Shape],
        [from, to]: [&[Isometry3<f64>]; 2],
        [most, tolerance]: [f64; 2],
    ) -> Result<()> {
        let (mut deepest, mut through) = (0f64, false);
        for (shape, (from, to)) in shapes.iter().zip(from.iter().zip(to)) {
            let gap = |p: &Point3<f64>| shape.distance(p).value;
            let path = |p: &Point3<f64>| [from, to].map(|pose| pose.inverse_transform_point(p));
            let angle = from.rotation.angle_to(&to.rotation);
            for PointGroup { centre, radius, places } in &self.groups {
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
        let missed = Error::NotConverged { iterations: 0, residual: f64::INFINITY, tolerance };
        if through { Err(missed) } else { Ok(()) }
    }
}
