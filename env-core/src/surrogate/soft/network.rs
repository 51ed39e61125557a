//! What finite elements add to the linear answer of a squeezed object.
//!
//! A graph network in three scales (MeshGraphNets, Pfaff et al. 2021; scales as in Fortunato et al.
//! 2022) on the object's mesh. It says by how much each node is displaced farther and each node of the
//! surface near a finger pressed harder, and how far the stress of each tetrahedron is from that of the
//! corrected displacement. The forces sum to zero, as those on a free body do.
//!
//! Shapes: V nodes, T tetrahedra, H latent width, W width of a corner.

use candle_core::{Device, Result, Tensor};
use candle_nn::VarBuilder;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{
    graph::{EDGE_FEATURES, ObjectGraph, SCALES},
    question::{FEATURES, Question},
};
use crate::surrogate::{
    layers::{Affine, Mlp, Norm, Round},
    ops::{sparse, von_mises},
};

/// Sizes of the network.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SoftConfig {
    /// Latent width H.
    pub width: usize,
    /// Rounds of message passing at each scale on the way down, the finest first.
    pub down: [usize; SCALES],
    /// Rounds at each scale but the coarsest on the way up.
    pub up: [usize; SCALES - 1],
    /// Width W of a tetrahedron's corner.
    pub corner: usize,
}

impl Default for SoftConfig {
    fn default() -> Self {
        Self { width: 32, down: [1, 1, 2], up: [2, 1], corner: 16 }
    }
}

/// The network.
pub(super) struct Soft {
    encoder: Mlp,
    down: [Vec<Round>; SCALES],
    up: [Vec<Round>; SCALES - 1],
    /// To each coarser scale.
    lower: [Affine; SCALES - 1],
    /// Back from it.
    raise: [Affine; SCALES - 1],
    global: Mlp,
    norm: Norm,
    first: Affine,
    second: Affine,
    corners: Affine,
    strain: Affine,
    stress: Affine,
}

/// What the network says, in the units of [`Question`] and the object's frame.
pub(super) struct Answer {
    /// (V, 3).
    pub(super) displacement: Tensor,
    /// Von Mises (1, T).
    pub(super) stress: Tensor,
    /// (V, 3).
    pub(super) forces: Tensor,
    /// Force of the squeeze (1, 3): half the difference of what the fingers exert.
    pub(super) force: Tensor,
}

impl Soft {
    pub(super) fn new(config: &SoftConfig, vb: &VarBuilder) -> Result<Self> {
        let SoftConfig { width, corner, down, up } = *config;
        let rounds = |count: usize, vb: VarBuilder| {
            (0..count)
                .map(|i| Round::new(width, EDGE_FEATURES, &vb.pp(i)))
                .collect::<Result<Vec<_>>>()
        };
        let link = |name: &str, i: usize| Affine::new(width, width, &vb.pp(name).pp(i));
        Ok(Self {
            encoder: Mlp::new([FEATURES, width, width], &vb.pp("encoder"))?,
            down: [
                rounds(down[0], vb.pp("down.0"))?,
                rounds(down[1], vb.pp("down.1"))?,
                rounds(down[2], vb.pp("down.2"))?,
            ],
            up: [rounds(up[0], vb.pp("up.0"))?, rounds(up[1], vb.pp("up.1"))?],
            lower: [link("lower", 0)?, link("lower", 1)?],
            raise: [link("raise", 0)?, link("raise", 1)?],
            global: Mlp::new([width, width, width], &vb.pp("global"))?,
            norm: Norm::new(width, &vb.pp("norm"))?,
            first: Affine::new(width, width, &vb.pp("nodes.first"))?,
            second: Affine::zero(width, 6, &vb.pp("nodes.second"))?,
            corners: Affine::new(width, corner, &vb.pp("corners"))?,
            strain: Affine::new(3, corner, &vb.pp("strain"))?,
            stress: Affine::zero(corner, 1, &vb.pp("stress"))?,
        })
    }

