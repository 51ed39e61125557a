//! Dense matrix from forces on the nodes of a pad's face to the displacement of a whole mesh,
//! computed once.
//!
//! Shapes: C nodes of the face, D numbers of a displacement, of which trailing ones may always be
//! zero.

use nalgebra::Vector3;

use crate::responses::Responses;

/// The matrix.
pub(super) struct Extension {
    /// Displacement under a unit force along each axis on each node of the face (3C, D) in m/N,
    /// without trailing numbers that are always zero.
    columns: Responses,
    /// Number of components of a displacement D.
    size: usize,
}

impl Extension {
    /// Takes the displacement of `size` numbers D under a unit force on each node along each axis
    /// (3C), of which trailing zeros may be left out. Runs on the calling thread alone: a pool
    /// thread that waited for others could be given a press that waits for this matrix.
    pub(super) fn new(answers: impl Iterator<Item = Vec<f64>>, size: usize) -> Self {
        let answers: Vec<_> = answers.collect();
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
