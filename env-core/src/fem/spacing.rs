//! Spacing of the contact points on the faces of a body, and the thinnest shapes that they detect.
//!
//! Points lie 0.4 mm apart, or farther where that is configured, or as close as the thinnest shape
//! requires. A wide face has fewer: its edges are cut into at most 128 pieces, and into fewer if
//! all faces together would have more than [`MOST_POINTS`]. The points thus depend on the body and
//! the shapes only, not on the path of the shapes, so that histories can number them. A press is
//! refused if a shape comes near a face whose points are too far apart for it.

use std::cell::LazyCell;

use nalgebra::{Isometry3, Point3, Translation3, center};

use crate::{
    Error, Result,
    deformation::{Drive, Press, SoftBody},
    geometry::{Shape, TetMesh},
};

/// Usual distance of contact points (m), at which a tip of half a millimetre is not missed.
pub(super) const USUAL: f64 = 4e-4;
/// Fewest and most pieces into which a face's edges are cut.
const PIECES: [u32; 2] = [2, 128];
/// Most points of all faces together; beyond it the widest faces have fewer. A cube of 80 mm has so
/// many, and they take half a gigabyte.
const MOST_POINTS: u64 = 1 << 20;
/// Least thickness of a wall, in spacings, at which it cannot pass between the points: an
/// equilateral triangle's centroid is 0.58 of its side from the corners, on either side of a wall.
const THINNEST: f64 = 1.5;

/// Spacing of the contact points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spacing {
    /// Distance of contact points (m).
    length: f64,
    /// Most pieces of an edge.
    most: u32,
}

impl Spacing {
    /// Number of pieces into which the edges of a face are cut whose longest is `edge` (m).
    pub(super) fn pieces(&self, edge: f64) -> u32 {
        ((edge / self.length).ceil() as u32).clamp(PIECES[0], self.most)
    }

    /// Thickness of the thinnest wall detected on a face of longest edge `edge` (m).
    fn thinnest(&self, edge: f64) -> f64 {
        THINNEST * edge / f64::from(self.most)
    }
}

/// A face with its longest edge (m).
#[derive(Clone, Copy)]
struct FaceSpacing {
    edge: f64,
    ends: [u32; 3],
}

/// Faces of a body that can touch something: all whose nodes are not all fixed.
pub(super) struct Faces {
    /// Faces, the widest first.
    all: Vec<FaceSpacing>,
    /// The spacing for shapes that are not thin.
    pub(super) usual: Spacing,
    /// `true` if the fixed nodes hold the body in place.
    held: bool,
}

impl Faces {
    /// Collects the faces of `body`, with points `usual` (m) apart for shapes that are not thin.
    pub(super) fn new(body: &SoftBody, usual: f64) -> Self {
        let mesh = body.mesh();
        let mut fixed = vec![false; mesh.vertices.len()];
        body.fixed().iter().for_each(|&node| fixed[node as usize] = true);
        let held_all_round = |ends: &[u32; 3]| ends.iter().all(|&node| fixed[node as usize]);
        let outer = mesh.boundary().into_iter().filter(|ends| !held_all_round(ends));
        let mut faces: Vec<_> =
            outer.map(|ends| FaceSpacing { edge: longest_edge(mesh, ends), ends }).collect();
        faces.sort_by(|a, b| b.edge.total_cmp(&a.edge));
        let (usual, held) = (spacing(usual, &faces), body.fixed().len() >= 3);
        Self { all: faces, usual, held }
    }