    /// Corrects the linear answer in `question`, seen in a mirror of the given `signs`.
    pub(super) fn forward(
        &self,
        question: &Question,
        graph: &ObjectGraph,
        signs: &Vector3<f64>,
    ) -> Result<Answer> {
        let nodes = question.gates.len();
        let latent = self.latent(question, graph, signs)?;
        let says = self.second.forward(&self.first.forward_relu(&latent)?)?;
        // Back from the mirrored frame of the grip: v = Rᵀ S w, of rows w S R.
        let turn = nalgebra::Matrix3::from_diagonal(signs) * question.turn;
        let rows: Vec<f32> = turn.transpose().iter().map(|&x| x as f32).collect();
        let back = Tensor::from_vec(rows, (3, 3), &Device::Cpu)?;
        let part = |first: usize| says.narrow(1, first, 3)?.contiguous()?.matmul(&back);
        let given = |field: &[f32]| Tensor::from_slice(field, (nodes, 3), &Device::Cpu);
        let column = |field: &[f32]| Tensor::from_slice(field, (nodes, 1), &Device::Cpu);
        let before = given(&question.displacement)?;
        let displacement = (&before + (part(0)? * f64::from(question.amplitude))?)?;
        let pressed = part(3)?.broadcast_mul(&column(&question.gates)?)?;
        let forces = (given(&question.forces)? + (pressed * f64::from(question.strongest))?)?;
        let unbalanced = forces.sum_keepdim(0)?;
        let forces = (forces - column(&question.bearing)?.matmul(&unbalanced)?)?;
        let force = forces.broadcast_mul(&column(&question.shares)?)?.sum_keepdim(0)?;
        let stress = self.stressed(question, graph, &latent, [&before, &displacement])?;
        Ok(Answer { displacement, stress, forces, force })
    }

    /// Features of the nodes after all rounds (V, H).
    fn latent(
        &self,
        question: &Question,
        graph: &ObjectGraph,
        signs: &Vector3<f64>,
    ) -> Result<Tensor> {
        let turn = nalgebra::Matrix3::from_diagonal(signs) * question.turn;
        let edges: Vec<Tensor> = graph
            .scales
            .iter()
            .map(|scale| {
                let features = scale.features(&turn);
                let count = features.len() / EDGE_FEATURES;
                Tensor::from_vec(features, (count, EDGE_FEATURES), &Device::Cpu)
            })
            .collect::<Result<_>>()?;
        let rounds = |rounds: &[Round], v: Tensor, scale: usize| {
            let graph = &graph.scales[scale].edges;
            rounds.iter().try_fold(v, |v, round| round.forward(&v, &edges[scale], graph))
        };
        let links = [0, 1].map(|i| graph.scales[i].links.as_ref().expect("a coarser scale"));
        let features = question.mirrored(signs);
        let nodes = question.gates.len();
        let features = Tensor::from_vec(features, (nodes, FEATURES), &Device::Cpu)?;
        let fine = rounds(&self.down[0], self.encoder.forward(&features)?, 0)?;
        let middle = self.lower[0].forward(&sparse(&fine, &links[0][1])?)?;
        let middle = rounds(&self.down[1], middle, 1)?;
        let coarse = self.lower[1].forward(&sparse(&middle, &links[1][1])?)?;
        let coarse = rounds(&self.down[2], coarse, 2)?;
        let coarse = coarse.broadcast_add(&self.global.forward(&coarse.mean_keepdim(0)?)?)?;
        let raised = self.raise[1].forward(&sparse(&coarse, &links[1][0])?)?;
        let middle = rounds(&self.up[1], (middle + raised)?, 1)?;
        let raised = self.raise[0].forward(&sparse(&middle, &links[0][0])?)?;
        self.norm.forward(&rounds(&self.up[0], (fine + raised)?, 0)?)
    }

    fn stressed(
        &self,
        question: &Question,
        graph: &ObjectGraph,
        latent: &Tensor,
        displacement: [&Tensor; 2],
    ) -> Result<Tensor> {
        let amplitude = f64::from(question.amplitude);
        let count = question.stress.len();
        let linear = Tensor::from_slice(&question.stress, (1, count), &Device::Cpu)?;
        let [before, after] = displacement.map(|u| von_mises(u, &graph.gradients));
        let (before, after) = (before?, after?);
        let unit = amplitude + f64::from(f32::MIN_POSITIVE);
        let relative = |x: &Tensor| (x / unit)?.reshape((count, 1));
        let strains = [relative(&linear)?, relative(&before)?, relative(&after)?];
        let corners = sparse(&self.corners.forward(latent)?, &graph.corners)?;
        let strain = self.strain.forward(&Tensor::cat(&strains, 1)?)?;
        let says = self.stress.forward(&(corners + strain)?.relu()?)?;
        (linear + (after - before)?)? + (says.reshape((1, count))? * amplitude)?
    }
}
