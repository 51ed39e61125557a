//! Contact of shapes with the walls of a pad: its upright sides, which have no cells.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::{
    contact::PointGroup,
    geometry::{PadOutline, Shape},
};

/// Largest distance between points at which the overlap of shapes and pad is measured (m).
const APART: f64 = 5e-4;

/// Points on the surface of a pad at rest, on its walls and on its face.
pub(super) struct WallContact {
    walls: SurfaceSamples,
    face: SurfaceSamples,
}

/// Points of a surface.
struct SurfaceSamples {
    groups: Vec<PointGroup>,
    /// Outward normal of the surface at each point, as long as the area that the point represents
    /// (m²).
    areas: Vec<Vector3<f64>>,
}

impl WallContact {
    /// Takes points on the surface of a pad.
    pub(super) fn new(outline: &PadOutline) -> Self {
        let middles = |extent: f64| {
            let count = (extent / APART).ceil().max(1.0);
            let middle = move |i: u32| extent * ((f64::from(i) + 0.5) / count - 0.5);
            ((0..count as u32).map(middle), extent / count)
        };
        let [(along_x, dx), (along_y, dy)] = [outline.width, outline.length].map(middles);
        let face = along_x.clone().flat_map(|x| along_y.clone().map(move |y| (x, y)));
        let face = face.map(|(x, y)| {
            let normal = outline.tilt(x, y).column(2).into_owned();
            (Point3::new(x, y, outline.height(x, y)), normal * (dx * dy / normal.z))
        });
        let mut walls = Vec::new();
        let mut column = |x: f64, y: f64, across: Vector3<f64>| {
            let (top, base) = (outline.height(x, y), -outline.thickness);
            let (heights, dz) = middles(top - base);
            let place = |z| Point3::new(x, y, 0.5 * (top + base) + z);
            walls.extend(heights.map(|z| (place(z), across * dz)));
        };
        for side in [1.0, -1.0] {
            let [x, y] = [outline.width, outline.length].map(|extent| 0.5 * side * extent);
            along_y.clone().for_each(|y| column(x, y, Vector3::x() * (side * dy)));
            along_x.clone().for_each(|x| column(x, y, Vector3::y() * (side * dx)));
        }
        Self { walls: SurfaceSamples::new(walls), face: SurfaceSamples::new(face) }
    }

    /// Part that is at the walls of the volume by which shapes overlap the pad at rest, weighted by
    /// how directly they press on its surface there: 0 to 1.
    pub(super) fn share(&self, shapes: &[Shape], poses: &[Isometry3<f64>]) -> f64 {
        let overlap = |samples: &SurfaceSamples| -> f64 {
            let pairs = shapes.iter().zip(poses);
            pairs.map(|(shape, pose)| samples.overlap(shape, pose)).sum()
        };
        let walls = overlap(&self.walls);
        if walls == 0.0 { 0.0 } else { walls / (walls + overlap(&self.face)) }
    }
}

impl SurfaceSamples {
    fn new(points: impl IntoIterator<Item = (Point3<f64>, Vector3<f64>)>) -> Self {
        let (places, areas): (Vec<_>, Vec<_>) = points.into_iter().unzip();
        Self { groups: PointGroup::groups((0..).zip(places)), areas }
    }

    /// Volume by which a shape overlaps the surface, with the cosine between the directions in
    /// which both push the other as a weight (m³).
    fn overlap(&self, shape: &Shape, pose: &Isometry3<f64>) -> f64 {
        let mut sum = 0.0;
        for group in &self.groups {
            let centre = pose.inverse_transform_point(&group.centre);
            if shape.distance(&centre).value >= group.radius {
                continue;
            }
            for (number, place) in group.numbers.iter().zip(&group.places) {
                let found = shape.distance(&pose.inverse_transform_point(place));
                if found.value < 0.0 {
                    let against =
                        -(pose.rotation * found.normal).dot(&self.areas[*number as usize]);
                    sum -= found.value * against.max(0.0);
                }
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::Sensor;

    #[test]
    fn the_share_rises_from_none_in_the_middle_to_all_at_a_wall() {
        let outline = Sensor::named("gelsight-mini").unwrap().outline;
        let contact = WallContact::new(&outline);
        let ball = [Shape::Sphere { radius: 2e-3 }];
        let share =
            |x: f64, y: f64, z: f64| contact.share(&ball, &[Isometry3::translation(x, y, z)]);
        let [x, y] = [0.5 * outline.width, 0.5 * outline.length];
        assert_eq!(share(0.0, 0.0, 1.6e-3), 0.0);
        assert_eq!(share(0.0, 0.0, 2.1e-3), 0.0);
        // Over the rim, over the edge of the wall, beside the wall.
        let top = outline.height(x, 0.0);
        let shares = [0.0, 0.7e-3, 1.6e-3].map(|beyond| share(x + beyond, 0.0, top + 0.9e-3));
        assert!(shares.is_sorted() && shares[0] < 0.3 && shares[2] > 0.5, "{shares:?}");
        assert_eq!(share(0.0, -y - 1.6e-3, -2.5e-3), 1.0);
        // A plane on the whole face reaches over the walls, and does not press on them.
        let half_extents = Vector3::new(2e-2, 2e-2, 1e-2);
        let plane = [Shape::Cuboid { half_extents }];
        assert_eq!(contact.share(&plane, &[Isometry3::translation(0.0, 0.0, 9.5e-3)]), 0.0);
    }

    #[test]
    fn areas_of_samples_are_those_of_the_surfaces() {
        let (width, length, thickness) = (0.02, 0.015, 0.004);
        let contact = WallContact::new(&PadOutline::flat(length, width, thickness));
        let area = |samples: &SurfaceSamples| samples.areas.iter().map(Vector3::norm).sum::<f64>();
        assert!((area(&contact.face) - width * length).abs() < 1e-12);
        let walls = 2.0 * (width + length) * thickness;
        assert!((area(&contact.walls) - walls).abs() < 1e-12);
    }
}
