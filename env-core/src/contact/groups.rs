//! Points grouped by the cubes in which they lie, so that those far from a shape are passed over
//! together.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

/// Side of the cubes (m).
const SIDE: f64 = 3.5e-3;

/// Points in one cube, in a ball around them.
pub struct PointGroup {
    /// Mean of the points.
    pub centre: Point3<f64>,
    /// Distance of the farthest of them from the centre (m).
    pub radius: f64,
    /// The points, by their numbers.
    pub numbers: Vec<u32>,
    /// Their positions (m).
    pub places: Vec<Point3<f64>>,
}

impl PointGroup {
    /// Groups numbered points.
    pub fn groups(points: impl IntoIterator<Item = (u32, Point3<f64>)>) -> Vec<Self> {
        let mut cubes = BTreeMap::<[i64; 3], (Vec<u32>, Vec<Point3<f64>>)>::new();
        for (number, place) in points {
            let key = <[f64; 3]>::from(place.coords).map(|x| (x / SIDE).floor() as i64);
            let (numbers, places) = cubes.entry(key).or_default();
            numbers.push(number);
            places.push(place);
        }
        let group = |(numbers, places): (Vec<u32>, Vec<Point3<f64>>)| {
            let (centre, radius) = ball(&places);
            Self { centre, radius, numbers, places }
        };
        cubes.into_values().map(group).collect()
    }
}

/// Mean of the `places` and distance of the farthest from it (m); the radius is below zero if there
/// are none.
pub(super) fn ball(places: &[Point3<f64>]) -> (Point3<f64>, f64) {
    let sum = places.iter().map(|p| p.coords).sum::<Vector3<f64>>();
    let centre = Point3::from(sum / places.len().max(1) as f64);
    let radius = places.iter().map(|p| (p - centre).norm()).fold(f64::NEG_INFINITY, f64::max);
    (centre, radius)
}
