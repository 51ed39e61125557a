//! Dense matrix from forces on the nodes of a pad's face to the displacement of a whole mesh,
//! computed once.
//!
//! Shapes: C nodes of the face, D numbers of a displacement, of which trailing ones may always be
//! zero.

use nalgebra::Vector3;

use crate::{
    compliance::nodal::{FaceResponses, Nodal},
    responses::Responses,
};

/// The matrix.
pub(super) struct Extension {
    /// Displacement under a unit force along each axis on each node of the face (3C, D) in m/N,
    /// without trailing numbers that are always zero.
    columns: Responses,
    /// Number of components of a displacement D.
    size: usize,
}

impl Extension {
    /// Computes the matrix for forces on the contact nodes of `nodal`, whose displacement by `responses`
    /// under a unit force on a node along an axis is converted by `carry` to the numbers of the target
    /// mesh (D). Runs on the calling thread alone: a pool thread that waited for others could be given
    /// a press that waits for this matrix.
    pub(super) fn new(
        nodal: &Nodal,
        responses: &FaceResponses,
        carry: impl Fn(&[Vector3<f64>], [usize; 2]) -> Vec<f64>,
    ) -> Self {
        let answers = nodal.unit_responses(responses, carry);
        let size = answers.first().map_or(0, Vec::len);
        let moved = |answer: &Vec<f64>| answer.iter().rposition(|u| *u != 0.0);
        let free = answers.iter().filter_map(moved).max().map_or(0, |last| last + 1);
        let mut columns = Responses::new(free);
        for answer in &answers {
            columns.push(answer[..free].iter().copied());
        }
        Self { columns, size }
    }

    /// Displacement (D) in m under forces (N) on some nodes of the face.
    pub(super) fn displacement(&self, forces: &[(u32, Vector3<f64>)]) -> Vec<f32> {
        let mut all = vec![0.0; self.size.max(self.columns.len())];
        for (node, force) in forces {
            self.columns.add(*node, force, &mut all);
        }
        all.truncate(self.size);
        all
    }
}
