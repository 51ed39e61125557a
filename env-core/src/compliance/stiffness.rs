//! Stiffness of the contact and the linear system of its Newton step.
//!
//! Arrays are those of a [`Zone`], m free nodes; A of them touch.

use faer::{
    Conj, MatMut, MatRef,
    linalg::solvers::{PartialPivLu, SolveCore},
};
use nalgebra::{Matrix3, Vector3};

use super::zone::Zone;
use crate::contact::SurfacePoint;

/// H = −∂t/∂u between the free nodes that touch.
pub(super) struct Stiffness {
    /// The nodes (A).
    active: Vec<usize>,
    /// Rank of each free node among them (m).
    rank: Vec<usize>,
    /// Blocks of each node's column, with the rank of their row (N/m).
    columns: Vec<Vec<(usize, Matrix3<f64>)>>,
}

impl Stiffness {
    /// Of no touch among `free` nodes.
    pub(super) fn new(free: usize) -> Self {
        Self { active: Vec::new(), rank: vec![usize::MAX; free], columns: Vec::new() }
    }

    /// Adds a touching `point` of stiffness `block` (N/m).
    pub(super) fn add(&mut self, point: &SurfacePoint, block: &Matrix3<f64>) {
        for &(column, t) in &point.shares {
            let Some(column) = self.rank_of(column as usize) else { continue };
            for &(row, s) in &point.shares {
                let Some(row) = self.rank_of(row as usize) else { continue };
                let value = block * (s * t);
                let blocks = &mut self.columns[column];
                match blocks.iter_mut().find(|(known, _)| *known == row) {
                    Some((_, sum)) => *sum += value,
                    None => blocks.push((row, value)),
                }
            }
        }
    }

    /// Rank of `node`, new if need be; `None` if it is fixed.
    fn rank_of(&mut self, node: usize) -> Option<usize> {
        let rank = self.rank.get_mut(node)?;
        if *rank == usize::MAX {
            *rank = self.active.len();
            self.active.push(node);
            self.columns.push(Vec::new());
        }
        Some(*rank)
    }

    /// Takes H `moved` (A) from `forces` (m).
    pub(super) fn relieve(&self, forces: &mut [Vector3<f64>], moved: &[Vector3<f64>]) {
        for (column, du) in self.columns.iter().zip(moved) {
            for (row, block) in column {
                forces[self.active[*row]] -= block * du;
            }
        }
    }

    /// Solves (1 + C H) x = `right` (m) on the nodes that touch (A), or `None` if that has no finite
    /// solution.
    pub(super) fn solve(&self, zone: &Zone, right: &[Vector3<f64>]) -> Option<Vec<Vector3<f64>>> {
        let matrix = self.matrix(zone);
        let right = self.active.iter().flat_map(|&node| right[node].iter().copied());
        let mut solution: Vec<f64> = right.collect();
        let size = solution.len();
        let factor = PartialPivLu::new(MatRef::from_column_major_slice(&matrix, size, size));
        let in_place = MatMut::from_column_major_slice_mut(&mut solution, size, 1);
        factor.solve_in_place_with_conj(Conj::No, in_place);
        let finite = solution.iter().all(|x| x.is_finite());
        finite.then(|| solution.as_chunks::<3>().0.iter().map(|&x| Vector3::from(x)).collect())
    }

    /// 1 + C H, by columns.
    fn matrix(&self, zone: &Zone) -> Vec<f64> {
        let size = 3 * self.active.len();
        let compliance = self.compliance(zone);
        let mut matrix = vec![0.0; size * size];
        for (rank, blocks) in self.columns.iter().enumerate() {
            let columns = &mut matrix[3 * rank * size..][..3 * size];
            for (k, column) in columns.chunks_mut(size).enumerate() {
                column[3 * rank + k] = 1.0;
                for (row, block) in blocks {
                    let [x, y, z] = [0, 1, 2].map(|l| &compliance[(3 * row + l) * size..][..size]);
                    let h = block.column(k);
                    for (((sum, x), y), z) in column.iter_mut().zip(x).zip(y).zip(z) {
                        *sum += h[0] * x + h[1] * y + h[2] * z;
                    }
                }
            }
        }
        matrix
    }

    /// The compliance between the nodes that touch; it is symmetric.
    fn compliance(&self, zone: &Zone) -> Vec<f64> {
        let mut compliance = Vec::with_capacity(9 * self.active.len() * self.active.len());
        for &node in &self.active {
            for i in 0..3 {
                let row = zone.row(node, i);
                for &column in &self.active {
                    compliance.extend_from_slice(&row[3 * column..3 * column + 3]);
                }
            }
        }
        compliance
    }
}
