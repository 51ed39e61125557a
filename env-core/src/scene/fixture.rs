//! A fixed block with a hole, of the cross-section of a peg.
//!
//! The hole is the intersection of half-planes. Behind each of them stands a box, so contact with
//! the walls is contact of convex solids, which Rapier solves exactly. A round hole is a polygon of
//! 24 sides around the circle: its corners are 0.9 % of the radius farther than its sides.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::{Error, Result, geometry::Shape};

/// Number of sides of a round hole.
const ROUND: usize = 24;

/// A block on the table with an upright hole through it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fixture {
    /// Walls of the hole: direction from its axis (rad from x, about z) and distance (m).
    walls: Vec<[f64; 2]>,
    /// Height of the block (m), which is the depth of the hole.
    pub height: f64,
    /// Thickness of the block beside the hole (m).
    pub margin: f64,
    /// Position of the hole's axis on the table: x and y (m).
    pub place: [f64; 2],
    /// Rotation about the axis (rad).
    pub yaw: f64,
}

impl Fixture {
    /// Creates a fixture in the middle of the table for an upright peg of `shape` in its size,
    /// whose hole is wider than the peg by `clearance` (m) between opposite sides. Only cuboids,
    /// cylinders and prisms are pegs.
    pub fn around(shape: &Shape, clearance: f64, height: f64, margin: f64) -> Result<Self> {
        let gap = 0.5 * clearance;
        let regular = |sides: usize, distance: f64| {
            (0..sides).map(|k| [TAU * k as f64 / sides as f64, distance + gap]).collect()
        };
        let walls = match *shape.sharp() {
            Shape::Cuboid { half_extents: half } => {
                let wall = |k: u32| [0.5 * PI * f64::from(k), half[k as usize % 2] + gap];
                (0..4).map(wall).collect()
            }
            Shape::Cylinder { radius, .. } => regular(ROUND, radius),
            Shape::Prism { sides, radius, .. } => {
                regular(sides as usize, radius * (PI / f64::from(sides)).cos())
            }
            _ => {
                let expected = "a cuboid, cylinder or prism as peg";
                return Err(Error::invalid("objects", shape.name(), expected));
            }
        };
        Ok(Self { walls, height, margin, place: [0.0; 2], yaw: 0.0 })
    }

    /// Pose of the hole's mouth (m): z along the axis, upwards.
    pub fn mouth(&self) -> Isometry3<f64> {
        let place = Translation3::new(self.place[0], self.place[1], self.height);
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.yaw);
        Isometry3::from_parts(place, turn)
    }

    /// Boxes of the block, as poses of their middles and half of their extents (m).
    pub fn boxes(&self) -> Vec<(Isometry3<f64>, Vector3<f64>)> {
        let farthest = self.walls.iter().map(|wall| wall[1]).fold(0.0, f64::max);
        // Neighbours overlap behind the walls, so that the top has no gap.
        let tangent = (PI / self.walls.len() as f64).tan().min(1.0);
        let across = (farthest + self.margin) * tangent;
        let half = Vector3::new(0.5 * self.margin, across, 0.5 * self.height);
        let of = |&[angle, distance]: &[f64; 2]| {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
            let middle = turn * Vector3::new(distance + half.x, 0.0, -half.z);
            (self.mouth() * Isometry3::from_parts(middle.into(), turn), half)
        };
        self.walls.iter().map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    /// Returns whether a place (m) over the table is in the hole's column, at any height.
    fn is_over_hole(fixture: &Fixture, place: &Point3<f64>) -> bool {
        let seen = fixture.mouth().inverse_transform_point(place);
        let inside =
            |&[angle, distance]: &[f64; 2]| seen.x * angle.cos() + seen.y * angle.sin() <= distance;
        fixture.walls.iter().all(inside)
    }

    #[test]
    fn boxes_leave_the_hole_free_and_cover_the_rest() {
        let shapes = [
            Shape::Cuboid { half_extents: Vector3::new(0.006, 0.004, 0.03) },
            Shape::Cylinder { radius: 0.006, half_height: 0.03 },
            Shape::Prism { sides: 6, radius: 0.006, half_height: 0.03 },
        ];
        for shape in shapes {
            let mut fixture = Fixture::around(&shape, 4e-4, 0.02, 0.02).unwrap();
            (fixture.place, fixture.yaw) = ([3e-3, -2e-3], 0.3);
            let boxes = fixture.boxes();
            let solid = |place: &Point3<f64>| {
                boxes.iter().any(|(pose, half)| {
                    let seen = pose.inverse_transform_point(place);
                    (0..3).all(|i| seen[i].abs() < half[i])
                })
            };
            for i in 0..4000 {
                // Golden angle: evenly over a disc of 20 mm.
                let radius = 0.02 * (f64::from(i) / 4000.0).sqrt();
                let angle = f64::from(i) * 2.399_963;
                let place =
                    Point3::new(3e-3 + radius * angle.cos(), -2e-3 + radius * angle.sin(), 0.01);
                let peg = fixture.mouth().inverse_transform_point(&place);
                let inside = shape.distance(&Point3::new(peg.x, peg.y, 0.0)).value;
                assert_eq!(solid(&place), !is_over_hole(&fixture, &place), "{place}");
                assert!(inside > 1.9e-4 || is_over_hole(&fixture, &place), "{place} of {shape:?}");
                assert!(inside < 3.1e-4 || !is_over_hole(&fixture, &place), "{place} of {shape:?}");
            }
        }
        let ball = Shape::Sphere { radius: 0.01 };
        let message = Fixture::around(&ball, 4e-4, 0.02, 0.02).unwrap_err().to_string();
        let expected = "objects: found sphere, expected a cuboid, cylinder or prism as peg";
        assert_eq!(message, expected);
    }
}
