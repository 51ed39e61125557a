//! The corrector without Candle: the same numbers, on one thread, in buffers that are kept.
//!
//! What depends on the weights alone is done once: edge parts of messages, layers that read the same
//! rows laid side by side. Kernels are compiled for the processor that runs them. Plain Candle
//! ([`Corrector::forward`]) is the oracle.
//!
//! Shapes as in the corrector, with one press.

#![allow(clippy::inline_always)] // What is not inlined is not compiled for the processor.

use std::sync::Arc;

use candle_core::{Result, Tensor};
use faer::{Accum, MatMut, MatRef, Par, linalg::matmul::matmul};

use super::{
    corrector::Corrector,
    features::{FEATURES, Question},
    graph::{LAYERS, PadGraph, SCALES},
    layers::{Affine, Mlp, Norm, Round},
    metrics::Fields,
    ops::{Edges, PadStress, hear, moments},
};
use crate::{
    geometry::PadMesh,
    simd::{LANES, vectorised},
};

/// The network on one pad.
pub(super) struct Fast {
    encoder: [Dense; 2],
    down: [Vec<FastRound>; SCALES],
    up: [Vec<FastRound>; SCALES - 1],
    lower: [Dense; SCALES - 1],
    raise: [Dense; SCALES - 1],
    global: [Dense; 2],
    norm: [Vec<f32>; 2],
    nodes: [Dense; 2],
    corners: Dense,
    strain: Dense,
    stress: Dense,
    graph: PadGraph,
    /// Of the model mesh.
    elements: PadStress,
    tets: Vec<[u32; 4]>,
}

/// Buffers of a forward pass.
#[derive(Default)]
pub(super) struct Scratch {
    scales: [Buffers; SCALES],
    latent: Vec<f32>,
    says: Vec<f32>,
    corners: Vec<f32>,
    stresses: [Vec<f32>; 2],
    spare: [Vec<f32>; 2],
}

/// Buffers of one scale (C', …).
#[derive(Default)]
struct Buffers {
    v: Vec<f32>,
    normal: Vec<f32>,
    /// Sender's and receiver's part of messages, and the update's own part.
    parts: Vec<f32>,
    ends: Vec<f32>,
    heard: Vec<f32>,
    hidden: Vec<f32>,
}

/// x W + b for row-major W (K, M).
struct Dense {
    weight: Vec<f32>,
    bias: Vec<f32>,
    inputs: usize,
}

/// A round of message passing, its edge parts computed.
struct FastRound {
    norm: [Vec<f32>; 2],
    /// From a normalised row to both ends of messages and to the update.
    fan: Dense,
    /// From what is heard to the update.
    heard: Dense,
    update: Dense,
    /// (E, H).
    edges: Vec<f32>,
    graph: Arc<Edges>,
}

impl Dense {
    fn new(layer: &Affine) -> Result<Self> {
        Self::of(&layer.weight, &layer.bias)
    }

    /// From a weight (M, K).
    fn of(weight: &Tensor, bias: &Tensor) -> Result<Self> {
        let inputs = weight.dim(1)?;
        let weight = weight.t()?.contiguous()?.flatten_all()?.to_vec1()?;
        Ok(Self { weight, bias: bias.to_vec1()?, inputs })
    }

    fn pair(mlp: &Mlp) -> Result<[Self; 2]> {
        Ok([Self::new(&mlp.first)?, Self::new(&mlp.second)?])
    }

    fn outputs(&self) -> usize {
        self.bias.len()
    }

    /// `y` (N, M) becomes x W + b.
    fn forward(&self, x: &[f32], y: &mut Vec<f32>) {
        let rows = x.len() / self.inputs;
        y.clear();
        (0..rows).for_each(|_| y.extend_from_slice(&self.bias));
        self.add(x, y);
    }

    /// Adds x W to `y` (N, M).
    fn add(&self, x: &[f32], y: &mut [f32]) {
        let (rows, outputs) = (x.len() / self.inputs, self.outputs());
        let x = MatRef::from_row_major_slice(x, rows, self.inputs);
        let weight = MatRef::from_row_major_slice(&self.weight, self.inputs, outputs);
        let y = MatMut::from_row_major_slice_mut(y, rows, outputs);
        matmul(y, Accum::Add, x, weight, 1.0, Par::Seq);
    }
}

