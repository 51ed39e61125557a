//! From forces on the nodes of a pad's face to the displacement of a whole mesh: a dense matrix, made once.
//!
//! Shapes: C nodes of the face, V nodes of the mesh, the first F of them free.

use nalgebra::Vector3;

use crate::{compliance::nodal::Nodal, responses::Responses};

/// The matrix.
pub(super) struct Extension {
    /// Displacement of the free nodes under a unit force along each axis on each node of the face
    /// (3C, 3F) in m/N.
    columns: Responses,
    /// V.
    nodes: usize,
}

impl Extension {
    /// That of `nodal`, whose displacement `carry` brings to the mesh. Made on the calling thread
    /// alone: a thread of a pool that waited for others could be given a press that waits for this.
    pub(super) fn new(nodal: &Nodal, carry: impl Fn(&[Vector3<f64>]) -> Vec<Vector3<f64>>) -> Self {
        let answers = nodal.unit_responses(carry);
        let nodes = answers.first().map_or(0, Vec::len);
        let moved =
            |answer: &Vec<Vector3<f64>>| answer.iter().rposition(|u| *u != Vector3::zeros());
        let free = answers.iter().filter_map(moved).max().map_or(0, |last| last + 1);
        let mut columns = Responses::new(3 * free);
        for answer in &answers {
            columns.push(answer[..free].iter().flat_map(|u| [u.x, u.y, u.z]));
        }
        Self { columns, nodes }
    }

    /// Displacement (V, 3) in m under forces (N) on some nodes of the face.
    pub(super) fn displacement(&self, forces: &[(u32, Vector3<f64>)]) -> Vec<f32> {
        let size = self.columns.width();
        let mut all = vec![0.0; 3 * self.nodes];
        for (node, force) in forces {
            self.columns.add(*node, force, 0..size, &mut all[..size]);
        }
        all
    }
}
