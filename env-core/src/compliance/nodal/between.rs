//! Detection of thin shapes that penetrate between the contact nodes.
//!
//! The distance from a position in a triangle to the nearest corner is at most about 1/√3 of the
//! longest side, so a shape twice as thick touches a node before it is through. For thinner shapes,
//! the depth is measured on a lattice of positions in the triangle.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::geometry::Shape;

/// Thickness of a shape, relative to the longest side of a triangle, above which the triangle is
/// not checked.
const THICK: f64 = 1.16;
/// Greatest depth between nodes of a shape that touches no node: relative to its thickness, and
/// absolute (m). The smaller of the two applies.
const UNFELT: (f64, f64) = (0.125, 2.5e-4);
/// Greatest depth of a shape that touches some node, relative to its thickness. A load step of at
/// most half a thickness cannot lead from that depth to nearer than a quarter of the thickness to
/// the shape's other side, and the lattice shows any larger depth.
pub(super) const FELT: f64 = 0.25;
/// Spacing of the lattice, relative to the thickness, and greatest number of intervals along a
/// side.
const SPACING: (f64, u32) = (0.5, 64);

/// Fewest intervals along a side where a shape touches no node: an edge may be all that is in the
/// triangle, however thick the shape is.
const PIECES_UNFELT: u32 = 8;

/// Triangle of contact nodes.
pub(super) struct ContactTriangle {
    corners: [u32; 3],
    places: [Point3<f64>; 3],
    longest: f64,
}

/// Shape at its pose.
#[derive(Clone, Copy)]
pub(super) struct Standing<'a> {
    pub(super) shape: &'a Shape,
    pub(super) pose: &'a Isometry3<f64>,
    /// `true` if it presses on a node.
    pub(super) felt: bool,
}

impl ContactTriangle {
    pub(super) fn new(corners: [u32; 3], all: &[Point3<f64>]) -> Self {
        let places = corners.map(|corner| all[corner as usize]);
        let [a, b, c] = &places;
        let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
        Self { corners, places, longest }
    }

    /// Radius of the balls round the corners that together contain the triangle (m).
    pub(super) fn reach(&self) -> f64 {
        0.5 * THICK * self.longest
    }

    /// Depth of `standing` in the face and the depth allowed (m), if the former is larger. The
    /// corners are `displaced` by at most `most` (m).
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
        let fewest = if felt { 2 } else { PIECES_UNFELT };
        let places = lattice(pieces.clamp(fewest, SPACING.1));
        let depth = places.map(|weights| -gap(&Point3::from(weighted(&moved, &weights))));
        let deepest = depth.fold(0.0, f64::max);
        (deepest > allowed).then_some([deepest, allowed])
    }
}

/// Leading part of `faces`, sorted by [`widest`]: those that one of `shapes` could penetrate
/// without touching a node.
pub(super) fn watched<'a>(faces: &'a [ContactTriangle], shapes: &[Shape]) -> &'a [ContactTriangle] {
    let thinnest = shapes.iter().map(Shape::thickness).fold(f64::INFINITY, f64::min);
    &faces[..faces.partition_point(|face| thinnest < THICK * face.longest)]
}

/// Sorts faces by their longest side, in descending order.
pub(super) fn widest(mut faces: Vec<ContactTriangle>) -> Vec<ContactTriangle> {
    faces.sort_by(|a, b| b.longest.total_cmp(&a.longest));
    faces
}

/// Barycentric coordinates of lattice points with `pieces` intervals along each side.
fn lattice(pieces: u32) -> impl Iterator<Item = [f64; 3]> {
    let share = move |i: u32| f64::from(i) / f64::from(pieces);
    let row = move |i| (0..=pieces - i).map(move |j| [share(i), share(j), share(pieces - i - j)]);
    (0..=pieces).flat_map(row)
}

fn weighted(corners: &[Vector3<f64>; 3], weights: &[f64; 3]) -> Vector3<f64> {
    corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
}
