//! Separate parts of a surface, and whether they bound one solid.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};
use thiserror::Error;

use super::Surface;
use crate::{Error, Result};

/// Distance between parts that touch, relative to the size of the surface.
const TOUCHING: f64 = 1e-9;

/// A connected part of a surface, oriented outwards.
struct SurfacePart {
    surface: Surface,
    /// Solid inside, or a cavity: the part was oriented inwards.
    is_solid: bool,
    bounds: (Point3<f64>, Point3<f64>),
}

/// Defect of a surface of several parts, with a place where it is (m).
#[derive(Clone, Copy, Debug, Error, PartialEq)]
enum PartsDefect {
    /// Parts that pass through each other or touch.
    #[error(
        "two of its parts overlap or touch at ({:.4}, {:.4}, {:.4}) m, where sides inside would \
         be felt; join them by a boolean union, as of Blender or trimesh.boolean.union",
        .0.x, .0.y, .0.z
    )]
    Meeting(Point3<f64>),
    /// A solid inside a solid, or a cavity outside of one.
    #[error(
        "its part at ({:.4}, {:.4}, {:.4}) m is a solid in a solid, or a cavity in none; remove \
         it, or reverse its triangles",
        .0.x, .0.y, .0.z
    )]
    Nested(Point3<f64>),
}

impl Surface {
    /// Performs [`Surface::new`] for a surface that bounds one solid, which can touch: parts that
    /// overlap or touch each other are an error, too.
    pub fn of_solid(name: &str, vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Result<Self> {
        let surface = Self::new(name, vertices, triangles)?;
        match defect_of_parts(&surface) {
            Some(defect) => {
                Err(Error::BadMesh { name: name.to_owned(), reason: defect.to_string() })
            }
            None => Ok(surface),
        }
    }
}

/// Returns the first defect found of a closed, consistently oriented surface whose parts do not
/// bound one solid. Distances from it would be those from the nearest side, even one inside.
fn defect_of_parts(surface: &Surface) -> Option<PartsDefect> {
    let parts = parts(surface);
    let near = TOUCHING * surface.size();
    let mut depths = vec![0; parts.len()];
    for (i, part) in parts.iter().enumerate() {
        for other in (0..parts.len()).filter(|&j| j != i).map(|j| &parts[j]) {
            if apart(part, other, near) {
                continue;
            }
            match part.inside(other, near) {
                Ok(false) => {}
                Ok(true) => depths[i] += if other.is_solid { 1 } else { -1 },
                Err(place) => return Some(PartsDefect::Meeting(place)),
            }
        }
    }
    let wrong = parts.iter().zip(depths).find(|(part, depth)| *depth != i32::from(!part.is_solid));
    wrong.map(|(part, _)| PartsDefect::Nested(part.surface.vertices()[0]))
}

/// Returns whether the bounding boxes of two parts are farther apart than `near` (m).
fn apart(part: &SurfacePart, other: &SurfacePart, near: f64) -> bool {
    let ((low, high), (other_low, other_high)) = (part.bounds, other.bounds);
    (0..3).any(|k| low[k] > other_high[k] + near || other_low[k] > high[k] + near)
}

impl SurfacePart {
    /// Returns whether this part lies inside the solid that `other` encloses, or a place at which
    /// they meet within `near` (m).
    fn inside(&self, other: &Self, near: f64) -> std::result::Result<bool, Point3<f64>> {
        let vertices = self.surface.vertices();
        let mut sides = [false; 2];
        let middle = |corners: &[u32; 3]| {
            let sum = corners.iter().map(|&i| vertices[i as usize].coords).sum::<Vector3<f64>>();
            Point3::from(sum / 3.0)
        };
        let middles = self.surface.triangles().iter().map(middle);
        for place in vertices.iter().copied().chain(middles) {
            let distance = other.surface.distance(&place).value;
            sides[usize::from(distance < 0.0)] = true;
            if distance.abs() <= near || sides == [true; 2] {
                return Err(place);
            }
        }
        if sides[1] {
            return Ok(true);
        }
        for [a, b, c] in self.surface.triangles() {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                let from = vertices[*from as usize];
                let edge = vertices[*to as usize] - from;
                let (length, direction) = (edge.norm(), edge.normalize());
                let gap = other.surface.ray_gap(&from, &direction);
                if let Some(gap) = gap.filter(|gap| *gap < length) {
                    return Err(from + direction * gap);
                }
            }
        }
        Ok(false)
    }
}

/// Connected parts of a surface.
fn parts(surface: &Surface) -> Vec<SurfacePart> {
    let (vertices, triangles) = (surface.vertices(), surface.triangles());
    // Each vertex leads to another of its part, and in the end to the one that stands for the part.
    let mut leads: Vec<u32> = (0..vertices.len() as u32).collect();
    for &[a, b, c] in triangles {
        let first = end(&mut leads, a);
        for other in [b, c] {
            let other = end(&mut leads, other);
            leads[other as usize] = first;
        }
    }
    let mut by_part = BTreeMap::<u32, Vec<[u32; 3]>>::new();
    for triangle in triangles {
        by_part.entry(end(&mut leads, triangle[0])).or_default().push(*triangle);
    }
    if by_part.len() == 1 {
        return Vec::new();
    }
    by_part.into_values().map(|triangles| part(vertices, &triangles)).collect()
}