    /// Returns the spacing at which the shapes of a `press` of `mesh` are detected, or an error if
    /// one of them is too thin for a face near its path. On a body that is not held, every face
    /// counts as near.
    pub(super) fn for_press(&self, mesh: &TetMesh, press: &Press) -> Result<Spacing> {
        let thinnest = press.shapes().iter().map(Shape::thickness).fold(f64::INFINITY, f64::min);
        let spacing = match thinnest / THINNEST {
            length if length < self.usual.length => spacing(length, &self.all),
            _ => self.usual,
        };
        let displaced = press.history().map_or(&[][..], |history| &history.displacement);
        let place = |node: u32| {
            let moved = displaced.get(node as usize).copied().unwrap_or_default();
            mesh.vertices[node as usize] + moved
        };
        for (i, shape) in press.shapes().iter().enumerate() {
            let path = LazyCell::new(|| ShapePath::new(i, press, &mesh.vertices));
            let near = |face: &&FaceSpacing| !self.held || path.passes(&face.ends.map(place));
            let thickness = shape.thickness();
            let mut too_wide =
                self.all.iter().take_while(|face| thickness < spacing.thinnest(face.edge));
            if let Some(face) = too_wide.find(near) {
                return Err(too_thin(shape, spacing.thinnest(face.edge)));
            }
        }
        Ok(spacing)
    }

    /// Returns an error unless `shape` is detected anywhere on the body at the usual spacing.
    pub(super) fn check_felt(&self, shape: &Shape) -> Result<()> {
        let widest = self.all.first().map_or(0.0, |face| face.edge);
        let thinnest = self.usual.thinnest(widest).max(THINNEST * self.usual.length);
        if shape.thickness() < thinnest { Err(too_thin(shape, thinnest)) } else { Ok(()) }
    }
}

/// Returns a spacing of `length` (m), with fewer points on wide faces if there are too many.
fn spacing(length: f64, faces: &[FaceSpacing]) -> Spacing {
    let [least, most] = PIECES;
    let spacing = |most: u32| Spacing { length, most };
    let points = |spacing: &Spacing| -> u64 {
        faces.iter().map(|face| u64::from(spacing.pieces(face.edge)).pow(2)).sum()
    };
    let mut falling = (least..=most).rev().map(spacing);
    falling.find(|spacing| points(spacing) <= MOST_POINTS).unwrap_or(spacing(least))
}

/// Path of a shape in a press.
struct ShapePath<'a> {
    shape: &'a Shape,
    /// Poses along the path.
    poses: Vec<Isometry3<f64>>,
    /// Distance to the shape within which a face counts as near (m), since the press moves the
    /// faces: the size of the shape, as a shape that is deeper is inside the body.
    margin: f64,
}

impl<'a> ShapePath<'a> {
    /// Returns the path of shape `i` of `press` over a body of these `vertices` (V).
    fn new(i: usize, press: &'a Press, vertices: &[Point3<f64>]) -> Self {
        let shape = &press.shapes()[i];
        let margin = shape.surface(16).map_or(0.0, |surface| surface.size());
        let history = press.history().map(|history| history.poses[i]);
        let poses = match press.drive() {
            Drive::Translation { path } => {
                history.into_iter().chain(path.iter().map(|poses| poses[i])).collect()
            }
            Drive::Force { poses, direction, .. } => {
                let begin = history.unwrap_or(poses[i]);
                let away = |p: &Point3<f64>| (p.coords - begin.translation.vector).norm();
                let past = margin + vertices.iter().map(away).fold(0.0, f64::max);
                vec![begin, Translation3::from(direction.scale(past)) * begin]
            }
        };
        Self { shape, poses, margin }
    }

    /// Returns whether the path leads the shape near a face with these `corners`. The face is
    /// divided into parts until they are no larger than the margin.
    fn passes(&self, corners: &[Point3<f64>; 3]) -> bool {
        let [a, b, c] = *corners;
        let centre = Point3::from((a.coords + b.coords + c.coords) / 3.0);
        let radius = corners.iter().map(|p| (p - centre).norm()).fold(0.0, f64::max);
        if !self.passes_ball(&centre, radius) {
            return false;
        }
        let [x, y, z] = [(b, c), (c, a), (a, b)].map(|(p, q)| center(&p, &q));
        let parts = [[a, z, y], [z, b, x], [y, x, c], [x, y, z]];
        radius <= self.margin || parts.iter().any(|part| self.passes(part))
    }

    fn passes_ball(&self, centre: &Point3<f64>, radius: f64) -> bool {
        let begins = self.poses.first().into_iter().chain(&self.poses);
        begins.zip(&self.poses).any(|(from, to)| self.passes_between(from, to, centre, radius))
    }

