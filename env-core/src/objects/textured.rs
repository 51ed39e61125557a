//! Solids that touch at many small places: a ball with bumps, a cylinder with grooves, a box with
//! pyramids.
//!
//! They are meshes. The height of bumps, ribs and pyramids is a few per cent to a third of their
//! size.

use std::sync::Arc;

use nalgebra::{Point3, Unit, Vector3};

use super::{SEGMENTS, draw::Draw};
use crate::geometry::{Shape, Surface};

/// Directions from which that of a bump is chosen.
const CANDIDATES: usize = 10;
/// Pieces of the outline of a round rib.
const PIECES: u32 = 8;

/// An ellipsoid, flattened along x and covered by 30 to 80 caps of balls.
pub(super) fn raspberry(draw: &mut Draw) -> Shape {
    let width = draw.spread(0.012, 0.020);
    let semi_axes =
        Vector3::new(draw.uniform(0.35, 0.75) * width, draw.uniform(0.85, 1.0) * width, width);
    let count = draw.uniform(30.0, 81.0) as usize;
    // A ball of this radius about a point of the unit sphere covers a quarter of its square.
    let radius = (draw.uniform(0.5, 1.0) * 4.0 / count as f64).sqrt();
    let steepness = draw.uniform(0.5, 1.0);
    let bumps = spread_out(draw, count);
    let height = |direction: &Vector3<f64>| {
        let cosine = bumps.iter().map(|bump| bump.dot(direction)).fold(0.0, f64::max);
        let squared = radius * radius - 1.0 + cosine * cosine;
        f64::max(cosine + squared.max(0.0).sqrt() - 1.0, 0.0)
    };
    Shape::Mesh(Arc::new(Surface::radial(SEGMENTS, |direction| {
        let ellipsoid = 1.0 / direction.component_div(&semi_axes).norm();
        ellipsoid * (1.0 + steepness * height(direction))
    })))
}

/// Directions each of which is the farthest of [`CANDIDATES`] from those before it.
fn spread_out(draw: &mut Draw, count: usize) -> Vec<Unit<Vector3<f64>>> {
    let mut chosen = Vec::<Unit<Vector3<f64>>>::with_capacity(count);
    for _ in 0..count {
        let candidates: [_; CANDIDATES] = std::array::from_fn(|_| draw.direction());
        let nearest = |direction: &Unit<Vector3<f64>>| {
            chosen.iter().map(|other| other.dot(direction)).fold(-1.0, f64::max)
        };
        let farthest = candidates.into_iter().min_by(|a, b| nearest(a).total_cmp(&nearest(b)));
        chosen.extend(farthest);
    }
    chosen
}

/// A cylinder about z with 4 to 12 grooves round it, between ribs that are round or flat.
pub(super) fn ribbed(draw: &mut Draw) -> Shape {
    let radius = draw.spread(0.010, 0.024);
    let half_height = draw.uniform(0.012, 0.028);
    let ribs = 1 + draw.uniform(4.0, 13.0) as u32;
    let pitch = 2.0 * half_height / f64::from(ribs);
    let depth = draw.uniform(0.15, 0.5) * pitch;
    let flat = draw.uniform(0.3, 0.8);
    // Part of the pitch and of the depth, from the middle and the top of a rib.
    let rib: Vec<[f64; 2]> = if draw.coin() {
        let part = |i| 2.0 * f64::from(i) / f64::from(PIECES) - 1.0;
        (0..=PIECES).map(|i| [part(i), part(i) * part(i)]).collect()
    } else {
        vec![[-1.0, 1.0], [-flat, 0.0], [flat, 0.0], [1.0, 1.0]]
    };
    let mut profile = vec![[0.0, -half_height]];
    for number in 0..ribs {
        profile.extend(rib.iter().map(|[along, down]| {
            let place = f64::from(number) + 0.5 * (1.0 + along);
            [radius - depth * down, pitch * place - half_height]
        }));
    }
    // The end of a rib is the start of the next.
    profile.dedup();
    profile.push([0.0, profile[profile.len() - 1][1]]);
    Shape::Mesh(Arc::new(Surface::revolved(&profile, SEGMENTS, 0.0)))
}