/// Number at the end of a chain, which is shortened on the way.
fn end(leads: &mut [u32], mut vertex: u32) -> u32 {
    while leads[vertex as usize] != vertex {
        leads[vertex as usize] = leads[leads[vertex as usize] as usize];
        vertex = leads[vertex as usize];
    }
    vertex
}

fn part(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> SurfacePart {
    let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let number = |i: u32| used.binary_search(&i).expect("corners are used") as u32;
    let corners = triangles.iter().map(|corners| corners.map(number));
    let places = used.iter().map(|&i| vertices[i as usize]).collect::<Vec<_>>();
    let outward = Surface::from_parts(places.clone(), corners.clone().collect());
    let is_solid = outward.mass_properties(1.0).mass > 0.0;
    let surface = if is_solid {
        outward
    } else {
        Surface::from_parts(places, corners.map(|[a, b, c]| [a, c, b]).collect())
    };
    SurfacePart { bounds: surface.bounds(), surface, is_solid }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(half: [f64; 3], middle: [f64; 3]) -> Surface {
        Surface::cuboid(&half.into()).moved(&middle.into())
    }

    /// The surfaces as one, the last turned inwards if it is a `cavity`.
    fn together(surfaces: &[Surface], cavity: bool) -> Surface {
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        for (k, surface) in surfaces.iter().enumerate() {
            let first = vertices.len() as u32;
            let turned = cavity && k + 1 == surfaces.len();
            let corners = |&[a, b, c]: &[u32; 3]| if turned { [a, c, b] } else { [a, b, c] };
            triangles.extend(surface.triangles().iter().map(|t| corners(t).map(|i| i + first)));
            vertices.extend_from_slice(surface.vertices());
        }
        Surface::from_parts(vertices, triangles)
    }

    #[test]
    fn parts_that_bound_one_solid_have_no_defect() {
        let (large, small) = (block([3e-2; 3], [0.0; 3]), block([1e-2; 3], [0.0; 3]));
        let beside = block([1e-2; 3], [5e-2, 0.0, 0.0]);
        assert_eq!(defect_of_parts(&large), None);
        assert_eq!(defect_of_parts(&together(&[large.clone(), beside.clone()], false)), None);
        assert_eq!(defect_of_parts(&together(&[large.clone(), small.clone()], true)), None);
        // A ring round a rod.
        let ring = [[2e-2, -1e-2], [3e-2, -1e-2], [3e-2, 1e-2], [2e-2, 1e-2], [2e-2, -1e-2]];
        let ring = Surface::revolved(&ring, 24, 0.0);
        assert_eq!(defect_of_parts(&together(&[ring, small.clone()], false)), None);
        // A stone in a hollow.
        let stone = block([2e-3; 3], [0.0; 3]);
        assert_eq!(defect_of_parts(&together(&[large, stone, small], true)), None);
    }

    #[test]
    fn parts_that_overlap_cross_touch_or_hide_in_each_other_are_found() {
        let bar = |axis: usize| {
            let mut half = [4e-3; 3];
            half[axis] = 2e-2;
            block(half, [0.0; 3])
        };
        let meeting = [
            // Halves that overlap, bars that cross with all corners outside of the other, halves
            // that touch.
            [block([4e-3, 3e-3, 3e-3], [-2e-3, 0.0, 0.0]), block([4e-3; 3], [2e-3, 0.0, 0.0])],
            [bar(0), bar(1).moved(&Vector3::new(1e-4, 2e-4, 3e-4))],
            [block([4e-3; 3], [-4e-3, 0.0, 0.0]), block([4e-3, 3e-3, 2e-3], [4e-3, 1e-4, 0.0])],
        ];
        for [a, b] in meeting {
            for pair in [[a.clone(), b.clone()], [b, a]] {
                let found = defect_of_parts(&together(&pair, false));
                assert!(matches!(found, Some(PartsDefect::Meeting(_))), "{found:?}");
            }
        }
        let (large, small) = (block([3e-2; 3], [0.0; 3]), block([1e-2; 3], [1e-3, 0.0, 0.0]));
        let found = defect_of_parts(&together(&[large.clone(), small], false));
        assert!(matches!(found, Some(PartsDefect::Nested(_))), "{found:?}");
        let beside = block([1e-2; 3], [5e-2, 0.0, 0.0]);
        let found = defect_of_parts(&together(&[large, beside], true));
        assert!(matches!(found, Some(PartsDefect::Nested(_))), "{found:?}");
    }
}
