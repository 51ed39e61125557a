//! Places between the contact nodes, where a thin shape would stand unfelt.
//!
//! No place of a triangle is farther than 1/√3 of its longest side from a corner, about, so a shape
//! that is twice as thick is felt by one of its nodes before it is through. Thinner ones are watched
//! at a lattice of places in the triangle.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::geometry::Shape;

/// Thickness of a shape, in longest sides of a triangle, from which it need not be watched there.
const THICK: f64 = 1.16;
/// Greatest depth that a shape which no node feels may stand between nodes, in thicknesses, and in all (m).
const UNFELT: (f64, f64) = (0.125, 2.5e-4);
/// Greatest depth of a shape that some node feels, in thicknesses: a load step of half a thickness at most
/// cannot lead from there to as near its other side, and the lattice sees it if anything is deeper.
const FELT: f64 = 0.25;
/// Distance of the places that are watched, in thicknesses, and most of them along a side.
const SPACING: (f64, u32) = (0.5, 64);

/// A triangle of contact nodes.
pub(super) struct Face {
    corners: [u32; 3],
    places: [Point3<f64>; 3],
    longest: f64,
}

/// A shape where it is.
#[derive(Clone, Copy)]
pub(super) struct Standing<'a> {
    pub(super) shape: &'a Shape,
    pub(super) pose: &'a Isometry3<f64>,
    /// Whether it presses on some node.
    pub(super) felt: bool,
}

impl Face {
    pub(super) fn new(corners: [u32; 3], all: &[Point3<f64>]) -> Self {
        let places = corners.map(|corner| all[corner as usize]);
        let [a, b, c] = &places;
        let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
        Self { corners, places, longest }
    }

    /// Distance from the nearest corner within which all its places lie (m).
    pub(super) fn reach(&self) -> f64 {
        0.5 * THICK * self.longest
    }

    /// How much deeper `standing` is than it may be in the face, whose corners are `displaced` by
    /// `most` at most (m): the depth, and what is allowed.
    pub(super) fn penetrated(
        &self,
        standing: Standing,
        most: f64,
        displaced: impl Fn(u32) -> Vector3<f64>,
    ) -> Option<[f64; 2]> {
        let Standing { shape, pose, felt } = standing;
        let gap = |place: &Point3<f64>| shape.distance(&pose.inverse_transform_point(place)).value;
        if gap(&self.places[0]) > self.longest + most {
            return None;
        }
        let moved = [0, 1, 2].map(|i| (self.places[i] + displaced(self.corners[i])).coords);
        let thickness = shape.thickness();
        let unfelt = f64::min(UNFELT.0 * thickness, UNFELT.1);
        let allowed = if felt { FELT * thickness } else { unfelt };
        let pieces = (self.longest / (SPACING.0 * thickness)).ceil() as u32;
        let places = lattice(pieces.clamp(2, SPACING.1));
        let depth = places.map(|weights| -gap(&Point3::from(weighted(&moved, &weights))));
        let deepest = depth.fold(0.0, f64::max);
        (deepest > allowed).then_some([deepest, allowed])
    }
}

/// The faces at whose nodes alone `shapes` could be missed, of `faces` sorted by [`widest`].
pub(super) fn watched<'a>(faces: &'a [Face], shapes: &[Shape]) -> &'a [Face] {
    let thinnest = shapes.iter().map(Shape::thickness).fold(f64::INFINITY, f64::min);
    &faces[..faces.partition_point(|face| thinnest < THICK * face.longest)]
}

/// Puts the widest faces first.
pub(super) fn widest(mut faces: Vec<Face>) -> Vec<Face> {
    faces.sort_by(|a, b| b.longest.total_cmp(&a.longest));
    faces
}

/// Barycentric coordinates of the corners of equal triangles, `pieces` along a side.
fn lattice(pieces: u32) -> impl Iterator<Item = [f64; 3]> {
    let share = move |i: u32| f64::from(i) / f64::from(pieces);
    let row = move |i| (0..=pieces - i).map(move |j| [share(i), share(j), share(pieces - i - j)]);
    (0..=pieces).flat_map(row)
}

fn weighted(corners: &[Vector3<f64>; 3], weights: &[f64; 3]) -> Vector3<f64> {
    corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
}
