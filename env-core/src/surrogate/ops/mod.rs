//! Operations of the networks, with their derivatives, for 32-bit floats on a CPU.
//!
//! Candle's own kernels are the reference: every operation is tested against the same formula in
//! plain Candle, and its derivative against finite differences. The advantages over Candle: no copy
//! of node features on edges, no query of the processor's properties at every product, a layer norm
//! that passes its gradient on and sums in two passes, and one thread for one graph.
//!
//! Shapes: B presses in a batch, V nodes, E edges, T tetrahedra, H latent width. Rows of a batch
//! are stored press after press.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

mod linear_layer;
mod ends;
mod layer_norm;
mod messages;
mod pad_stress;
mod sparse;
mod von_mises;

pub(super) use ends::ends;
pub(super) use layer_norm::{layer_norm, moments};
pub(super) use linear_layer::linear_layer;
pub(super) use messages::{Edges, hear, messages};
pub(super) use pad_stress::PadStress;
pub(super) use sparse::{Sparse, sparse};
pub(super) use von_mises::{ShapeGradients, von_mises};

use candle_core::{CpuStorage, Layout, Result, Storage, Tensor, bail};

/// Numbers of a contiguous tensor on the CPU.
fn numbers<'a>(storage: &'a CpuStorage, layout: &Layout) -> Result<&'a [f32]> {
    let Some((from, to)) = layout.contiguous_offsets() else {
        bail!("expected a contiguous tensor, found strides {:?}", layout.stride());
    };
    Ok(&storage.as_slice::<f32>()?[from..to])
}

/// Calls `f` with the numbers of `tensors`, made contiguous where they are not.
fn with_numbers<const N: usize, T>(
    tensors: [&Tensor; N],
    f: impl FnOnce([&[f32]; N]) -> Result<T>,
) -> Result<T> {
    let tensors: Vec<Tensor> = tensors.iter().map(|t| t.contiguous()).collect::<Result<_>>()?;
    let held: Vec<_> = tensors.iter().map(Tensor::storage_and_layout).collect();
    let mut slices = [&[][..]; N];
    for (slice, (storage, layout)) in slices.iter_mut().zip(&held) {
        let Storage::Cpu(storage) = &**storage else { bail!("expected a tensor on the CPU") };
        *slice = numbers(storage, layout)?;
    }
    f(slices)
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Result, Tensor, Var};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Random numbers between −1 and 1 in the given shape.
    pub(super) fn random(shape: &[usize], seed: u64) -> Var {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let count = shape.iter().product();
        let values: Vec<f32> = (0..count).map(|_| random.random_range(-1.0..1.0)).collect();
        Var::from_vec(values, shape, &Device::Cpu).unwrap()
    }

    pub(super) fn largest_difference(a: &Tensor, b: &Tensor) -> f32 {
        let difference = (a - b).unwrap().abs().unwrap().flatten_all().unwrap();
        difference.max(0).unwrap().to_scalar().unwrap()
    }

    /// Checks the derivatives of `f` by central differences of a weighted sum of its result.
    pub(super) fn check_derivatives(inputs: &[Var], f: impl Fn() -> Result<Tensor>) {
        let weights = random(f().unwrap().dims(), 99);
        let value = || -> f64 {
            let sum = (f().unwrap() * weights.as_tensor()).unwrap().flatten_all().unwrap();
            let terms: Vec<f32> = sum.to_vec1().unwrap();
            terms.iter().map(|&x| f64::from(x)).sum()
        };
        let total = (f().unwrap() * weights.as_tensor()).unwrap().sum_all().unwrap();
        let gradients = total.backward().unwrap();
        for (which, input) in inputs.iter().enumerate() {
            let gradient = gradients.get(input).expect("every input has a gradient");
            let gradient: Vec<f32> = gradient.flatten_all().unwrap().to_vec1().unwrap();
            let start: Vec<f32> = input.flatten_all().unwrap().to_vec1().unwrap();
            let scale = gradient.iter().fold(0.0_f32, |most, g| most.max(g.abs()));
            for i in 0..start.len() {
                let h = 2e-3;
                let at = |offset: f32| {
                    let mut moved = start.clone();
                    moved[i] += offset;
                    input
                        .set(&Tensor::from_vec(moved, input.dims(), &Device::Cpu).unwrap())
                        .unwrap();
                    value()
                };
                let slope = (at(h) - at(-h)) / (2.0 * f64::from(h));
                let (found, bound) = (f64::from(gradient[i]), 4e-3 * f64::from(scale.max(0.1)));
                assert!((found - slope).abs() < bound, "input {which}[{i}]: {found} for {slope}");
            }
            input.set(&Tensor::from_vec(start, input.dims(), &Device::Cpu).unwrap()).unwrap();
        }
    }
}