impl FastRound {
    fn new(round: &Round, features: &Tensor, graph: &Arc<Edges>) -> Result<Self> {
        let Round { norm, ends, edges, update } = round;
        let width = norm.scale.dim(0)?;
        let first = &update.first;
        let own = first.weight.narrow(1, 0, width)?;
        let rest = first.weight.narrow(1, width, width)?;
        let fan = Tensor::cat(&[&ends.weight, &own], 0)?;
        let bias = Tensor::cat(&[&ends.bias, &first.bias], 0)?;
        let none = first.bias.zeros_like()?;
        Ok(Self {
            norm: vectors(norm)?,
            fan: Dense::of(&fan, &bias)?,
            heard: Dense::of(&rest, &none)?,
            update: Dense::new(&update.second)?,
            edges: edges.forward(features)?.flatten_all()?.to_vec1()?,
            graph: Arc::clone(graph),
        })
    }

    /// A round on `buffers.v`.
    fn run(&self, buffers: &mut Buffers) {
        let width = self.update.outputs();
        let Buffers { v, normal, parts, ends, heard, hidden } = buffers;
        normal.clear();
        normal.extend_from_slice(v);
        vectorised(
            #[inline(always)]
            || normalise(normal, &self.norm),
        );
        self.fan.forward(normal, parts);
        ends.clear();
        hidden.clear();
        for row in parts.chunks_exact(3 * width) {
            ends.extend_from_slice(&row[..2 * width]);
            hidden.extend_from_slice(&row[2 * width..]);
        }
        heard.clear();
        heard.resize(v.len(), 0.0);
        vectorised(
            #[inline(always)]
            || hear(&self.graph, ends, &self.edges, width, heard),
        );
        self.heard.add(heard, hidden);
        relu(hidden);
        self.update.forward(hidden, parts);
        v.iter_mut().zip(&*parts).for_each(|(v, more)| *v += more);
    }
}

fn vectors(norm: &Norm) -> Result<[Vec<f32>; 2]> {
    Ok([norm.scale.to_vec1()?, norm.shift.to_vec1()?])
}

#[inline(always)]
fn normalise(rows: &mut [f32], [scale, shift]: &[Vec<f32>; 2]) {
    for row in rows.chunks_exact_mut(scale.len()) {
        let (mean, inverse) = moments(row);
        for (x, (scale, shift)) in row.iter_mut().zip(scale.iter().zip(shift)) {
            *x = (*x - mean) * inverse * scale + shift;
        }
    }
}

fn relu(values: &mut [f32]) {
    for x in values {
        *x = x.max(0.0);
    }
}

impl Fast {
    /// `network` on the `graph` of `pad`.
    pub(super) fn new(network: &Corrector, graph: &PadGraph, pad: &PadMesh) -> Result<Self> {
        let rounds = |rounds: &[Round], scale: usize| {
            let scale = &graph.scales[scale];
            let one = |round| FastRound::new(round, &scale.features, &scale.edges);
            rounds.iter().map(one).collect::<Result<Vec<_>>>()
        };
        let columns = graph.columns as u32;
        // Nodes in the order column, layer.
        let place = |node: u32| node % columns * (LAYERS as u32 + 1) + node / columns;
        Ok(Self {
            encoder: Dense::pair(&network.encoder)?,
            down: [
                rounds(&network.down[0], 0)?,
                rounds(&network.down[1], 1)?,
                rounds(&network.down[2], 2)?,
            ],
            up: [rounds(&network.up[0], 0)?, rounds(&network.up[1], 1)?],
            lower: [Dense::new(&network.lower[0])?, Dense::new(&network.lower[1])?],
            raise: [Dense::new(&network.raise[0])?, Dense::new(&network.raise[1])?],
            global: Dense::pair(&network.global)?,
            norm: vectors(&network.norm)?,
            nodes: Dense::pair(&network.nodes)?,
            corners: Dense::new(&widened(&network.corners, LAYERS + 1)?)?,
            strain: Dense::new(&widened(&network.strain, 1)?)?,
            stress: Dense::of(&widest(&network.stress.weight)?, &network.stress.bias)?,
            elements: PadStress::new(pad, pad.thickness()),
            tets: pad.mesh.tets.iter().map(|tet| tet.map(place)).collect(),
            graph: graph.clone(),
        })
    }

    /// The corrected answer to `question`; stress is left empty unless `with_stress`.
    pub(super) fn forward(
        &self,
        question: &Question,
        with_stress: bool,
        scratch: &mut Scratch,
    ) -> Fields {
        self.latent(question, scratch);
        let Scratch { latent, says, spare: [hidden, _], .. } = scratch;
        self.nodes[0].forward(latent, hidden);
        relu(hidden);
        self.nodes[1].forward(hidden, says);
        let displacement = self.displaced(question, says);
        let (forces, force) = pressed(question, says);
        let stress =
            if with_stress { self.stressed(question, &displacement, scratch) } else { Vec::new() };
        Fields { displacement, stress, forces, force }
    }

