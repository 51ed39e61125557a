//! How close contact points lie on the faces of a body, and which shapes are felt between them.
//!
//! Points lie 0.4 mm apart, or farther where that was asked for, or as close as the thinnest shape
//! asks for. A wide face has fewer: its edges are cut into 128 pieces at most, into less while the
//! points of all faces are more than [`MOST_POINTS`]. So the points are those of body and shapes alone, wherever the shapes go, and
//! histories can number them. A press is refused if a shape comes near a face that is too wide for it.

use std::cell::LazyCell;

use nalgebra::{Isometry3, Point3, Translation3, center};

use crate::{
    Error, Result,
    deformation::{Drive, Press, SoftBody},
    geometry::{Shape, TetMesh},
};

/// Contact points lie about this close (m), so that a tip of half a millimetre is not missed.
pub(super) const USUAL: f64 = 4e-4;
/// Pieces into which a face's edges are cut: at least and at most.
const PIECES: [u32; 2] = [2, 128];
/// Points of all faces past which the widest have fewer; a cube of 80 mm has so many. They take half a
/// gigabyte.
const MOST_POINTS: u64 = 1 << 20;
/// Spacings that a wall must be thick, so that it cannot pass between the points: an equilateral
/// triangle's centroid is 0.58 of its side from the corners, on either side of a wall.
const THINNEST: f64 = 1.5;

/// How close contact points lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spacing {
    /// Distance of contact points (m).
    length: f64,
    /// Most pieces of an edge.
    most: u32,
}

impl Spacing {
    /// Pieces into which the edges of a face are cut whose longest is `edge` (m).
    pub(super) fn pieces(&self, edge: f64) -> u32 {
        ((edge / self.length).ceil() as u32).clamp(PIECES[0], self.most)
    }

    /// Thinnest wall that is felt on a face of longest edge `edge` (m).
    fn thinnest(&self, edge: f64) -> f64 {
        THINNEST * edge / f64::from(self.most)
    }
}

/// A face with its longest edge (m).
#[derive(Clone, Copy)]
struct Face {
    edge: f64,
    ends: [u32; 3],
}

/// Faces of a body that can touch something: all that are not held all round.
pub(super) struct Faces {
    /// The widest first.
    all: Vec<Face>,
    /// The spacing for shapes that are not thin.
    pub(super) usual: Spacing,
    /// Whether the body stays where it is.
    held: bool,
}

impl Faces {
    /// Those of `body`, with points `usual` (m) apart for shapes that are not thin.
    pub(super) fn new(body: &SoftBody, usual: f64) -> Self {
        let mesh = body.mesh();
        let mut fixed = vec![false; mesh.vertices.len()];
        body.fixed().iter().for_each(|&node| fixed[node as usize] = true);
        let held_all_round = |ends: &[u32; 3]| ends.iter().all(|&node| fixed[node as usize]);
        let outer = mesh.boundary().into_iter().filter(|ends| !held_all_round(ends));
        let mut faces: Vec<_> =
            outer.map(|ends| Face { edge: longest_edge(mesh, ends), ends }).collect();
        faces.sort_by(|a, b| b.edge.total_cmp(&a.edge));
        let (usual, held) = (spacing(usual, &faces), body.fixed().len() >= 3);
        Self { all: faces, usual, held }
    }

    /// The spacing at which the shapes of a `press` of `mesh` are felt; an error if one of them is too
    /// thin for a face near its way. A body that is not held may turn any face there.
    pub(super) fn felt(&self, mesh: &TetMesh, press: &Press) -> Result<Spacing> {
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
            let way = LazyCell::new(|| Way::new(i, press, &mesh.vertices));
            let near = |face: &&Face| !self.held || way.passes(&face.ends.map(place));
            let thickness = shape.thickness();
            let mut too_wide =
                self.all.iter().take_while(|face| thickness < spacing.thinnest(face.edge));
            if let Some(face) = too_wide.find(near) {
                return Err(too_thin(shape, spacing.thinnest(face.edge)));
            }
        }
        Ok(spacing)
    }

    /// An error unless `shape` is felt anywhere at the usual spacing.
    pub(super) fn check_felt(&self, shape: &Shape) -> Result<()> {
        let widest = self.all.first().map_or(0.0, |face| face.edge);
        let thinnest = self.usual.thinnest(widest).max(THINNEST * self.usual.length);
        if shape.thickness() < thinnest { Err(too_thin(shape, thinnest)) } else { Ok(()) }
    }
}

/// Points `length` (m) apart, but on wide faces if there are too many.
fn spacing(length: f64, faces: &[Face]) -> Spacing {
    let [least, most] = PIECES;
    let spacing = |most: u32| Spacing { length, most };
    let points = |spacing: &Spacing| -> u64 {
        faces.iter().map(|face| u64::from(spacing.pieces(face.edge)).pow(2)).sum()
    };
    let mut falling = (least..=most).rev().map(spacing);
    falling.find(|spacing| points(spacing) <= MOST_POINTS).unwrap_or(spacing(least))
}

/// Where a shape goes in a press.
struct Way<'a> {
    shape: &'a Shape,
    /// Poses that it is led through.
    poses: Vec<Isometry3<f64>>,
    /// How far round it the body's faces may be moved (m): as far as it measures across, for a deeper
    /// shape is inside the body.
    margin: f64,
}

impl<'a> Way<'a> {
    /// The way of shape `i` of `press` over a body of these `vertices` (V).
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

    /// Whether it leads the shape near a face with these `corners`, parts of which are looked at alone
    /// until they are no larger than the margin.
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

    /// Whether the shape comes within the margin of a ball from one pose to another: as far as they are
    /// apart it may go at once, and at least by the margin.
    fn passes_between(
        &self,
        from: &Isometry3<f64>,
        to: &Isometry3<f64>,
        centre: &Point3<f64>,
        radius: f64,
    ) -> bool {
        let shift = (to.translation.vector - from.translation.vector).norm();
        let lever = (centre.coords - from.translation.vector).norm() + shift;
        let way = shift + from.rotation.angle_to(&to.rotation) * lever;
        let mut gone = 0.0;
        loop {
            let pose = if gone < way { from.lerp_slerp(to, gone / way) } else { *to };
            let distance = self.shape.distance(&pose.inverse_transform_point(centre)).value;
            let room = distance - radius;
            if room < self.margin || gone >= way {
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

    /// Contact points of `body`, and of all its faces at the usual spacing, however many they are.
    fn laid_and_wanted(body: &SoftBody) -> (usize, usize) {
        let (nodes, faces) = (Nodes::new(body, Element::P1), Faces::new(body, USUAL));
        let laid = surface(body, &nodes, Element::P1, faces.usual).0.len();
        let on = |face: &Face| (face.edge / USUAL).ceil().clamp(2.0, 128.0).powi(2) as usize;
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
