//! Acceleration of a fixed-point iteration x ← x + r(x) (Anderson 1965; Walker and Ni 2011).
//!
//! The combination of the last iterates with the smallest r, taken as linear, is computed; a plain
//! step from there leads to the next iterate.

use nalgebra::{DMatrix, DVector, Vector3};

/// Record of the last iterates.
pub(super) struct Mixing {
    /// Greatest number of earlier iterates kept.
    depth: usize,
    /// Iterates with their r, oldest first.
    iterates: Vec<[Vec<Vector3<f64>>; 2]>,
}

impl Mixing {
    /// Returns an empty record that keeps `depth` iterates before the last.
    pub(super) fn new(depth: usize) -> Self {
        Self { depth, iterates: Vec::new() }
    }

    /// Adds the iterate `x` with its plain step `r`.
    pub(super) fn record(&mut self, x: &[Vector3<f64>], r: &[Vector3<f64>]) {
        if self.iterates.len() > self.depth {
            self.iterates.remove(0);
        }
        self.iterates.push([x.to_vec(), r.to_vec()]);
    }

    /// Next iterate for these [`Mixing::shares`]; empty if none was recorded.
    pub(super) fn next(&self, shares: &[f64]) -> Vec<Vector3<f64>> {
        let Some(([x, r], before)) = self.iterates.split_last() else { return Vec::new() };
        let mut next: Vec<_> = x.iter().zip(r).map(|(x, r)| x + r).collect();
        for ([x_before, r_before], share) in before.iter().zip(shares) {
            let back = x_before.iter().zip(r_before).zip(x.iter().zip(r));
            for (next, ((x_before, r_before), (x, r))) in next.iter_mut().zip(back) {
                *next += (x_before + r_before - x - r) * *share;
            }
        }
        next
    }

    /// Shares γ of the earlier iterates, oldest first, that minimise ‖r + Σ γᵢ (rᵢ − r)‖.
    pub(super) fn shares(&self) -> Vec<f64> {
        let Some(([_, r], before)) = self.iterates.split_last() else { return Vec::new() };
        let change = |[_, other]: &[Vec<Vector3<f64>>; 2]| -> Vec<Vector3<f64>> {
            other.iter().zip(r).map(|(other, r)| other - r).collect()
        };
        let changes: Vec<_> = before.iter().map(change).collect();
        let count = changes.len();
        let mut gram = DMatrix::from_fn(count, count, |i, j| dot(&changes[i], &changes[j]));
        for i in 0..count {
            gram[(i, i)] *= 1.0 + 1e-10;
        }
        let right = DVector::from_iterator(count, changes.iter().map(|change| -dot(change, r)));
        let solution = gram.cholesky().map(|factor| factor.solve(&right));
        solution.map_or_else(|| vec![0.0; count], |shares| shares.iter().copied().collect())
    }
}

fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_iteration_that_diverges_is_solved_in_as_many_steps_as_unknowns() {
        // x ← x + r with r = b − A x and eigenvalues of A far above 2.
        let matrix = nalgebra::Matrix3::new(5.0, 1.0, 0.0, 1.0, 7.0, 0.5, 0.0, 0.5, 3.0);
        let right = Vector3::new(1.0, -2.0, 0.5);
        let (mut mixing, mut x) = (Mixing::new(5), vec![Vector3::zeros()]);
        for _ in 0..5 {
            mixing.record(&x, &[right - matrix * x[0]]);
            x = mixing.next(&mixing.shares());
        }
        let error = (right - matrix * x[0]).norm() / right.norm();
        // The normal equations square the condition number, about 1e2.
        assert!(error < 1e-8, "relative residual {error:.1e}");
    }
}