    fn latent(&self, question: &Question, scratch: &mut Scratch) {
        let Scratch { scales, latent, spare: [spare, other], .. } = scratch;
        debug_assert_eq!(question.features.len(), self.graph.columns * FEATURES);
        self.encoder[0].forward(&question.features, spare);
        relu(spare);
        self.encoder[1].forward(spare, &mut scales[0].v);
        let width = self.norm[0].len();
        for scale in 0..SCALES {
            if scale > 0 {
                let links = self.graph.scales[scale - 1].links.as_ref().expect("a coarser scale");
                other.clear();
                other.resize(links[1].height() * width, 0.0);
                let fine = &scales[scale - 1].v;
                vectorised(
                    #[inline(always)]
                    || links[1].add_product(fine, other, width),
                );
                self.lower[scale - 1].forward(other, &mut scales[scale].v);
            }
            self.down[scale].iter().for_each(|round| round.run(&mut scales[scale]));
        }
        self.share(&mut scales[SCALES - 1].v, spare, other);
        for scale in (0..SCALES - 1).rev() {
            let links = self.graph.scales[scale].links.as_ref().expect("a coarser scale");
            other.clear();
            other.resize(links[0].height() * width, 0.0);
            let coarse = &scales[scale + 1].v;
            vectorised(
                #[inline(always)]
                || links[0].add_product(coarse, other, width),
            );
            self.raise[scale].forward(other, spare);
            scales[scale].v.iter_mut().zip(&*spare).for_each(|(v, more)| *v += more);
            self.up[scale].iter().for_each(|round| round.run(&mut scales[scale]));
        }
        latent.clear();
        latent.extend_from_slice(&scales[0].v);
        vectorised(
            #[inline(always)]
            || normalise(latent, &self.norm),
        );
    }

    /// Adds to each row of `v` what their mean says.
    fn share(&self, v: &mut [f32], hidden: &mut Vec<f32>, says: &mut Vec<f32>) {
        let width = self.norm[0].len();
        let mut mean = vec![0.0; width];
        let count = (v.len() / width) as f32;
        for row in v.chunks_exact(width) {
            mean.iter_mut().zip(row).for_each(|(mean, x)| *mean += x / count);
        }
        self.global[0].forward(&mean, hidden);
        relu(hidden);
        self.global[1].forward(hidden, says);
        for row in v.chunks_exact_mut(width) {
            row.iter_mut().zip(&*says).for_each(|(x, more)| *x += more);
        }
    }

    fn displaced(&self, question: &Question, says: &[f32]) -> Vec<f32> {
        let mut displacement = question.displacement.clone();
        let columns = self.graph.columns;
        for (column, says) in says.chunks_exact(3 * LAYERS + 3).enumerate() {
            for (layer, added) in says[..3 * LAYERS].as_chunks::<3>().0.iter().enumerate() {
                let node = &mut displacement[3 * (layer * columns + column)..][..3];
                node.iter_mut().zip(added).for_each(|(u, x)| *u += question.amplitude * x);
            }
        }
        displacement
    }

    fn stressed(&self, question: &Question, u: &[f32], scratch: &mut Scratch) -> Vec<f32> {
        let Scratch { latent, corners, stresses: [before, after], .. } = scratch;
        self.corners.forward(latent, corners);
        let mut stress = vec![0.0; self.tets.len()];
        let arranged = [&question.displacement, u].map(|u| self.elements.arranged(u.as_chunks().0));
        vectorised(
            #[inline(always)]
            || {
                self.elements.stress(&arranged[0], before);
                self.elements.stress(&arranged[1], after);
                self.heads(question, corners, [before, after], &mut stress);
            },
        );
        stress
    }

    #[inline(always)]
    fn heads(
        &self,
        question: &Question,
        corners: &[f32],
        [before, after]: [&[f32]; 2],
        stress: &mut [f32],
    ) {
        let unit = (question.amplitude + f32::MIN_POSITIVE).recip();
        let lanes = self.strain.outputs() / LANES;
        let (corners, weights) = (corners.as_chunks().0, self.strain.weight.as_chunks().0);
        let (biases, outputs) = (self.strain.bias.as_chunks().0, self.stress.weight.as_chunks().0);
        for ((t, tet), &place) in self.tets.iter().enumerate().zip(self.elements.places()) {
            let (before, after) = (before[place as usize], after[place as usize]);
            let strains = [question.stress[t] * unit, before * unit, after * unit];
            let mut says = [0.0_f32; LANES];
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
                    says[i] += hidden[i].max(0.0) * output[i];
                }
            }
            let says = (says.iter().sum::<f32>() + self.stress.bias[0]) * question.amplitude;
            stress[t] = question.stress[t] + after - before + says;
        }
    }
}

