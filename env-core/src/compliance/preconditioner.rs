//! Preconditioner: LU factors of 1 + H C for an earlier set of touches, in single precision.
//!
//! Approximate factors suffice for GMRES; single precision halves their memory and doubles the
//! speed. The matrix is stored transposed, by columns: 1 + C Hᵀ.

#![allow(clippy::inline_always)] // Only inlined functions are compiled for the CPU at hand.

use faer::{
    MatMut, Par, Spec,
    dyn_stack::{MemBuffer, MemStack},
    linalg::lu::partial_pivoting::factor,
};
use nalgebra::Matrix3;

use crate::{
    contact::SurfacePoint,
    simd::{sum, vectorised},
};

/// A touching point with its stiffness (N/m).
pub(super) type Touching<'a> = (&'a SurfacePoint, Matrix3<f64>);

/// LU factors for the nodes that were active at the time of factorisation, which are the first A of
/// all active nodes.
#[derive(Default)]
pub(super) struct Preconditioner {
    /// LU factors of the transposed matrix, by columns (3A, 3A).
    factors: Vec<f32>,
    /// H by rows (3A, 3A) in N/m.
    stiffness: Vec<f32>,
    /// C by rows (3A, 3A) in m/N.
    compliance: Vec<f32>,
    /// Row of the matrix that each pivot was taken from (3A).
    pivots: Vec<usize>,
    /// Inverse of that permutation (3A).
    back: Vec<usize>,
}

impl Preconditioner {
    pub(super) fn clear(&mut self) {
        self.pivots.clear();
    }

    pub(super) fn is_empty(&self) -> bool {
        self.pivots.is_empty()
    }

    /// Computes the factors for nodes of these ranks (m), with the compliance `between` the active
    /// nodes (3A, 3A) in m/N.
    pub(super) fn factorise(&mut self, rank: &[u32], between: &[f64], touching: &[Touching]) {
        let size = between.len().isqrt();
        self.compliance.clear();
        self.compliance.extend(between.iter().map(|&c| c as f32));
        self.stiffness.clear();
        self.stiffness.resize(size * size, 0.0);
        for run in touching.chunk_by(|(a, _), (b, _)| carriers(a).eq(carriers(b))) {
            let ranks: Vec<_> =
                carriers(run[0].0).map(|node| rank.get(node as usize).copied()).collect();
            add_block(&mut self.stiffness, size, &local_stiffness(run), &ranks);
        }
        self.factors.clear();
        self.factors.resize(size * size, 0.0);
        vectorised(
            #[inline(always)]
            || multiply(&mut self.factors, &self.stiffness, &self.compliance, size),
        );
        self.factors.iter_mut().step_by(size + 1).for_each(|diagonal| *diagonal += 1.0);
        let needs =
            factor::lu_in_place_scratch::<usize, f32>(size, size, Par::Seq, Spec::default());
        self.pivots.resize(size, 0);
        self.back.resize(size, 0);
        factor::lu_in_place(
            MatMut::from_column_major_slice_mut(&mut self.factors, size, size),
            &mut self.pivots,
            &mut self.back,
            Par::Seq,
            MemStack::new(&mut MemBuffer::new(needs)),
            Spec::default(),
        );
    }

    /// Replaces `x`, given on all active nodes, by the solution for it; nodes activated after the
    /// factorisation keep their values.
    pub(super) fn apply(&self, x: &mut [f64]) {
        let size = self.pivots.len();
        let mut right: Vec<f32> = x[..size].iter().map(|&x| x as f32).collect();
        vectorised(
            #[inline(always)]
            || substitute(&self.factors, &mut right),
        );
        self.pivots.iter().zip(&right).for_each(|(&to, &value)| x[to] = f64::from(value));
    }
}

/// Solves Uᵀ y = `right`, then Lᵀ x = y in place, with L and U by columns in one matrix.
#[inline(always)]
fn substitute(factors: &[f32], right: &mut [f32]) {
    let size = right.len();
    for (j, column) in factors.chunks(size).enumerate() {
        right[j] = (right[j] - sum(&column[..j], &right[..j], |a, b| a * b)) / column[j];
    }
    for (j, column) in factors.chunks(size).enumerate().rev() {
        right[j] -= sum(&column[j + 1..], &right[j + 1..], |a, b| a * b);
    }
}

fn carriers(point: &SurfacePoint) -> impl Iterator<Item = u32> {
    point.shares.iter().map(|&(node, _)| node)
}

