//! The symmetric sparse matrix of node-to-node couplings, and its Cholesky factorisation by faer.

use faer::{
    Conj, Mat, MatMut, Par, Side, Spec,
    dyn_stack::{MemBuffer, MemStack, StackReq},
    linalg::cholesky::llt::factor::LltRegularization,
    sparse::{
        SparseColMatRef, SymbolicSparseColMatRef,
        linalg::cholesky::{LltRef, SymbolicCholeskyRaw, supernodal::SupernodalLltRef},
    },
};
use nalgebra::Matrix3;

use super::pattern::{BlockPosition, Pattern};

/// Values of the upper triangle, and the factor L of L Lᵀ made from them.
pub(super) struct Matrix {
    values: Vec<f64>,
    factor: Vec<f64>,
    scratch: MemBuffer,
}

/// Most right-hand sides solved at once.
pub(super) const MOST_COLUMNS: usize = 32;

impl Pattern {
    /// Returns a matrix of this pattern with zero values.
    pub(super) fn matrix(&self) -> Matrix {
        let needs = StackReq::any_of(&[
            self.symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default()),
            self.solve_needs(),
        ]);
        Matrix {
            values: vec![0.0; self.row.len()],
            factor: vec![0.0; self.symbolic.len_val()],
            scratch: MemBuffer::new(needs),
        }
    }

    fn solve_needs(&self) -> StackReq {
        self.symbolic.solve_in_place_scratch::<f64>(MOST_COLUMNS, Par::Seq)
    }

    /// Working memory of [`Factor::solve`].
    pub(super) fn workspace(&self) -> MemBuffer {
        MemBuffer::new(self.solve_needs())
    }

    fn factor<'a>(&'a self, values: &'a [f64]) -> SupernodalLltRef<'a, u32, f64> {
        match self.symbolic.raw() {
            SymbolicCholeskyRaw::Supernodal(symbolic) => SupernodalLltRef::new(symbolic, values),
            SymbolicCholeskyRaw::Simplicial(_) => unreachable!("supernodes were asked for"),
        }
    }
}

impl Matrix {
    /// Sets every value to zero.
    pub(super) fn clear(&mut self) {
        self.values.fill(0.0);
    }

    /// Adds `value` to the block at `position`.
    pub(super) fn add(&mut self, position: BlockPosition, value: &Matrix3<f64>) {
        let mut top = position.first as usize;
        for i in 0..3 {
            let rows = if position.diagonal { i + 1 } else { 3 };
            for (j, entry) in self.values[top..top + rows].iter_mut().enumerate() {
                *entry += if position.turned { value[(j, i)] } else { value[(i, j)] };
            }
            top += position.above as usize + i + 1;
        }
    }

    /// Adds `value` to the diagonal.
    pub(super) fn shift(&mut self, pattern: &Pattern, value: f64) {
        for &end in &pattern.column[1..] {
            self.values[end as usize - 1] += value;
        }
    }

    /// Mean of the diagonal.
    pub(super) fn mean_diagonal(&self, pattern: &Pattern) -> f64 {
        let ends = &pattern.column[1..];
        ends.iter().map(|&end| self.values[end as usize - 1]).sum::<f64>() / ends.len() as f64
    }

    /// Factorises the values; returns `false` if they are not positive definite.
    pub(super) fn factorise(&mut self, pattern: &Pattern) -> bool {
        let size = pattern.size();
        let rows =
            SymbolicSparseColMatRef::new_checked(size, size, &pattern.column, None, &pattern.row);
        let matrix = SparseColMatRef::new(rows, &self.values[..]);
        let factorised = pattern.symbolic.factorize_numeric_llt(
            &mut self.factor,
            matrix,
            Side::Upper,
            LltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut self.scratch),
            Spec::default(),
        );
        factorised.is_ok()
    }

    /// Solves for up to [`MOST_COLUMNS`] right-hand sides in place, after [`Matrix::factorise`].
    pub(super) fn solve(&mut self, pattern: &Pattern, right: &mut [f64]) {
        solve(pattern, &self.factor, &mut self.scratch, right);
    }

    /// Solves L x = `right` in place, after [`Matrix::factorise`].
    pub(super) fn solve_lower(&mut self, pattern: &Pattern, right: &mut [f64]) {
        let (factor, right) = (pattern.factor(&self.factor), column(right));
        factor.l_solve_with_conj(Conj::No, right, Par::Seq, MemStack::new(&mut self.scratch));
    }

    /// Solves Lᵀ x = `right` in place, after [`Matrix::factorise`].
    pub(super) fn solve_upper(&mut self, pattern: &Pattern, right: &mut [f64]) {
        let (factor, right) = (pattern.factor(&self.factor), column(right));
        let scratch = MemStack::new(&mut self.scratch);
        factor.l_transpose_solve_with_conj(Conj::No, right, Par::Seq, scratch);
    }

    /// Part of L that belongs to the last unknowns of the pattern, after [`Matrix::factorise`].
    pub(super) fn corner(&self, pattern: &Pattern) -> Mat<f64> {
        let mut corner = Mat::zeros(pattern.last, pattern.last);
        let first = pattern.size() - pattern.last;
        let factor = pattern.factor(&self.factor);
        for s in (0..factor.symbolic().n_supernodes()).rev() {
            let supernode = factor.supernode(s);
            let (start, values) = (supernode.start(), supernode.val());
            let end = start + values.ncols();
            if end <= first {
                break;
            }
            let below = supernode.pattern().iter().map(|&row| row as usize);
            for (i, row) in (start..end).chain(below).enumerate() {
                for j in first.max(start)..=row.min(end - 1) {
                    corner[(row - first, j - first)] = values[(i, j - start)];
                }
            }
        }
        corner
    }

    /// Returns the factor alone, after [`Matrix::factorise`].
    pub(super) fn into_factor(self) -> Factor {
        Factor { values: self.factor }
    }
}

/// The factor L of L Lᵀ, to be shared between threads.
pub(super) struct Factor {
    values: Vec<f64>,
}

impl Factor {
    /// Solves for up to [`MOST_COLUMNS`] right-hand sides in place, in a [`Pattern::workspace`].
    pub(super) fn solve(&self, pattern: &Pattern, workspace: &mut MemBuffer, right: &mut [f64]) {
        solve(pattern, &self.values, workspace, right);
    }
}

fn column(right: &mut [f64]) -> MatMut<'_, f64> {
    let size = right.len();
    MatMut::from_column_major_slice_mut(right, size, 1)
}

fn solve(pattern: &Pattern, factor: &[f64], workspace: &mut MemBuffer, right: &mut [f64]) {
    let size = pattern.size();
    let columns = right.len() / size;
    let factor = LltRef::new(&pattern.symbolic, factor);
    let right = MatMut::from_column_major_slice_mut(right, size, columns);
    factor.solve_in_place_with_conj(Conj::No, right, Par::Seq, MemStack::new(workspace));
}
