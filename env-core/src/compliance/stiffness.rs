//! Stiffness of the contact and the linear system of its Newton step.
//!
//! Arrays are those of a [`Zone`], m free nodes; A of them touch.

use faer::{
    Accum, MatMut, MatRef, Par, Spec,
    dyn_stack::{MemBuffer, MemStack, StackReq},
    linalg::{
        lu::partial_pivoting::{factor, solve},
        matmul::matmul,
    },
};
use nalgebra::Matrix3;

use super::zone::Zone;
use crate::contact::SurfacePoint;

/// The dense system of a Newton step. Its memory is used again: taking as much from the system every
/// time costs more than the arithmetic.
#[derive(Default)]
pub(super) struct Dense {
    /// The nodes that touch, ascending (A).
    active: Vec<usize>,
    /// H = −∂t/∂u between them, by columns (3A, 3A) in N/m.
    stiffness: Vec<f64>,
    /// C between them, by columns (3A, 3A) in m/N.
    compliance: Vec<f64>,
    /// 1 + C H, then its factors.
    matrix: Vec<f64>,
}

impl Dense {
    /// Takes up touching points with their own stiffness (N/m).
    pub(super) fn assemble(&mut self, zone: &Zone, touching: &[(&SurfacePoint, Matrix3<f64>)]) {
        let mut rank = vec![usize::MAX; zone.free];
        for node in touching.iter().flat_map(|(point, _)| carriers(point)) {
            if let Some(rank) = rank.get_mut(node as usize) {
                *rank = 0;
            }
        }
        self.active.clear();
        self.active.extend((0..zone.free).filter(|&node| rank[node] == 0));
        self.active.iter().enumerate().for_each(|(i, &node)| rank[node] = i);
        let size = 3 * self.active.len();
        self.stiffness.clear();
        self.stiffness.resize(size * size, 0.0);
        for run in touching.chunk_by(|(a, _), (b, _)| carriers(a).eq(carriers(b))) {
            let ranks: Vec<_> =
                carriers(run[0].0).map(|node| rank.get(node as usize).copied()).collect();
            add_block(&mut self.stiffness, size, &local_stiffness(run), &ranks);
        }
    }

    /// The nodes that touch (A).
    pub(super) fn active(&self) -> &[usize] {
        &self.active
    }

    /// H x (3A).
    pub(super) fn times(&self, x: &[f64]) -> Vec<f64> {
        let mut product = vec![0.0; x.len()];
        for (column, x) in self.stiffness.chunks(x.len().max(1)).zip(x) {
            product.iter_mut().zip(column).for_each(|(sum, value)| *sum += x * value);
        }
        product
    }

    /// Solves (1 + C H) x = `right` (3A), or `None` if that has no finite solution.
    pub(super) fn solve(&mut self, zone: &Zone, mut right: Vec<f64>) -> Option<Vec<f64>> {
        let size = right.len();
        zone.compliance_between(&self.active, &mut self.compliance);
        self.matrix.clear();
        self.matrix.resize(size * size, 0.0);
        self.matrix.iter_mut().step_by(size + 1).for_each(|diagonal| *diagonal = 1.0);
        let [c, h] = [&self.compliance, &self.stiffness]
            .map(|numbers| MatRef::from_column_major_slice(numbers, size, size));
        let mut matrix = MatMut::from_column_major_slice_mut(&mut self.matrix, size, size);
        matmul(matrix.as_mut(), Accum::Add, c, h, 1.0, Par::Seq);
        let mut buffer = MemBuffer::new(StackReq::any_of(&[
            factor::lu_in_place_scratch::<usize, f64>(size, size, Par::Seq, Spec::default()),
            solve::solve_in_place_scratch::<usize, f64>(size, 1, Par::Seq),
        ]));
        let stack = MemStack::new(&mut buffer);
        let (mut pivots, mut back) = (vec![0usize; size], vec![0; size]);
        let (_, order) = factor::lu_in_place(
            matrix.as_mut(),
            &mut pivots,
            &mut back,
            Par::Seq,
            stack,
            Spec::default(),
        );
        let (lower, upper) = (matrix.as_ref(), matrix.as_ref());
        let in_place = MatMut::from_column_major_slice_mut(&mut right, size, 1);
        solve::solve_in_place(lower, upper, order, in_place, Par::Seq, stack);
        right.iter().all(|x| x.is_finite()).then_some(right)
    }
}

fn carriers(point: &SurfacePoint) -> impl Iterator<Item = u32> {
    point.shares.iter().map(|&(node, _)| node)
}

/// Adds a `block` between nodes of the given `ranks` to a matrix of `size` rows; nodes without a rank
/// are fixed.
fn add_block(matrix: &mut [f64], size: usize, block: &[f64], ranks: &[Option<usize>]) {
    let columns = (0..3 * ranks.len()).map(|k| ranks[k / 3].map(|rank| 3 * rank + k % 3));
    for (from, to) in block.chunks(3 * ranks.len()).zip(columns) {
        let Some(to) = to else { continue };
        let to = &mut matrix[to * size..][..size];
        for (values, rank) in from.as_chunks::<3>().0.iter().zip(ranks) {
            let Some(rank) = rank else { continue };
            to[3 * rank..][..3].iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        }
    }
}

/// Stiffness between the carriers of points that have them in common, by columns.
fn local_stiffness(run: &[(&SurfacePoint, Matrix3<f64>)]) -> Vec<f64> {
    let size = 3 * run[0].0.shares.len();
    let (mut local, mut rows) = (vec![0.0; size * size], vec![0.0; size]);
    for (point, block) in run {
        for k in 0..3 {
            let column = block.column(k);
            for (rows, (_, share)) in rows.as_chunks_mut::<3>().0.iter_mut().zip(&point.shares) {
                *rows = [0, 1, 2].map(|i| share * column[i]);
            }
            for (to, (_, share)) in local.chunks_mut(3 * size).zip(&point.shares) {
                let to = &mut to[k * size..][..size];
                to.iter_mut().zip(&rows).for_each(|(sum, value)| *sum += share * value);
            }
        }
    }
    local
}
