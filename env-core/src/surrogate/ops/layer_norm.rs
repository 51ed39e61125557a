//! Layer norm (Ba, Kiros and Hinton 2016): each row shifted and scaled to mean 0 and variance 1,
//! then scaled and shifted by learnt parameters.
//!
//! The variance is the mean of squared deviations, in a second pass: the mean of squares minus the
//! square of the mean has no digits left when the mean is large.

use candle_core::{CpuStorage, CustomOp3, Layout, Result, Shape, Tensor};

use super::{numbers, with_numbers};
use crate::simd::sum;

/// Added to the variance, which keeps its root away from zero.
const EPSILON: f32 = 1e-5;

struct LayerNormOp;

/// Normalises the rows of `x` (N, H), multiplies by `scale` (H) and adds `shift` (H).
pub(in super::super) fn layer_norm(x: &Tensor, scale: &Tensor, shift: &Tensor) -> Result<Tensor> {
    x.contiguous()?.apply_op3(scale, shift, LayerNormOp)
}

/// Mean of a row, and the inverse of its standard deviation.
#[inline(always)]
pub(in super::super) fn moments(row: &[f32]) -> (f32, f32) {
    let count = row.len() as f32;
    let mean = sum(row, row, |x, _| x) / count;
    let variance = sum(row, row, |x, _| (x - mean) * (x - mean)) / count;
    (mean, 1.0 / (variance + EPSILON).sqrt())
}

impl CustomOp3 for LayerNormOp {
    fn name(&self) -> &'static str {
        "layer-norm"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        scale: &CpuStorage,
        scale_layout: &Layout,
        shift: &CpuStorage,
        shift_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let (scale, shift) = (numbers(scale, scale_layout)?, numbers(shift, shift_layout)?);
        let mut y = numbers(x, x_layout)?.to_vec();
        for row in y.chunks_exact_mut(scale.len()) {
            let (mean, inverse) = moments(row);
            for (y, (scale, shift)) in row.iter_mut().zip(scale.iter().zip(shift)) {
                *y = (*y - mean) * inverse * scale + shift;
            }
        }
        Ok((CpuStorage::F32(y), x_layout.shape().clone()))
    }

    fn bwd(
        &self,
        x: &Tensor,
        scale: &Tensor,
        _shift: &Tensor,
        _y: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let width = scale.dims1()?;
        let mut dx = vec![0.0; x.elem_count()];
        let (mut dscale, mut dshift) = (vec![0.0; width], vec![0.0; width]);
        with_numbers([x, scale, gradient], |[x, scale, gradient]| {
            let rows = x.chunks_exact(width).zip(gradient.chunks_exact(width));
            for ((x, gradient), dx) in rows.zip(dx.chunks_exact_mut(width)) {
                back(x, scale, gradient, dx, &mut dscale, &mut dshift);
            }
            Ok(())
        })?;
        let vector = |values| Tensor::from_vec(values, width, x.device());
        let dx = Tensor::from_vec(dx, x.shape(), x.device())?;
        Ok((Some(dx), Some(vector(dscale)?), Some(vector(dshift)?)))
    }
}

/// Adds the derivatives of one row: with x̂ the normalised row and g its gradient times the scale,
/// dx = (g − mean g − x̂ mean(g x̂)) / σ.
fn back(
    x: &[f32],
    scale: &[f32],
    gradient: &[f32],
    dx: &mut [f32],
    dscale: &mut [f32],
    dshift: &mut [f32],
) {
    let (mean, inverse) = moments(x);
    let (mut sum, mut product) = (0.0, 0.0);
    for (i, (x, g)) in x.iter().zip(gradient).enumerate() {
        let normal = (x - mean) * inverse;
        dscale[i] += g * normal;
        dshift[i] += g;
        sum += g * scale[i];
        product += g * scale[i] * normal;
    }
    let count = x.len() as f32;
    for (i, dx) in dx.iter_mut().enumerate() {
        let normal = (x[i] - mean) * inverse;
        *dx = inverse * (gradient[i] * scale[i] - (sum + normal * product) / count);
    }
}

#[cfg(test)]
mod tests {
    use super::{super::tests::*, *};

    fn plain(x: &Tensor, scale: &Tensor, shift: &Tensor) -> Tensor {
        let centred = x.broadcast_sub(&x.mean_keepdim(1).unwrap()).unwrap();
        let variance = centred.sqr().unwrap().mean_keepdim(1).unwrap();
        let deviation = (variance + f64::from(EPSILON)).unwrap().sqrt().unwrap();
        let normal = centred.broadcast_div(&deviation).unwrap();
        normal.broadcast_mul(scale).unwrap().broadcast_add(shift).unwrap()
    }

    #[test]
    fn it_is_the_formula() {
        let (x, scale, shift) = (random(&[6, 8], 1), random(&[8], 2), random(&[8], 3));
        let own = layer_norm(&x, &scale, &shift).unwrap();
        assert!(largest_difference(&own, &plain(&x, &scale, &shift)) < 2e-6);
    }

    #[test]
    fn large_means_keep_their_digits() {
        let (x, scale, shift) = (random(&[6, 8], 1), random(&[8], 2), random(&[8], 3));
        let far = (x.as_tensor() + 1024.0).unwrap();
        let (near, far) = (layer_norm(&x, &scale, &shift), layer_norm(&far, &scale, &shift));
        // At 1,024, x has a rounding error of 2⁻¹⁴, some 1e-4 of its deviation.
        assert!(largest_difference(&near.unwrap(), &far.unwrap()) < 1e-3);
    }

    #[test]
    fn its_derivatives_are_those_of_finite_differences() {
        let inputs = [random(&[4, 6], 1), random(&[6], 2), random(&[6], 3)];
        check_derivatives(&inputs, || layer_norm(&inputs[0], &inputs[1], &inputs[2]));
    }
}