#[inline(always)]
fn add(sum: &mut [f32; LANES], x: &[f32; LANES], by: f32) {
    for i in 0..LANES {
        sum[i] += by * x[i];
    }
}

/// A weight (M, K) with columns of zeros up to a multiple of [`LANES`].
fn widest(weight: &Tensor) -> Result<Tensor> {
    let inputs = weight.dim(1)?;
    weight.pad_with_zeros(1, 0, inputs.next_multiple_of(LANES) - inputs)
}

/// `layer` with each of `groups` of its outputs filled up with zeros to a multiple of [`LANES`].
fn widened(layer: &Affine, groups: usize) -> Result<Affine> {
    let (outputs, inputs) = layer.weight.dims2()?;
    let width = outputs / groups;
    let more = width.next_multiple_of(LANES) - width;
    let weight = layer.weight.reshape((groups, width, inputs))?.pad_with_zeros(1, 0, more)?;
    let bias = layer.bias.reshape((groups, width))?.pad_with_zeros(1, 0, more)?;
    Ok(Affine { weight: weight.flatten(0, 1)?, bias: bias.flatten_all()? })
}

fn pressed(question: &Question, says: &[f32]) -> (Vec<f32>, [f32; 3]) {
    let mut forces = question.forces.clone();
    let mut sum = question.other_force;
    let columns = forces.as_chunks_mut::<3>().0.iter_mut().zip(&question.gates);
    for ((force, gate), says) in columns.zip(says.chunks_exact(3 * LAYERS + 3)) {
        for i in 0..3 {
            force[i] += says[3 * LAYERS + i] * gate * question.strongest;
            sum[i] += force[i];
        }
    }
    (forces, sum)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::{
        super::{
            corrector::{Batch, CorrectorConfig},
            parameters::Parameters,
        },
        *,
    };
    use crate::sensor::Sensor;

    /// A question of random numbers about a pad, and a network whose every weight is random.
    #[test]
    fn it_says_what_candle_says() {
        // Corners that fill lanes and such that do not.
        [16, 20].into_iter().for_each(compare);
    }

    fn compare(corner: usize) {
        let pad = Sensor::named("gelsight-mini").unwrap().pad(1000).unwrap();
        let graph = PadGraph::new(&pad).unwrap();
        let parameters = Parameters::drawn(1);
        let config = CorrectorConfig { corner, ..CorrectorConfig::default() };
        let network = Corrector::new(&config, &parameters.builder()).unwrap();
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let mut numbers = |count: usize, size: f32| -> Vec<f32> {
            (0..count).map(|_| size * random.random_range(-1.0..1.0)).collect()
        };
        for (_, variable) in parameters.all() {
            let values = numbers(variable.elem_count(), 0.3);
            let values = Tensor::from_vec(values, variable.shape(), variable.device()).unwrap();
            variable.set(&values).unwrap();
        }
        let nodes = pad.mesh.vertices.len();
        let question = Question {
            features: numbers(graph.columns * FEATURES, 1.0),
            displacement: numbers(3 * nodes, 0.02),
            stress: numbers(graph.tets(), 0.1),
            forces: numbers(3 * graph.columns, 0.1),
            other_force: [0.1, 0.2, 0.3],
            gates: numbers(graph.columns, 1.0),
            amplitude: 0.1,
            strongest: 0.1,
        };
        let answer = network.forward(&Batch::new(&[&question]).unwrap(), &graph).unwrap();
        let fast = Fast::new(&network, &graph, &pad).unwrap();
        let found = fast.forward(&question, true, &mut Scratch::default());
        let near = |name: &str, plain: &Tensor, own: &[f32]| {
            let plain: Vec<f32> = plain.flatten_all().unwrap().to_vec1().unwrap();
            let scale = plain.iter().fold(0.0_f32, |most, x| most.max(x.abs()));
            let far = plain.iter().zip(own).fold(0.0_f32, |most, (a, b)| most.max((a - b).abs()));
            assert!(plain.len() == own.len() && far < 1e-4 * scale, "{name}: {far} of {scale}");
        };
        near("displacement", &answer.displacement, &found.displacement);
        near("stress", &answer.stress, &found.stress);
        near("forces", &answer.forces, &found.forces);
        near("force", &answer.force, &found.force);
    }
}
