//! Message passing in three scales without Candle, for the fast paths of all networks.
//!
//! The results are those of Candle's layers, on one thread, in reused buffers. Everything that
//! depends on the weights alone is computed once: layers with the same input rows are concatenated,
//! and the edge parts of messages are precomputed for graphs with the same edge features in every
//! press. Kernels are compiled for the processor that runs them.
//!
//! Shapes: N nodes of a scale, E directed edges, H latent width.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use std::sync::Arc;

use candle_core::{Result, Tensor};
use faer::{Accum, MatMut, MatRef, Par, linalg::matmul::matmul};

use super::{
    graph::{Level, SCALES},
    layers::{LayerNorm, Linear, Mlp, Round},
    multi_scale::MultiScale,
    ops::{Edges, Sparse, hear, moments},
};
use crate::simd::vectorised;

/// Layers of the network on one graph.
pub(super) struct Trunk {
    encoder: [Dense; 2],
    down: [Vec<FastRound>; SCALES],
    up: [Vec<FastRound>; SCALES - 1],
    lower: [Dense; SCALES - 1],
    raise: [Dense; SCALES - 1],
    global: [Dense; 2],
    norm: [Vec<f32>; 2],
    links: [[Arc<Sparse>; 2]; SCALES - 1],
}

/// Buffers of a forward pass.
#[derive(Default)]
pub(super) struct TrunkBuffers {
    scales: [ScaleBuffers; SCALES],
    latent: Vec<f32>,
    buffers: [Vec<f32>; 2],
}

/// Buffers of one scale (N, …).
#[derive(Default)]
struct ScaleBuffers {
    v: Vec<f32>,
    normal: Vec<f32>,
    /// Sender's and receiver's part of messages, and the hidden row of the update (N, 3H).
    parts: Vec<f32>,
    edges: Vec<f32>,
    heard: Vec<f32>,
}

/// x W + b for row-major W (K, M).
pub(super) struct Dense {
    pub(super) weight: Vec<f32>,
    pub(super) bias: Vec<f32>,
    inputs: usize,
}

/// A round of message passing.
struct FastRound {
    norm: [Vec<f32>; 2],
    /// Layer from a normalised row to both ends of messages and to the update; its biases are those
    /// of the edges and of `heard`.
    fan: Dense,
    /// Layer from the summed messages to the update.
    heard: Dense,
    update: Dense,
    edges: EdgeParts,
    graph: Arc<Edges>,
}

/// Edge parts of messages (E, H), which include the biases of their ends.
enum EdgeParts {
    Known(Vec<f32>),
    /// Layer that computes them from the features of the edges.
    Of(Dense),
}

impl Dense {
    pub(super) fn new(layer: &Linear) -> Result<Self> {
        Self::of(&layer.weight, &layer.bias)
    }

    /// Creates a layer from a weight (M, K).
    pub(super) fn of(weight: &Tensor, bias: &Tensor) -> Result<Self> {
        let inputs = weight.dim(1)?;
        let weight = weight.t()?.contiguous()?.flatten_all()?.to_vec1()?;
        Ok(Self { weight, bias: bias.to_vec1()?, inputs })
    }

    pub(super) fn pair(mlp: &Mlp) -> Result<[Self; 2]> {
        Ok([Self::new(&mlp.first)?, Self::new(&mlp.second)?])
    }

    pub(super) fn outputs(&self) -> usize {
        self.bias.len()
    }

    /// Sets `y` (N, M) to x W + b.
    pub(super) fn forward(&self, x: &[f32], y: &mut Vec<f32>) {
        self.product(x, y);
        vectorised(
            #[inline(always)]
            || add_rows(y, &self.bias),
        );
    }

    /// Sets `y` (N, M) to max(x W + b, 0).
    pub(super) fn forward_relu(&self, x: &[f32], y: &mut Vec<f32>) {
        self.product(x, y);
        vectorised(
            #[inline(always)]
            || y.chunks_exact_mut(self.outputs()).for_each(|row| add_relu(row, &self.bias)),
        );
    }

    /// Sets `y` (N, M) to x W.
    fn product(&self, x: &[f32], y: &mut Vec<f32>) {
        let (rows, outputs) = (x.len() / self.inputs, self.outputs());
        y.resize(rows * outputs, 0.0);
        let x = MatRef::from_row_major_slice(x, rows, self.inputs);
        let y = MatMut::from_row_major_slice_mut(y, rows, outputs);
        matmul(y, Accum::Replace, x, self.weight(), 1.0, Par::Seq);
    }