/// A box whose faces at ±x bear blunt pyramids, on each of 3 to 6 by 3 to 6 fields or on every
/// second as on a chessboard. Sharp ones would touch at areas smaller than any mesh of a pad
/// resolves.
pub(super) fn rasp(draw: &mut Draw) -> Shape {
    let half = [draw.spread(0.012, 0.026), draw.uniform(0.012, 0.026)];
    let across = draw.uniform(3.0, 7.0).floor();
    let fields = [across, (across * half[1] / half[0]).round().clamp(3.0, 6.0)];
    let side = f64::min(half[0] / fields[0], half[1] / fields[1]);
    let body = draw.uniform(0.003, 0.010);
    let height = draw.uniform(0.4, 1.2) * side;
    let foot = draw.uniform(0.7, 0.95);
    let pyramid = [[foot, 0.0], [draw.uniform(0.3, 0.7) * foot, height]];
    let alternate = draw.coin();
    let place = |[i, j]: [u32; 2]| {
        let at = |i: u32, axis: usize| (2.0 * f64::from(i) / fields[axis] - 1.0) * half[axis];
        Point3::new(body, at(i, 0), at(j, 1))
    };
    let [columns, rows] = fields.map(|n| n as u32);
    let all = (0..columns).flat_map(|i| (0..rows).map(move |j| [i, j]));
    let face = all.flat_map(|[i, j]| {
        let corners = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(place);
        let is_flat = alternate && (i + j) % 2 == 1;
        terraces(corners, if is_flat { &[] } else { &pyramid })
    });
    let rim = (0..columns)
        .map(|i| [i, 0])
        .chain((0..rows).map(|j| [columns, j]))
        .chain((1..=columns).rev().map(|i| [i, rows]))
        .chain((1..=rows).rev().map(|j| [0, j]));
    Shape::Mesh(Arc::new(two_faced(&face.collect::<Vec<_>>(), &rim.map(place).collect::<Vec<_>>())))
}

type Quad = [Point3<f64>; 4];

/// A rectangle across x, on which stand copies of it, each with its size relative to the rectangle
/// and its height (m); the last is covered.
fn terraces(corners: Quad, copies: &[[f64; 2]]) -> Vec<Quad> {
    let middle = nalgebra::center(&corners[0], &corners[2]);
    let copy = |&[size, height]: &[f64; 2]| {
        corners.map(|corner| middle + size * (corner - middle) + height * Vector3::x())
    };
    let rings: Vec<Quad> = [corners].into_iter().chain(copies.iter().map(copy)).collect();
    let sides = rings.windows(2).flat_map(|pair| {
        [[0, 1], [1, 2], [2, 3], [3, 0]]
            .map(|[k, l]| [pair[0][k], pair[0][l], pair[1][l], pair[1][k]])
    });
    sides.chain(rings.last().copied()).collect()
}

/// Solid between a face and its mirror image in the plane x = 0, which have the same `rim`.
fn two_faced(face: &[Quad], rim: &[Point3<f64>]) -> Surface {
    let mirrored = |p: Point3<f64>| Point3::new(-p.x, p.y, p.z);
    let image = face.iter().map(|&[a, b, c, d]| [d, c, b, a].map(mirrored));
    let next = rim.iter().cycle().skip(1);
    let walls = rim.iter().zip(next).map(|(&a, &b)| [mirrored(a), mirrored(b), b, a]);
    let quads: Vec<Quad> = image.chain(walls).chain(face.iter().copied()).collect();
    let halves = |first: u32| [[0, 1, 2], [0, 2, 3]].map(|half| half.map(|corner| first + corner));
    let triangles: Vec<_> = (0..quads.len() as u32).flat_map(|quad| halves(4 * quad)).collect();
    Surface::new("rasp", &quads.concat(), &triangles).expect("faces and walls share their edges")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::objects::Family;

    /// Members of a family of hand size.
    fn members(family: Family, count: u64) -> impl Iterator<Item = Arc<Surface>> {
        (0..count).map(move |seed| match family.indenter(0, seed).validated().unwrap() {
            Shape::Mesh(surface) => surface,
            other => panic!("{other:?} is not a mesh"),
        })
    }

    #[test]
    fn members_are_watertight_and_of_hand_size() {
        for family in [Family::Raspberry, Family::Ribbed, Family::Rasp] {
            for surface in members(family, 50) {
                let checked = Surface::new("it", surface.vertices(), surface.triangles());
                assert_eq!(checked.as_ref(), Ok(&*surface), "{family}: merged or turned");
                let size = surface.size();
                assert!((0.02..=0.06).contains(&size), "{family}: {size} m");
            }
        }
    }

    /// Number of pieces of the surface that lie less than `depth` below its farthest point along
    /// `direction`.
    fn pieces(surface: &Surface, direction: &Vector3<f64>, depth: f64) -> usize {
        let heights: Vec<_> = surface.vertices().iter().map(|v| v.coords.dot(direction)).collect();
        let least = heights.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b)) - depth;
        let touching = |i: u32| heights[i as usize] > least;
        let mut piece: Vec<u32> = (0..heights.len() as u32).collect();
        loop {
            let before = piece.clone();
            for triangle in surface.triangles() {
                let ends = triangle.iter().filter(|&&i| touching(i));
                let first = ends.clone().map(|&i| piece[i as usize]).min();
                ends.for_each(|&i| piece[i as usize] = first.unwrap_or(i));
            }
            if piece == before {
                return piece.iter().zip(0..).filter(|&(p, i)| *p == i && touching(i)).count();
            }
        }
    }

    #[test]
    fn most_touch_a_plane_across_x_at_four_places_or_more() {
        for family in [Family::Raspberry, Family::Ribbed, Family::Rasp] {
            let many = members(family, 50).filter(|surface| {
                let (low, high) = surface.bounds();
                pieces(surface, &Vector3::x(), 0.03 * (high - low).min()) >= 4
            });
            let many = many.count();
            assert!(many > 30, "{family}: {many} of 50");
        }
    }
}
