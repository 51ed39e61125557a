//! State in which a press ends, and its serialisation.

use std::fmt;

use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::body::{Law, Moduli, SoftBody};
use crate::{
    Error, Result,
    geometry::Shape,
    saved::{self, Mark},
};

/// State in which a press ended; the next press of the same body and shapes may start from it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct History {
    /// Model that wrote it.
    pub model: ModelIdentity,
    /// Displacement of the nodes of the model that wrote it (m); the mesh's nodes come first.
    pub displacement: Vec<Vector3<f64>>,
    /// Poses of the shapes (S).
    pub poses: Vec<Isometry3<f64>>,
    /// Sticking places of the touching contact points.
    pub anchors: Vec<Anchor>,
    /// Forces at the anchors (N), if the model that wrote it starts from them; else empty.
    pub forces: Vec<Vector3<f64>>,
    /// `true` if the displacement of this answer turns a tetrahedron inside out.
    pub folded: bool,
}

/// Contact point that touches a shape, and the place on the shape where friction holds it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Anchor {
    /// Index of the shape.
    pub shape: u32,
    /// Index of the contact point among those of the model.
    pub point: u32,
    /// Place in the frame of the shape (m).
    pub place: Point3<f64>,
}

/// Identity of a model and of the numbering of its nodes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelIdentity {
    numbering: Numbering,
    law: Law,
    nodes: u32,
    /// Number of fixed nodes, and sum of the squares of their numbers.
    fixed: (u32, u64),
    /// Mean distance of the nodes at rest from [`AWAY`], weighted by their numbers (m).
    place: f64,
    /// Mean Young's modulus (Pa) and Poisson's ratio of the tetrahedra.
    moduli: [f64; 2],
}

/// Numbering of a model's nodes and contact points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Numbering {
    /// Nodes are the vertices of the mesh: of linear elements, and of linear elasticity with
    /// contact at points, which are the same and can continue from each other's histories.
    Vertices,
    /// Vertices, of linear elasticity of a body without fixed nodes: with fewer contact points.
    Free,
    /// Contact is at nodes.
    ContactNodes,
    /// Vertices, then the middles of the edges, of quadratic elements.
    VerticesAndEdges,
    /// Contact is on the cells of grids.
    Cells,
}

/// Point (m) at which no mesh has a centre of symmetry.
const AWAY: Point3<f64> = Point3::new(0.1, 0.2, 0.3);
/// Relative difference of numbers that other machines may compute otherwise.
const ROUNDING: f64 = 1e-9;

const MARK: Mark = *b"history4";

impl ModelIdentity {
    /// Identity of a model of `body` with nodes at these `places` at rest (m).
    pub fn new(numbering: Numbering, body: &SoftBody, places: &[Point3<f64>]) -> Self {
        let weighted = (1..).zip(places).fold([0.0; 2], |[sum, weights], (number, place)| {
            let weight = f64::from(number);
            [sum + weight * (place - AWAY).norm(), weights + weight]
        });
        let squares = body.fixed().iter().map(|&node| u64::from(node).pow(2));
        let tets = body.moduli().len() as f64;
        let mean =
            |number: fn(&Moduli) -> f64| body.moduli().iter().map(number).sum::<f64>() / tets;
        Self {
            numbering,
            law: body.law(),
            nodes: places.len() as u32,
            fixed: (body.fixed().len() as u32, squares.sum()),
            place: weighted[0] / weighted[1],
            moduli: [mean(|moduli| moduli.young), mean(|moduli| moduli.poisson)],
        }
    }

    /// Identity of a model of the same body with other nodes or contact points.
    #[must_use]
    pub fn with_numbering(self, numbering: Numbering) -> Self {
        Self { numbering, ..self }
    }

    fn is(&self, other: &Self) -> bool {
        let is_near = |a: f64, b: f64| (a - b).abs() <= ROUNDING * a.abs();
        (self.numbering, self.law, self.nodes, self.fixed)
            == (other.numbering, other.law, other.nodes, other.fixed)
            && is_near(self.place, other.place)
            && self.moduli.iter().zip(other.moduli).all(|(a, b)| is_near(*a, b))
    }
}