    /// Adds x W to `y` (N, M).
    fn add(&self, x: MatRef<f32>, y: MatMut<f32>) {
        matmul(y, Accum::Add, x, self.weight(), 1.0, Par::Seq);
    }

    fn weight(&self) -> MatRef<'_, f32> {
        MatRef::from_row_major_slice(&self.weight, self.inputs, self.outputs())
    }
}

impl FastRound {
    fn new(round: &Round, level: &Level, features: Option<&Tensor>) -> Result<Self> {
        let Round { norm, ends, edges, update } = round;
        let width = norm.scale.dim(0)?;
        let first = &update.first;
        let own = first.weight.narrow(1, 0, width)?;
        let rest = first.weight.narrow(1, width, width)?;
        let fan = Tensor::cat(&[&ends.weight, &own], 0)?;
        let none = Tensor::cat(&[&ends.bias, &first.bias], 0)?.zeros_like()?;
        let of_ends = (ends.bias.narrow(0, 0, width)? + ends.bias.narrow(0, width, width)?)?;
        let edges = Linear { weight: edges.weight.clone(), bias: (&edges.bias + of_ends)? };
        Ok(Self {
            norm: vectors(norm)?,
            fan: Dense::of(&fan, &none)?,
            heard: Dense::of(&rest, &first.bias)?,
            update: Dense::new(&update.second)?,
            edges: match features {
                Some(features) => {
                    EdgeParts::Known(edges.forward(features)?.flatten_all()?.to_vec1()?)
                }
                None => EdgeParts::Of(Dense::new(&edges)?),
            },
            graph: Arc::clone(&level.edges),
        })
    }

    /// Performs a round on `buffers.v`, with the `features` of the edges if they differ from press
    /// to press.
    fn run(&self, features: &[f32], buffers: &mut ScaleBuffers) {
        let width = self.update.outputs();
        let ScaleBuffers { v, normal, parts, edges, heard } = buffers;
        normal.resize(v.len(), 0.0);
        vectorised(
            #[inline(always)]
            || normalise(v, &self.norm, normal),
        );
        self.fan.product(normal, parts);
        let edges = match &self.edges {
            EdgeParts::Known(parts) => parts,
            EdgeParts::Of(layer) => {
                layer.forward(features, edges);
                edges
            }
        };
        heard.resize(v.len(), 0.0);
        vectorised(
            #[inline(always)]
            || hear(&self.graph, parts, 3 * width, edges, width, heard),
        );
        let rows = v.len() / width;
        let row_major = |x| MatRef::from_row_major_slice(x, rows, width);
        let hidden = MatMut::from_row_major_slice_mut(parts, rows, 3 * width);
        self.heard.add(row_major(heard), hidden.subcols_mut(2 * width, width));
        vectorised(
            #[inline(always)]
            || {
                for row in parts.chunks_exact_mut(3 * width) {
                    add_relu(&mut row[2 * width..], &self.heard.bias);
                }
                add_rows(v, &self.update.bias);
            },
        );
        let hidden = MatRef::from_row_major_slice(parts, rows, 3 * width);
        let hidden = hidden.subcols(2 * width, width);
        self.update.add(hidden, MatMut::from_row_major_slice_mut(v, rows, width));
    }
}

fn vectors(norm: &LayerNorm) -> Result<[Vec<f32>; 2]> {
    Ok([norm.scale.to_vec1()?, norm.shift.to_vec1()?])
}

/// Sets `normal` (N, H) to the normalised `rows`.
#[inline(always)]
fn normalise(rows: &[f32], [scale, shift]: &[Vec<f32>; 2], normal: &mut [f32]) {
    let width = scale.len();
    for (row, normal) in rows.chunks_exact(width).zip(normal.chunks_exact_mut(width)) {
        let (mean, inverse) = moments(row);
        let learnt = scale.iter().zip(shift);
        for ((to, x), (scale, shift)) in normal.iter_mut().zip(row).zip(learnt) {
            *to = (x - mean) * inverse * scale + shift;
        }
    }
}

