//! Output layers for the stress of tetrahedra, without Candle.
//!
//! Shapes: T tetrahedra, G corners per latent row, W width of a corner.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use candle_core::{Result, Tensor};

use super::{layers::Linear, trunk::Dense};
use crate::simd::{LANES, vectorised};

/// Layers that correct the stress that the corrected displacement implies.
pub(super) struct StressHead {
    corners: Dense,
    strain: Dense,
    stress: Dense,
    /// Corners of the tetrahedra (T, 4).
    tets: Vec<[u32; 4]>,
}

/// Stresses of one answer before they are corrected (T).
pub(super) struct Stresses<'a> {
    /// Stress of the linear solution.
    pub(super) linear: &'a [f32],
    /// Stress that the displacement implies before and after its correction.
    pub(super) moved: [&'a [f32]; 2],
    /// Largest displacement of a node.
    pub(super) amplitude: f32,
}

impl StressHead {
    /// Prepares layers from latent rows, each for `groups` corners, to one number for each of the
    /// `tets`.
    pub(super) fn new(
        [corners, strain, stress]: [&Linear; 3],
        groups: usize,
        tets: Vec<[u32; 4]>,
    ) -> Result<Self> {
        Ok(Self {
            corners: Dense::new(&widened(corners, groups)?)?,
            strain: Dense::new(&widened(strain, 1)?)?,
            stress: Dense::of(&widest(&stress.weight)?, &stress.bias)?,
            tets,
        })
    }

    /// Corrected stress (T) from the `latent` rows; `corners` is a buffer.
    pub(super) fn forward(
        &self,
        latent: &[f32],
        stresses: &Stresses,
        corners: &mut Vec<f32>,
    ) -> Vec<f32> {
        self.corners.forward(latent, corners);
        let mut stress = vec![0.0; self.tets.len()];
        vectorised(
            #[inline(always)]
            || self.evaluate(corners, stresses, &mut stress),
        );
        stress
    }

    #[inline(always)]
    fn evaluate(&self, corners: &[f32], stresses: &Stresses, stress: &mut [f32]) {
        let Stresses { linear, moved: [before, after], amplitude } = *stresses;
        let unit = (amplitude + f32::MIN_POSITIVE).recip();
        let lanes = self.strain.outputs() / LANES;
        let (corners, weights) = (corners.as_chunks().0, self.strain.weight.as_chunks().0);
        let (biases, outputs) = (self.strain.bias.as_chunks().0, self.stress.weight.as_chunks().0);
        for (t, tet) in self.tets.iter().enumerate() {
            let strains = [linear[t] * unit, before[t] * unit, after[t] * unit];
            let mut sums = [0.0_f32; LANES];
            for k in 0..lanes {
                let mut hidden: [f32; LANES] = biases[k];
                for (s, strain) in strains.iter().enumerate() {
                    add(&mut hidden, &weights[s * lanes + k], *strain);
                }
                for &corner in tet {
                    add(&mut hidden, &corners[corner as usize * lanes + k], 1.0);
                }
                let output: &[f32; LANES] = &outputs[k];
                for i in 0..LANES {
                    sums[i] += hidden[i].max(0.0) * output[i];
                }
            }
            let added = (sums.iter().sum::<f32>() + self.stress.bias[0]) * amplitude;
            stress[t] = linear[t] + after[t] - before[t] + added;
        }
    }
}

#[inline(always)]
fn add(sum: &mut [f32; LANES], x: &[f32; LANES], by: f32) {
    for i in 0..LANES {
        sum[i] += by * x[i];
    }
}

/// Pads a weight (M, K) with columns of zeros to a multiple of [`LANES`].
fn widest(weight: &Tensor) -> Result<Tensor> {
    let inputs = weight.dim(1)?;
    weight.pad_with_zeros(1, 0, inputs.next_multiple_of(LANES) - inputs)
}

/// Pads each of `groups` of the outputs of `layer` with zeros to a multiple of [`LANES`].
fn widened(layer: &Linear, groups: usize) -> Result<Linear> {
    let (outputs, inputs) = layer.weight.dims2()?;
    let width = outputs / groups;
    let more = width.next_multiple_of(LANES) - width;
    let weight = layer.weight.reshape((groups, width, inputs))?.pad_with_zeros(1, 0, more)?;
    let bias = layer.bias.reshape((groups, width))?.pad_with_zeros(1, 0, more)?;
    Ok(Linear { weight: weight.flatten(0, 1)?, bias: bias.flatten_all()? })
}