/// Adds `left` × `right` to `product`, all (size, size) by rows; most of `left` is zero.
#[inline(always)]
fn multiply(product: &mut [f32], left: &[f32], right: &[f32], size: usize) {
    for (sum, factors) in product.chunks_mut(size.max(1)).zip(left.chunks(size.max(1))) {
        let rows = right.chunks(3 * size);
        for (&[a, b, c], rows) in factors.as_chunks::<3>().0.iter().zip(rows) {
            if [a, b, c] == [0.0; 3] {
                continue;
            }
            let (x, rest) = rows.split_at(size);
            let (y, z) = rest.split_at(size);
            for (((sum, x), y), z) in sum.iter_mut().zip(x).zip(y).zip(z) {
                *sum += a * x + b * y + c * z;
            }
        }
    }
}

/// Adds a `block` between nodes of the given `ranks` to a matrix of `size` columns; nodes without a
/// rank are fixed.
fn add_block(matrix: &mut [f32], size: usize, block: &[f32], ranks: &[Option<u32>]) {
    let count = ranks.len();
    for (part, values) in block.chunks(count * count).enumerate() {
        let (i, j) = (part / 3, part % 3);
        for (values, row) in values.chunks(count).zip(ranks) {
            let Some(row) = row else { continue };
            let to = &mut matrix[(3 * *row as usize + i) * size..][..size];
            for (value, column) in values.iter().zip(ranks) {
                let Some(column) = column else { continue };
                to[3 * *column as usize + j] += value;
            }
        }
    }
}

/// Stiffness between the nodes that all points of a `run` are interpolated from: nine matrices by
/// rows, one for each pair of components.
fn local_stiffness(run: &[Touching]) -> Vec<f32> {
    let count = run[0].0.shares.len();
    let mut local = vec![0.0; 9 * count * count];
    for (point, stiffness) in run {
        let shares: Vec<f32> = point.shares.iter().map(|&(_, share)| share as f32).collect();
        for (part, sums) in local.chunks_mut(count * count).enumerate() {
            let value = stiffness[(part / 3, part % 3)] as f32;
            for (sums, share) in sums.chunks_mut(count).zip(&shares) {
                let factor = value * share;
                sums.iter_mut().zip(&shares).for_each(|(sum, share)| *sum += factor * share);
            }
        }
    }
    local
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;

    /// 1 + H C in double precision.
    fn plain(count: usize, between: &[f64], touching: &[Touching]) -> DMatrix<f64> {
        let mut stiffness = DMatrix::zeros(3 * count, 3 * count);
        for (point, block) in touching {
            for &(a, share) in &point.shares {
                for &(b, other) in &point.shares {
                    let mut to = stiffness.fixed_view_mut::<3, 3>(3 * a as usize, 3 * b as usize);
                    to += block * (share * other);
                }
            }
        }
        let compliance = DMatrix::from_column_slice(3 * count, 3 * count, between);
        DMatrix::identity(3 * count, 3 * count) + stiffness * compliance
    }

    #[test]
    fn the_factors_solve_the_system_to_single_precision() {
        let count = 8u32;
        let point = |i: u32| SurfacePoint {
            shares: vec![(i, 0.6), (i + 1, 0.5), (i + 2, -0.1)],
            area: 1.0,
            young: 1.0,
        };
        let points: Vec<_> = (0..count - 2).map(point).collect();
        // Slipping friction makes the stiffness unsymmetric.
        let block = Matrix3::new(2.0, 0.1, -0.7, 0.1, 2.0, 0.3, 0.0, 0.0, 9.0);
        let touching: Vec<_> = points.iter().map(|point| (point, block)).collect();
        let size = 3 * count as usize;
        let decay = |k: usize| {
            let (i, j) = (k / size, k % size);
            (1.0 + f64::from(i.abs_diff(j) as u32)).recip() + f64::from(u8::from(i == j))
        };
        let between: Vec<f64> = (0..size * size).map(decay).collect();
        let ranks: Vec<u32> = (0..count).collect();
        let mut preconditioner = Preconditioner::default();
        preconditioner.factorise(&ranks, &between, &touching);
        let right = DVector::from_fn(size, |i, _| (i as f64).sin());
        let mut found = right.clone();
        preconditioner.apply(found.as_mut_slice());
        let exact = plain(count as usize, &between, &touching).lu().solve(&right).unwrap();
        let error = (found - &exact).norm() / exact.norm();
        // Rounding 6e-8 times the condition number, below 1e3.
        assert!(error < 6e-5, "relative error {error:.1e}");
    }
}
