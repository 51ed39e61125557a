//! y = x Wᵀ + b, or its positive part, on one thread.

use candle_core::{CpuStorage, CustomOp3, Layout, Result, Shape, Tensor};
use faer::{Accum, MatMut, MatRef, Par, linalg::matmul::matmul};

use super::{numbers, with_numbers};

struct LinearOp {
    relu: bool,
}

/// Returns x Wᵀ + b (N, M) for `x` (N, K), `weight` (M, K) and `bias` (M), or its positive part if
/// `relu`.
pub(in super::super) fn linear_layer(
    x: &Tensor,
    weight: &Tensor,
    bias: &Tensor,
    relu: bool,
) -> Result<Tensor> {
    x.contiguous()?.apply_op3(weight, bias, LinearOp { relu })
}

/// Computes c = a b, or c += a b if `add`, for matrices (m, k) and (k, n).
pub(in super::super) fn product(c: MatMut<f32>, a: MatRef<f32>, b: MatRef<f32>, add: bool) {
    let into = if add { Accum::Add } else { Accum::Replace };
    matmul(c, into, a, b, 1.0, Par::Seq);
}

/// Views numbers as a row-major matrix.
fn matrix(numbers: &[f32], rows: usize, columns: usize) -> MatRef<'_, f32> {
    MatRef::from_row_major_slice(numbers, rows, columns)
}

fn matrix_mut(numbers: &mut [f32], rows: usize, columns: usize) -> MatMut<'_, f32> {
    MatMut::from_row_major_slice_mut(numbers, rows, columns)
}

impl CustomOp3 for LinearOp {
    fn name(&self) -> &'static str {
        "linear_layer"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        weight: &CpuStorage,
        weight_layout: &Layout,
        bias: &CpuStorage,
        bias_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (rows, inner) = x_layout.shape().dims2()?;
        let columns = weight_layout.shape().dims2()?.0;
        let (x, weight) = (numbers(x, x_layout)?, numbers(weight, weight_layout)?);
        let mut y = numbers(bias, bias_layout)?.repeat(rows);
        let into = matrix_mut(&mut y, rows, columns);
        product(into, matrix(x, rows, inner), matrix(weight, columns, inner).transpose(), true);
        if self.relu {
            for y in &mut y {
                *y = y.max(0.0);
            }
        }
        Ok((CpuStorage::F32(y), (rows, columns).into()))
    }

    fn bwd(
        &self,
        x: &Tensor,
        weight: &Tensor,
        bias: &Tensor,
        y: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let ((rows, inner), columns) = (x.dims2()?, bias.dims1()?);
        let (mut dx, mut dw) = (vec![0.0; rows * inner], vec![0.0; columns * inner]);
        let mut db = vec![0.0; columns];
        with_numbers([x, weight, y, gradient], |[x, weight, y, gradient]| {
            let mut passed = gradient.to_vec();
            if self.relu {
                passed.iter_mut().zip(y).filter(|(_, y)| **y <= 0.0).for_each(|(g, _)| *g = 0.0);
            }
            for row in passed.chunks_exact(columns) {
                db.iter_mut().zip(row).for_each(|(sum, g)| *sum += g);
            }
            let passed = matrix(&passed, rows, columns);
            let (x, weight) = (matrix(x, rows, inner), matrix(weight, columns, inner));
            product(matrix_mut(&mut dx, rows, inner), passed, weight, false);
            product(matrix_mut(&mut dw, columns, inner), passed.transpose(), x, false);
            Ok(())
        })?;
        let tensor = |values, shape: &[usize]| Tensor::from_vec(values, shape, x.device());
        Ok((
            Some(tensor(dx, &[rows, inner])?),
            Some(tensor(dw, &[columns, inner])?),
            Some(tensor(db, &[columns])?),
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::{super::tests::*, *};

    #[test]
    fn it_is_candles_product_and_sum() {
        let (x, w, b) = (random(&[5, 3], 1), random(&[4, 3], 2), random(&[4], 3));
        let plain = x.matmul(&w.t().unwrap()).unwrap().broadcast_add(&b).unwrap();
        let own = linear_layer(&x, &w, &b, false).unwrap();
        assert!(largest_difference(&own, &plain) < 1e-6);
        let own = linear_layer(&x, &w, &b, true).unwrap();
        assert!(largest_difference(&own, &plain.relu().unwrap()) < 1e-6);
    }

    #[test]
    fn its_derivatives_are_those_of_finite_differences() {
        let inputs = [random(&[5, 3], 1), random(&[4, 3], 2), random(&[4], 3)];
        for relu in [false, true] {
            check_derivatives(&inputs, || linear_layer(&inputs[0], &inputs[1], &inputs[2], relu));
        }
    }
}
