//! Small dense systems.

use faer::{
    Conj, MatMut, MatRef,
    linalg::solvers::{PartialPivLu, SolveCore},
};

/// Solution of a square system by LU, `matrix` by columns; `None` if it is not finite.
pub(super) fn solve_dense(matrix: &[f64], mut right: Vec<f64>) -> Option<Vec<f64>> {
    let size = right.len();
    let matrix = MatRef::from_column_major_slice(matrix, size, size);
    let factor = PartialPivLu::new(matrix);
    factor.solve_in_place_with_conj(
        Conj::No,
        MatMut::from_column_major_slice_mut(&mut right, size, 1),
    );
    right.iter().all(|x| x.is_finite()).then_some(right)
}