#[inline(always)]
fn add_rows(rows: &mut [f32], more: &[f32]) {
    for row in rows.chunks_exact_mut(more.len()) {
        row.iter_mut().zip(more).for_each(|(x, more)| *x += more);
    }
}

#[inline(always)]
fn add_relu(row: &mut [f32], more: &[f32]) {
    row.iter_mut().zip(more).for_each(|(x, more)| *x = (*x + more).max(0.0));
}

impl Trunk {
    /// Prepares `layers` for the `levels` of a graph. `edges` are the features of its edges (E, F)
    /// if they are the same in every press.
    pub(super) fn new(
        layers: &MultiScale,
        levels: &[Level; SCALES],
        edges: Option<&[Tensor; SCALES]>,
    ) -> Result<Self> {
        let rounds = |rounds: &[Round], scale: usize| {
            let features = edges.map(|edges| &edges[scale]);
            let one = |round| FastRound::new(round, &levels[scale], features);
            rounds.iter().map(one).collect::<Result<Vec<_>>>()
        };
        let MultiScale { encoder, down, up, lower, raise, global, norm } = layers;
        Ok(Self {
            encoder: Dense::pair(encoder)?,
            down: [rounds(&down[0], 0)?, rounds(&down[1], 1)?, rounds(&down[2], 2)?],
            up: [rounds(&up[0], 0)?, rounds(&up[1], 1)?],
            lower: [Dense::new(&lower[0])?, Dense::new(&lower[1])?],
            raise: [Dense::new(&raise[0])?, Dense::new(&raise[1])?],
            global: Dense::pair(global)?,
            norm: vectors(norm)?,
            links: [0, 1].map(|i| levels[i].links.clone().expect("a coarser scale")),
        })
    }

    /// Latent rows (N, H) of the finest scale for the `features` of its nodes. `edges` are the
    /// features of each scale's edges, empty if they were given at construction.
    pub(super) fn latent<'a>(
        &self,
        features: &[f32],
        edges: &[&[f32]; SCALES],
        scratch: &'a mut TrunkBuffers,
    ) -> &'a [f32] {
        let TrunkBuffers { scales, latent, buffers: [buffer, other] } = scratch;
        self.encoder[0].forward_relu(features, buffer);
        self.encoder[1].forward(buffer, &mut scales[0].v);
        for scale in 0..SCALES {
            if scale > 0 {
                self.carry(&self.links[scale - 1][1], &scales[scale - 1].v, other);
                self.lower[scale - 1].forward(other, &mut scales[scale].v);
            }
            self.down[scale].iter().for_each(|round| round.run(edges[scale], &mut scales[scale]));
        }
        self.share(&mut scales[SCALES - 1].v, buffer, other);
        for scale in (0..SCALES - 1).rev() {
            self.carry(&self.links[scale][0], &scales[scale + 1].v, other);
            self.raise[scale].forward(other, buffer);
            scales[scale].v.iter_mut().zip(&*buffer).for_each(|(v, more)| *v += more);
            self.up[scale].iter().for_each(|round| round.run(edges[scale], &mut scales[scale]));
        }
        latent.resize(scales[0].v.len(), 0.0);
        vectorised(
            #[inline(always)]
            || normalise(&scales[0].v, &self.norm, latent),
        );
        latent
    }

    /// Sets `to` to the rows `v` transferred to another scale.
    fn carry(&self, link: &Sparse, v: &[f32], to: &mut Vec<f32>) {
        let width = self.norm[0].len();
        to.clear();
        to.resize(link.height() * width, 0.0);
        vectorised(
            #[inline(always)]
            || link.add_product(v, to, width),
        );
    }

    /// Adds to each row of `v` a function of their mean.
    fn share(&self, v: &mut [f32], hidden: &mut Vec<f32>, output: &mut Vec<f32>) {
        let width = self.norm[0].len();
        let mut mean = vec![0.0; width];
        let count = (v.len() / width) as f32;
        for row in v.chunks_exact(width) {
            mean.iter_mut().zip(row).for_each(|(mean, x)| *mean += x / count);
        }
        self.global[0].forward_relu(&mean, hidden);
        self.global[1].forward(hidden, output);
        for row in v.chunks_exact_mut(width) {
            row.iter_mut().zip(&*output).for_each(|(x, more)| *x += more);
        }
    }
}
