//! Dense systems of a contact region: condensed stiffness and the springs of touching points.

use faer::{
    Col, Mat, MatRef, Side,
    linalg::solvers::{Llt, PartialPivLu, Solve},
};
use nalgebra::Matrix3;

use super::{region::Region, springs::Spring};

/// A factorised matrix.
pub(super) enum DenseFactor {
    /// Cholesky factors L Lᵀ.
    Symmetric(Llt<f64>),
    /// Factors P L U.
    General(PartialPivLu<f64>),
}

impl DenseFactor {
    /// Factorises the `stiffness` of a region's last unknowns (lower triangle) with `springs` at
    /// its points added; `None` if that is symmetric and not positive definite, or if a point also
    /// depends on other nodes of the region.
    pub(super) fn new(
        region: &Region,
        stiffness: MatRef<'_, f64>,
        springs: &[Spring],
    ) -> Option<Self> {
        let mut matrix = stiffness.to_owned();
        let symmetric = springs.iter().all(|spring| spring.symmetric);
        if !symmetric {
            mirror(&mut matrix);
        }
        let mut local = Local::default();
        for spring in springs {
            let carriers = region.carriers_among_last(matrix.ncols(), spring.point)?;
            if !carriers.clone().map(|(i, _)| i).eq(local.carriers.iter().copied()) {
                local.add_to(&mut matrix, symmetric);
                local = Local::new(carriers.clone().map(|(i, _)| i).collect());
            }
            local.add(carriers.map(|(_, share)| share), &spring.stiffness);
        }
        local.add_to(&mut matrix, symmetric);
        Some(if symmetric {
            Self::Symmetric(matrix.llt(Side::Lower).ok()?)
        } else {
            Self::General(matrix.partial_piv_lu())
        })
    }

    /// Solves in place.
    pub(super) fn solve(&self, right: &mut Col<f64>) {
        match self {
            Self::Symmetric(factors) => factors.solve_in_place(right),
            Self::General(factors) => factors.solve_in_place(right),
        }
    }
}

/// Summed stiffness of points that are interpolated from the same nodes.
#[derive(Default)]
struct Local {
    /// First unknown of each node.
    carriers: Vec<usize>,
    /// Entries by columns; three rows and columns to a node.
    values: Vec<f64>,
}

impl Local {
    fn new(carriers: Vec<usize>) -> Self {
        let values = vec![0.0; 9 * carriers.len() * carriers.len()];
        Self { carriers, values }
    }

    /// Adds the `stiffness` of a point that is interpolated with the weights `shares`.
    fn add(&mut self, shares: impl Iterator<Item = f64> + Clone, stiffness: &Matrix3<f64>) {
        let size = 3 * self.carriers.len();
        let columns = [0, 1, 2].map(|l| -> Vec<f64> {
            let column: [f64; 3] = stiffness.column(l).into_owned().into();
            shares.clone().flat_map(|share| column.map(|x| x * share)).collect()
        });
        let to = self.values.chunks_mut(3 * size).zip(shares);
        for (to, share) in to {
            for (to, column) in to.chunks_mut(size).zip(&columns) {
                to.iter_mut().zip(column).for_each(|(to, x)| *to += x * share);
            }
        }
    }

    /// Adds the sum to `matrix`, to its lower triangle alone if `only_lower`.
    fn add_to(&self, matrix: &mut Mat<f64>, only_lower: bool) {
        let size = 3 * self.carriers.len();
        for (j, column) in self.values.chunks(size.max(1)).enumerate() {
            let first = self.carriers[j / 3];
            let to = matrix.col_as_slice_mut(first + j % 3);
            for (&i, values) in self.carriers.iter().zip(column.as_chunks::<3>().0) {
                if i >= first || !only_lower {
                    to[i..i + 3].iter_mut().zip(values).for_each(|(to, x)| *to += x);
                }
            }
        }
    }
}

/// Copies the lower triangle to the upper one.
fn mirror(matrix: &mut Mat<f64>) {
    for j in 0..matrix.ncols() {
        for i in 0..j {
            matrix[(i, j)] = matrix[(j, i)];
        }
    }
}
