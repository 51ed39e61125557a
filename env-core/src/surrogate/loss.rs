//! Training loss of the corrector.
//!
//! Each part is a relative error of a press, ‖x̂ − x‖ / ‖x‖, averaged over the batch. Presses have
//! nearly the same weight, regardless of their force, except those that hardly move the gel: their
//! reference solutions are the least accurate, and so light a contact does not matter to a grasp.

use candle_core::{Device, Result, Tensor};
use candle_nn::VarBuilder;

use super::{
    corrector::{Corrector, CorrectorConfig, CorrectorOutput, PadBatch},
    features::{Fields, PadInput, Target},
    graph::PadGraph,
    material::PadMaterial,
    samples::{Gels, Sample},
    train::{Loss, Network},
};

/// Weights of displacement, stress, nodal forces and net force, of a squeeze that of its fingers,
/// in the loss.
pub(super) const WEIGHTS: [f64; 4] = [1.0, 1.0, 0.3, 1.0];
/// Root mean square of the displacement of a press with half of the greatest weight, in units of
/// the thickness: 2 µm in a pad of 4 mm.
const HARDLY_MOVED: f64 = 5e-4;
/// Added to the squares of norms, so that their roots are differentiable.
const EPSILON: f64 = 1e-16;

/// Weighted mean relative errors of displacement, stress, nodal forces and net force, each a
/// scalar.
pub(super) struct LossTerms(pub(super) [Tensor; 4]);

impl LossTerms {
    /// Weighted sum of the parts.
    pub(super) fn total(&self) -> Result<Tensor> {
        let mut sum = (&self.0[0] * WEIGHTS[0])?;
        for (part, weight) in self.0.iter().zip(WEIGHTS).skip(1) {
            sum = (sum + (part * weight)?)?;
        }
        Ok(sum)
    }

    pub(super) fn values(&self) -> Result<[f32; 4]> {
        let mut values = [0.0; 4];
        for (value, part) in values.iter_mut().zip(&self.0) {
            *value = part.to_scalar()?;
        }
        Ok(values)
    }
}

/// Errors of each press of `answer` against `targets`: displacement, stress, nodal forces and net
/// force, (B) each.
pub(super) fn errors(answer: &CorrectorOutput, targets: &[&Target]) -> Result<[Tensor; 4]> {
    let all = |field: fn(&Target) -> &[f32]| {
        let values: Vec<f32> = targets.iter().flat_map(|target| field(target)).copied().collect();
        Tensor::from_vec(values, (targets.len(), field(targets[0]).len()), &Device::Cpu)
    };
    let by_press = |x: &Tensor| x.reshape((targets.len(), ()));
    Ok([
        relative(&by_press(&answer.displacement)?, &all(|t| &t.displacement)?)?,
        relative(&answer.stress, &all(|t| &t.stress)?)?,
        relative(&by_press(&answer.forces)?, &all(|t| &t.forces)?)?,
        relative(&answer.force, &all(|t| &t.force)?)?,
    ])
}

/// Returns ‖x − target‖ / ‖target‖ of each row.
pub(super) fn relative(x: &Tensor, target: &Tensor) -> Result<Tensor> {
    let norm = |x: Tensor| (x.sqr()?.sum(1)? + EPSILON)?.sqrt();
    norm((x - target)?)? / norm(target.clone())?
}

impl Network for Corrector {
    type Config = CorrectorConfig;
    type Sample = Sample;
    type Ground = Gels;

    fn new(config: &CorrectorConfig, vb: &VarBuilder) -> Result<Self> {
        Self::new(config, vb)
    }

    fn graph(sample: &Sample) -> usize {
        sample.graph
    }

    fn target<'a>(gels: &'a Gels, sample: &'a Sample) -> (&'a Target, &'a PadMaterial) {
        (&sample.target, &gels.pads[sample.gel].gel)
    }

    fn loss(&self, gels: &Gels, samples: &[&Sample], mirror: usize) -> crate::Result<Loss> {
        let graph = &gels.graphs[samples[0].graph];
        let parts = parts(self, samples, graph, mirror)?;
        Ok(Loss { total: parts.total()?, parts: parts.values()? })
    }

    fn answer(&self, gels: &Gels, sample: &Sample) -> crate::Result<Fields> {
        Ok(self.fields(&sample.input, &gels.graphs[sample.graph])?)
    }
}

/// Weighted mean errors of a network on `samples`, all of one graph, seen in one of its mirrors.
pub(super) fn parts(
    network: &Corrector,
    samples: &[&Sample],
    graph: &PadGraph,
    mirror: usize,
) -> Result<LossTerms> {
    let mirror = &graph.mirrors[mirror];
    let inputs: Vec<PadInput> = samples.iter().map(|s| s.input.mirrored(mirror)).collect();
    let targets: Vec<Target> = samples.iter().map(|s| s.target.mirrored(mirror)).collect();
    let batch = PadBatch::new(&inputs.iter().collect::<Vec<_>>())?;
    let answer = network.forward(&batch, graph)?;
    let weights: Vec<f32> = targets.iter().map(weight).collect();
    let weights = Tensor::from_vec(weights, targets.len(), &Device::Cpu)?;
    let mean = |errors: &Tensor| (errors * &weights)?.mean_all();
    let [a, b, c, d] = errors(&answer, &targets.iter().collect::<Vec<_>>())?;
    Ok(LossTerms([mean(&a)?, mean(&b)?, mean(&c)?, mean(&d)?]))
}

/// Weight of a press: 1 where it moves the gel much, in proportion to the displacement where it
/// hardly does.
fn weight(target: &Target) -> f32 {
    let squares: f64 = target.displacement.iter().map(|u| f64::from(*u).powi(2)).sum();
    let moved = (3.0 * squares / target.displacement.len().max(1) as f64).sqrt();
    (moved / (moved + HARDLY_MOVED)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_hardly_moves_the_gel_counts_less() {
        let moved = |by: f64| {
            let displacement = [by as f32, 0.0, 0.0].repeat(5);
            Target { displacement, stress: Vec::new(), forces: Vec::new(), force: [0.0; 3] }
        };
        let [hardly, half, much] =
            [0.01, 1.0, 100.0].map(|times| weight(&moved(times * HARDLY_MOVED)));
        assert!(hardly < 0.011 && (half - 0.5).abs() < 1e-6 && much > 0.98);
    }
}