impl fmt::Display for ModelIdentity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { nodes, fixed: (fixed, _), moduli: [young, poisson], law, .. } = self;
        let numbering = match self.numbering {
            Numbering::Vertices => "at the vertices",
            Numbering::Free => "at the vertices of a free body",
            Numbering::ContactNodes => "that touch",
            Numbering::VerticesAndEdges => "of quadratic elements",
            Numbering::Cells => "under contact on cells",
        };
        write!(
            f,
            "{nodes} nodes {numbering} ({fixed} fixed) of a {law} solid of {young:.3e} Pa and a \
             Poisson's ratio of {poisson:.4}"
        )
    }
}

impl History {
    /// Returns an error if the history was not written by this `model`, of `nodes` nodes with
    /// displacement and `points` contact points.
    pub fn check(&self, model: &ModelIdentity, nodes: usize, points: usize) -> Result<()> {
        if !self.model.is(model) {
            let [found, mut expected] =
                [&self.model, model].map(|model| format!("one of a model with {model}"));
            if found == expected {
                expected += ", in other places";
            }
            return Err(Error::invalid("history", found, expected));
        }
        if self.displacement.len() != nodes {
            let expected = format!("displacements of this model's {nodes} nodes");
            return Err(Error::invalid("history", self.displacement.len(), expected));
        }
        if !(self.forces.is_empty() || self.forces.len() == self.anchors.len()) {
            let expected = format!("forces at its {} anchors", self.anchors.len());
            return Err(Error::invalid("history", self.forces.len(), expected));
        }
        if let Some(anchor) = self.anchors.iter().find(|a| a.point as usize >= points) {
            let expected = format!("anchors at this model's {points} contact points");
            return Err(Error::invalid("history", anchor.point, expected));
        }
        Ok(())
    }

    /// Returns an error if most points that touch stick where none of the `shapes` has a surface: the
    /// history is one of other shapes.
    pub fn check_shapes(&self, shapes: &[Shape]) -> Result<()> {
        /// Distance from the surface up to which a point may stick, relative to the thickness.
        const OFF: f64 = 0.1;
        let off = |anchor: &Anchor| {
            let shape = &shapes[anchor.shape as usize];
            shape.distance(&anchor.place).value.abs() / shape.thickness()
        };
        let away = self.anchors.iter().filter(|anchor| off(anchor) > OFF).count();
        if 2 * away <= self.anchors.len() {
            return Ok(());
        }
        let found = format!("one with {away} of {} points off the shapes", self.anchors.len());
        Err(Error::invalid("history", found, "one of a press by the same shapes"))
    }

    /// This history for a press of other shapes: of each, its place among the present ones, or
    /// `None` for one that touches nothing yet, with its pose.
    #[must_use]
    pub fn with_shapes(mut self, shapes: &[(Option<usize>, Isometry3<f64>)]) -> Self {
        let (anchors, forces) =
            (std::mem::take(&mut self.anchors), std::mem::take(&mut self.forces));
        for (i, anchor) in anchors.into_iter().enumerate() {
            let is_same = |(place, _): &(Option<usize>, _)| *place == Some(anchor.shape as usize);
            if let Some(shape) = shapes.iter().position(is_same) {
                self.anchors.push(Anchor { shape: shape as u32, ..anchor });
                self.forces.extend(forces.get(i));
            }
        }
        let pose = |(place, pose): &(Option<usize>, _)| place.map_or(*pose, |i| self.poses[i]);
        self.poses = shapes.iter().map(pose).collect();
        self
    }

    /// Serialises the history, exact to the bit.
    pub fn to_bytes(&self) -> Vec<u8> {
        saved::to_bytes(MARK, self)
    }

    /// Restores a history from the result of [`History::to_bytes`]; other bytes are an error.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        saved::from_bytes(MARK, "history", bytes)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::geometry::{PadMesh, PadOutline};

    fn body(young: f64) -> SoftBody {
        let pad = PadMesh::with_nodes(&PadOutline::flat(20e-3, 16e-3, 4e-3), 100).unwrap();
        let moduli = Moduli { young, poisson: 0.47 };
        SoftBody::new(pad.mesh, Law::default(), moduli, &pad.base).unwrap()
    }

