//! Products with a fixed sparse matrix: pooling, interpolation, gathering, gradients in tetrahedra.

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor};

use super::{numbers, with_numbers};

/// A sparse matrix stored by rows.
#[derive(Clone, Debug, PartialEq)]
pub(in super::super) struct Sparse {
    /// Columns of the entries, row after row.
    columns: Vec<u32>,
    /// Values of the entries.
    values: Vec<f32>,
    /// Index of the first entry of each row, and the number of entries.
    starts: Vec<u32>,
    /// Number of columns.
    width: usize,
}

impl Sparse {
    /// Creates the matrix of `width` columns with the given (column, value) entries in its rows.
    pub(in super::super) fn new(rows: &[Vec<(u32, f32)>], width: usize) -> Self {
        let entries = rows.iter().flatten();
        let ends = rows.iter().scan(0, |end, row| {
            *end += row.len() as u32;
            Some(*end)
        });
        Self {
            columns: entries.clone().map(|(column, _)| *column).collect(),
            values: entries.map(|(_, value)| *value).collect(),
            starts: std::iter::once(0).chain(ends).collect(),
            width,
        }
    }

    pub(in super::super) fn height(&self) -> usize {
        self.starts.len() - 1
    }

    /// Returns the transpose with every row scaled to a sum of 1.
    pub(in super::super) fn pooling(&self) -> Self {
        let mut rows = vec![Vec::new(); self.width];
        for row in 0..self.height() {
            for (column, value) in self.row(row) {
                rows[column].push((row as u32, value));
            }
        }
        for row in &mut rows {
            let sum: f32 = row.iter().map(|(_, value)| value).sum();
            for (_, value) in row {
                *value /= sum;
            }
        }
        Self::new(&rows, self.height())
    }

    #[inline(always)]
    pub(in super::super) fn row(&self, row: usize) -> impl Iterator<Item = (usize, f32)> {
        let range = self.starts[row] as usize..self.starts[row + 1] as usize;
        let values = self.values[range.clone()].iter();
        self.columns[range].iter().zip(values).map(|(&column, &value)| (column as usize, value))
    }

    /// Adds the product with `x` (width, H) to `y` (height, H).
    #[inline(always)]
    pub(in super::super) fn add_product(&self, x: &[f32], y: &mut [f32], channels: usize) {
        for (row, y) in y.chunks_exact_mut(channels).enumerate() {
            for (column, value) in self.row(row) {
                let x = &x[column * channels..][..channels];
                y.iter_mut().zip(x).for_each(|(y, x)| *y += value * x);
            }
        }
    }

    /// Adds the product of the transpose with `y` (height, H) to `x` (width, H).
    fn add_transposed_product(&self, y: &[f32], x: &mut [f32], channels: usize) {
        for (row, y) in y.chunks_exact(channels).enumerate() {
            for (column, value) in self.row(row) {
                let x = &mut x[column * channels..][..channels];
                x.iter_mut().zip(y).for_each(|(x, y)| *x += value * y);
            }
        }
    }
}

struct Product(Arc<Sparse>);

/// Returns the product of `matrix` (R, C) with every press of `x` (B C, H): (B R, H).
pub(in super::super) fn sparse(x: &Tensor, matrix: &Arc<Sparse>) -> Result<Tensor> {
    x.contiguous()?.apply_op1(Product(Arc::clone(matrix)))
}

impl CustomOp1 for Product {
    fn name(&self) -> &'static str {
        "sparse"
    }

    fn cpu_fwd(&self, x: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (rows, channels) = layout.shape().dims2()?;
        let (x, rows) = (numbers(x, layout)?, rows / self.0.width * self.0.height());
        let mut y = vec![0.0; rows * channels];
        let presses = x.chunks_exact(self.0.width * channels);
        for (x, y) in presses.zip(y.chunks_exact_mut(self.0.height() * channels)) {
            self.0.add_product(x, y, channels);
        }
        Ok((CpuStorage::F32(y), (rows, channels).into()))
    }

    fn bwd(&self, x: &Tensor, _y: &Tensor, gradient: &Tensor) -> Result<Option<Tensor>> {
        let channels = x.dims2()?.1;
        let mut dx = vec![0.0; x.elem_count()];
        with_numbers([gradient], |[gradient]| {
            let presses = gradient.chunks_exact(self.0.height() * channels);
            for (gradient, dx) in presses.zip(dx.chunks_exact_mut(self.0.width * channels)) {
                self.0.add_transposed_product(gradient, dx, channels);
            }
            Ok(())
        })?;
        Tensor::from_vec(dx, x.shape(), x.device()).map(Some)
    }
}

#[cfg(test)]
mod tests {
    use candle_core::Device;

    use super::{super::tests::*, *};

    fn matrix() -> Arc<Sparse> {
        Arc::new(Sparse::new(&[vec![(0, 0.5), (2, 0.25)], vec![(1, 2.0)]], 3))
    }

    #[test]
    fn it_is_the_dense_product_for_every_press() {
        let dense = Tensor::new(&[[0.5_f32, 0.0, 0.25], [0.0, 2.0, 0.0]], &Device::Cpu).unwrap();
        let x = random(&[6, 4], 1);
        let part = |first| dense.matmul(&x.narrow(0, first, 3).unwrap()).unwrap();
        let plain = Tensor::cat(&[part(0), part(3)], 0).unwrap();
        assert!(largest_difference(&sparse(&x, &matrix()).unwrap(), &plain) < 1e-6);
    }

    #[test]
    fn pooling_keeps_constants() {
        let pooled = sparse(
            &Tensor::ones((2, 1), candle_core::DType::F32, &Device::Cpu).unwrap(),
            &Arc::new(matrix().pooling()),
        )
        .unwrap();
        assert_eq!(pooled.flatten_all().unwrap().to_vec1::<f32>().unwrap(), [1.0; 3]);
    }

    #[test]
    fn its_derivative_is_that_of_finite_differences() {
        let x = random(&[6, 4], 1);
        check_derivatives(std::slice::from_ref(&x), || sparse(&x, &matrix()));
    }
}