    /// Returns whether the shape comes within the margin of a ball between two poses. Along the
    /// motion it is measured in steps as long as its distance from the ball, which is at least the
    /// margin.
    fn passes_between(
        &self,
        from: &Isometry3<f64>,
        to: &Isometry3<f64>,
        centre: &Point3<f64>,
        radius: f64,
    ) -> bool {
        let shift = (to.translation.vector - from.translation.vector).norm();
        let lever = (centre.coords - from.translation.vector).norm() + shift;
        let travel = shift + from.rotation.angle_to(&to.rotation) * lever;
        let mut gone = 0.0;
        loop {
            let pose = if gone < travel { from.lerp_slerp(to, gone / travel) } else { *to };
            let distance = self.shape.distance(&pose.inverse_transform_point(centre)).value;
            let room = distance - radius;
            if room < self.margin || gone >= travel {
                return room < self.margin;
            }
            gone += room;
        }
    }
}

/// Length of the longest edge of a face (m).
pub(super) fn longest_edge(mesh: &TetMesh, ends: [u32; 3]) -> f64 {
    let [a, b, c] = ends.map(|node| mesh.vertices[node as usize]);
    (b - a).norm().max((c - b).norm()).max((a - c).norm())
}

fn too_thin(shape: &Shape, thinnest: f64) -> Error {
    let expected = format!("{thinnest:.1e} m or more on faces as wide as here");
    Error::invalid("thickness of a shape", format!("{} m", shape.thickness()), expected)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        deformation::{Law, Moduli},
        fem::{
            element::{Element, Nodes},
            examples::grid,
            surface::surface,
        },
        geometry::{PadMesh, TetMesh},
        sensor::Sensor,
    };

    fn soft(mesh: &TetMesh, fixed: &[u32]) -> SoftBody {
        let moduli = Moduli { young: 1e5, poisson: 0.45 };
        SoftBody::new(mesh.clone(), Law::default(), moduli, fixed).unwrap()
    }

    /// Number of contact points of `body`, and number that all its faces would have at the usual
    /// spacing without the limit on the sum.
    fn laid_and_wanted(body: &SoftBody) -> (usize, usize) {
        let (nodes, faces) = (Nodes::new(body, Element::P1), Faces::new(body, USUAL));
        let laid = surface(body, &nodes, Element::P1, faces.usual).0.len();
        let on = |face: &FaceSpacing| (face.edge / USUAL).ceil().clamp(2.0, 128.0).powi(2) as usize;
        (laid, faces.all.iter().map(on).sum())
    }

    #[test]
    fn pads_and_things_held_in_a_hand_have_all_their_contact_points() {
        let outline = Sensor::named("gelsight-mini").unwrap().outline;
        for nodes in [900, 2875, 9065] {
            let pad = PadMesh::with_nodes(&outline, nodes).unwrap();
            let (laid, wanted) = laid_and_wanted(&soft(&pad.mesh, &pad.base));
            assert!(laid == wanted, "{nodes} nodes: {laid} points of {wanted}");
        }
        let ball = TetMesh::of_shape(&Shape::Sphere { radius: 0.03 }, 5e-3).unwrap();
        let (laid, wanted) = laid_and_wanted(&soft(&ball, &[]));
        assert!(laid == wanted && laid > 100_000, "a ball: {laid} points of {wanted}");
    }

    #[test]
    fn a_body_however_large_has_no_more_points_than_fit() {
        // Faces of 1.4 m on a block of 10 m: with 128 pieces an edge six million points.
        let mesh = grid([10, 10, 2], |p| p);
        let held: Vec<u32> = (0..mesh.vertices.len() as u32).filter(|n| n % 3 == 0).collect();
        let (laid, wanted) = laid_and_wanted(&soft(&mesh, &held));
        let most = MOST_POINTS as usize;
        assert!(wanted > 4 * most, "{wanted} points were wanted");
        assert!(laid <= most && laid > most / 2, "{laid} points of {most}");
    }
}