    fn identity(body: &SoftBody) -> ModelIdentity {
        ModelIdentity::new(Numbering::Vertices, body, &body.mesh().vertices)
    }

    /// Identity of a model that no other test has.
    pub(crate) fn foreign() -> ModelIdentity {
        identity(&body(1e5))
    }

    fn history() -> History {
        History {
            model: foreign(),
            displacement: vec![Vector3::new(1e-3, -0.0, 1.0 / 3.0); 2],
            poses: vec![Isometry3::rotation(Vector3::new(0.1, 0.2, 0.3))],
            anchors: vec![Anchor { shape: 0, point: 7, place: Point3::new(0.0, 1e-9, 2.0) }],
            forces: vec![Vector3::x()],
            folded: true,
        }
    }

    #[test]
    fn a_history_comes_back_from_its_bytes() {
        assert_eq!(History::from_bytes(&history().to_bytes()), Ok(history()));
    }

    #[test]
    fn a_history_keeps_the_anchors_of_shapes_that_stay() {
        let pose = |x: f64| Isometry3::translation(x, 0.0, 0.0);
        let anchor = |shape, point| Anchor { shape, point, place: Point3::origin() };
        let before = History {
            poses: vec![pose(0.0), pose(1.0), pose(2.0)],
            anchors: vec![anchor(0, 3), anchor(1, 4), anchor(2, 5)],
            forces: vec![Vector3::x(), Vector3::y(), Vector3::z()],
            ..history()
        };
        let after = before.clone().with_shapes(&[
            (None, pose(9.0)),
            (Some(0), pose(8.0)),
            (Some(2), pose(7.0)),
        ]);
        assert_eq!(after.poses, [pose(9.0), pose(0.0), pose(2.0)]);
        assert_eq!(after.anchors, [anchor(1, 3), anchor(2, 5)]);
        assert_eq!(after.forces, [Vector3::x(), Vector3::z()]);
        assert_eq!(after.displacement, before.displacement);
    }

    #[test]
    fn a_model_takes_histories_of_its_body_and_numbering_alone() {
        let (history, own) = (history(), body(1e5));
        let check = |model: &ModelIdentity| history.check(model, 2, 8);
        let mine = identity(&own);
        assert_eq!(check(&mine), Ok(()));
        let places = &own.mesh().vertices;
        let mut moved = places.clone();
        moved[7].x += 1e-5;
        let mut swapped = places.clone();
        swapped.swap(3, 4);
        let mirrored: Vec<_> = places.iter().map(|p| Point3::new(-p.x, p.y, p.z)).collect();
        for other in [&moved, &swapped, &mirrored, &places[1..].to_vec()] {
            assert!(check(&ModelIdentity::new(Numbering::Vertices, &own, other)).is_err());
        }
        assert!(check(&mine.with_numbering(Numbering::Cells)).is_err());
        let mut held = own.fixed().to_vec();
        held[0] = 0;
        let mesh = own.mesh().clone();
        let moduli = own.moduli()[0];
        let other = SoftBody::new(mesh, Law::default(), moduli, &held).unwrap();
        assert!(other.fixed().len() == own.fixed().len() && check(&identity(&other)).is_err());
        let message = check(&identity(&body(2e5))).unwrap_err().to_string();
        assert!(message.contains("1.000e5 Pa") && message.contains("2.000e5 Pa"), "{message}");
        // Another machine may round otherwise.
        let mut rounded = places.clone();
        for place in &mut rounded {
            place.z *= 1.0 + f64::EPSILON;
        }
        assert_eq!(check(&ModelIdentity::new(Numbering::Vertices, &own, &rounded)), Ok(()));
    }

    #[test]
    fn other_bytes_are_refused() {
        let good = history().to_bytes();
        let message = |bytes: &[u8]| History::from_bytes(bytes).unwrap_err().to_string();
        assert!(message(b"").contains("0 bytes without its mark"));
        assert!(message(&good[..good.len() - 1]).contains("damaged"));
        assert!(message(&[&good[..], b"12"].concat()).contains("2 bytes too many"));
    }
}
