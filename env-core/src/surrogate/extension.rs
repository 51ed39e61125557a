//! From forces on the nodes of a pad's face to the displacement of the whole model mesh: a dense matrix
//! in single precision, made once.
//!
//! Shapes: C nodes of the face, V nodes of the model mesh, the first F of them free.

use nalgebra::Vector3;

use crate::{compliance::nodal::Nodal, geometry::Transfer, simd::add_rows};

/// The matrix.
pub(super) struct Extension {
    /// Displacement of the free nodes under a unit force along each axis on each node of the face
    /// (3C, 3F) in m/N.
    columns: Vec<f32>,
    /// F and V.
    free: usize,
    nodes: usize,
}

impl Extension {
    /// That of `nodal`, whose fields `transfer` carries to the model mesh.
    pub(super) fn new(nodal: &Nodal, transfer: &Transfer) -> Self {
        let answers = nodal.unit_responses(&|displacement| transfer.interpolate(displacement));
        let nodes = answers.first().map_or(0, Vec::len);
        let moved =
            |answer: &Vec<Vector3<f64>>| answer.iter().rposition(|u| *u != Vector3::zeros());
        let free = answers.iter().filter_map(moved).max().map_or(0, |last| last + 1);
        let numbers = answers.iter().flat_map(|answer| &answer[..free]);
        let columns = numbers.flat_map(|u| [u.x, u.y, u.z].map(|x| x as f32)).collect();
        Self { columns, free, nodes }
    }

    /// Displacement (V) in m under forces (N) on some nodes of the face.
    pub(super) fn displacement(&self, forces: &[(u32, Vector3<f64>)]) -> Vec<Vector3<f64>> {
        let size = 3 * self.free;
        let mut sum = vec![0.0_f32; size];
        for (node, force) in forces {
            let rows = &self.columns[3 * size * *node as usize..];
            let rows = [0, 1, 2].map(|axis| &rows[axis * size..][..size]);
            add_rows(&mut sum, rows, (*force).map(|x| x as f32).into());
        }
        let mut all = vec![Vector3::zeros(); self.nodes];
        for (u, sum) in all.iter_mut().zip(sum.as_chunks::<3>().0) {
            *u = Vector3::from(*sum).cast();
        }
        all
    }

    /// The forces (V) in N on all nodes: those of the face come first.
    pub(super) fn contact_force(&self, forces: &[(u32, Vector3<f64>)]) -> Vec<Vector3<f64>> {
        let mut all = vec![Vector3::zeros(); self.nodes];
        for (node, force) in forces {
            all[*node as usize] = *force;
        }
        all
    }
}
