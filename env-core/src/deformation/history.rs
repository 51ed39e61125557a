//! State in which a press ends, and its serialisation.

use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::{Error, Result};

/// State in which a press ended; the next press of the same body and shapes may start from it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct History {
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

/// First bytes of a serialised history; the last character counts versions.
const MARK: [u8; 8] = *b"history3";

impl History {
    /// Returns an error if the history was not written by a model of `nodes` nodes and `points`
    /// contact points.
    pub fn check(&self, nodes: usize, points: usize) -> Result<()> {
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

    /// Serialises the history (postcard), exact to the bit.
    pub fn to_bytes(&self) -> Vec<u8> {
        let body = postcard::to_stdvec(self).expect("lists of numbers are what postcard writes");
        [&MARK[..], &body].concat()
    }

    /// Restores a history from the result of [`History::to_bytes`]; other bytes are an error.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let bad = |found: String| Error::invalid("history", found, "bytes of a saved history");
        let Some(body) = bytes.strip_prefix(&MARK) else {
            return Err(bad(format!("{} bytes without its mark", bytes.len())));
        };
        match postcard::take_from_bytes(body) {
            Ok((history, [])) => Ok(history),
            Ok((_, rest)) => Err(bad(format!("{} bytes too many", rest.len()))),
            Err(error) => Err(bad(format!("damaged bytes ({error})"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn history() -> History {
        History {
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
    fn other_bytes_are_refused() {
        let good = history().to_bytes();
        let message = |bytes: &[u8]| History::from_bytes(bytes).unwrap_err().to_string();
        assert!(message(b"").contains("0 bytes without its mark"));
        assert!(message(&good[..good.len() - 1]).contains("damaged"));
        assert!(message(&[&good[..], b"12"].concat()).contains("2 bytes too many"));
    }
}
