//! Solution of unsymmetric systems close to the identity (Saad and Schultz 1986, GMRES).

/// Most products with the matrix.
const MOST: usize = 15;
/// Residual at which the iteration stops, relative to the right-hand side.
const RELATIVE: f64 = 1e-3;

/// Result of [`gmres`].
pub(crate) struct GmresSolution {
    /// The approximate solution.
    pub(crate) x: Vec<f64>,
    /// `true` if its residual is small enough.
    pub(crate) converged: bool,
}

/// Returns an approximate x with `product`(x) = `right`.
pub(crate) fn gmres(mut product: impl FnMut(&[f64]) -> Vec<f64>, right: &[f64]) -> GmresSolution {
    let size = norm(right);
    if size == 0.0 {
        return GmresSolution { x: right.to_vec(), converged: true };
    }
    let mut basis = vec![scaled(right, 1.0 / size)];
    // Columns of the triangular factor, the rotations that made it, and the rotated right side.
    let (mut upper, mut rotations): (Vec<Vec<f64>>, Vec<(f64, f64)>) = (Vec::new(), Vec::new());
    let mut projected = vec![size];
    let mut converged = false;
    while !converged && upper.len() < MOST {
        let mut next = product(&basis[upper.len()]);
        let mut column: Vec<f64> = Vec::with_capacity(basis.len() + 1);
        for vector in &basis {
            let share = dot(&next, vector);
            add(&mut next, -share, vector);
            column.push(share);
        }
        let rest = norm(&next);
        for (i, &(c, s)) in rotations.iter().enumerate() {
            (column[i], column[i + 1]) =
                (c * column[i] + s * column[i + 1], c * column[i + 1] - s * column[i]);
        }
        let last = column.len() - 1;
        let length = column[last].hypot(rest);
        let (c, s) = (column[last] / length, rest / length);
        column[last] = length;
        projected.push(-s * projected[last]);
        projected[last] *= c;
        rotations.push((c, s));
        upper.push(column);
        converged = projected[last + 1].abs() <= RELATIVE * size || rest == 0.0;
        basis.push(scaled(&next, 1.0 / rest));
    }
    GmresSolution { x: combine(&basis, &upper, &projected), converged }
}

/// Returns Σ yᵢ `basis`ᵢ with `upper` y = `projected`.
fn combine(basis: &[Vec<f64>], upper: &[Vec<f64>], projected: &[f64]) -> Vec<f64> {
    let mut y = projected[..upper.len()].to_vec();
    for i in (0..y.len()).rev() {
        y[i] /= upper[i][i];
        for k in 0..i {
            y[k] -= upper[i][k] * y[i];
        }
    }
    let mut x = vec![0.0; basis[0].len()];
    y.iter().zip(basis).for_each(|(&y, vector)| add(&mut x, y, vector));
    x
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub(super) fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

fn scaled(a: &[f64], factor: f64) -> Vec<f64> {
    a.iter().map(|x| x * factor).collect()
}

fn add(a: &mut [f64], factor: f64, b: &[f64]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += factor * b);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unsymmetric_system_is_solved() {
        let matrix = [[1.0, 0.5, 0.0], [-0.3, 1.2, 0.1], [0.0, -0.4, 0.9]];
        let product = |x: &[f64]| matrix.iter().map(|row| dot(row, x)).collect::<Vec<_>>();
        let right = [1.0, -2.0, 0.5];
        let mut rest = product(&gmres(product, &right).x);
        add(&mut rest, -1.0, &right);
        // Three unknowns need three products; what remains is rounding.
        assert!(norm(&rest) < 1e-14, "residual {:.1e}", norm(&rest));
    }
}
