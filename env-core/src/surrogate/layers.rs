//! Layers of the networks.
//!
//! Shapes: N rows, B presses in a batch, V nodes, E edges, H latent width.

use std::sync::Arc;

use candle_core::{Result, Tensor};
use candle_nn::{Init, VarBuilder};

use super::ops::{Edges, layer_norm, linear_layer, messages};

/// x Wᵀ + b, or its positive part.
pub(super) struct Linear {
    /// Weight (M, K).
    pub(super) weight: Tensor,
    /// Bias (M).
    pub(super) bias: Tensor,
}

impl Linear {
    /// Creates a layer from `inputs` to `outputs` numbers, with random weights.
    pub(super) fn new(inputs: usize, outputs: usize, vb: &VarBuilder) -> Result<Self> {
        let bound = 1.0 / (inputs as f64).sqrt();
        Self::with(inputs, outputs, vb, Init::Uniform { lo: -bound, up: bound })
    }

    /// Creates a layer as [`Linear::new`] does, with zero weights.
    pub(super) fn zero(inputs: usize, outputs: usize, vb: &VarBuilder) -> Result<Self> {
        Self::with(inputs, outputs, vb, Init::Const(0.0))
    }

    fn with(inputs: usize, outputs: usize, vb: &VarBuilder, init: Init) -> Result<Self> {
        let weight = vb.get_with_hints((outputs, inputs), "weight", init)?;
        let bias = vb.get_with_hints(outputs, "bias", Init::Const(0.0))?;
        Ok(Self { weight, bias })
    }

    /// Maps (N, K) to (N, M).
    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor> {
        linear_layer(x, &self.weight, &self.bias, false)
    }

    /// Positive part of [`Linear::forward`].
    pub(super) fn forward_relu(&self, x: &Tensor) -> Result<Tensor> {
        linear_layer(x, &self.weight, &self.bias, true)
    }
}

/// Layer norm.
pub(super) struct LayerNorm {
    pub(super) scale: Tensor,
    pub(super) shift: Tensor,
}

impl LayerNorm {
    /// Creates a layer for rows of `width` numbers.
    pub(super) fn new(width: usize, vb: &VarBuilder) -> Result<Self> {
        let scale = vb.get_with_hints(width, "scale", Init::Const(1.0))?;
        let shift = vb.get_with_hints(width, "shift", Init::Const(0.0))?;
        Ok(Self { scale, shift })
    }

    /// Maps (N, H) to (N, H).
    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor> {
        layer_norm(x, &self.scale, &self.shift)
    }
}

/// Two linear layers with a ReLU between them.
pub(super) struct Mlp {
    pub(super) first: Linear,
    pub(super) second: Linear,
}

impl Mlp {
    /// Creates layers from `inputs` over `hidden` to `outputs` numbers.
    pub(super) fn new([inputs, hidden, outputs]: [usize; 3], vb: &VarBuilder) -> Result<Self> {
        let first = Linear::new(inputs, hidden, &vb.pp("first"))?;
        Ok(Self { first, second: Linear::new(hidden, outputs, &vb.pp("second"))? })
    }

    /// Maps (N, inputs) to (N, outputs).
    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor> {
        self.second.forward(&self.first.forward_relu(x)?)
    }
}

/// A round of message passing on a graph with fixed edge features:
/// v ← v + f(n, Σₛ relu(A nₛ + B nᵣ + C eₛᵣ)), n the layer norm of v and f two linear layers.
pub(super) struct Round {
    pub(super) norm: LayerNorm,
    pub(super) ends: Linear,
    pub(super) edges: Linear,
    pub(super) update: Mlp,
}

impl Round {
    /// Creates a round of latent width `width` on edges with `features` numbers each.
    pub(super) fn new(width: usize, features: usize, vb: &VarBuilder) -> Result<Self> {
        Ok(Self {
            norm: LayerNorm::new(width, &vb.pp("norm"))?,
            ends: Linear::new(width, 2 * width, &vb.pp("ends"))?,
            edges: Linear::new(features, width, &vb.pp("edges"))?,
            update: Mlp::new([2 * width, width, width], &vb.pp("update"))?,
        })
    }

    /// Maps (B V, H) to (B V, H), along `graph` with `features` (E, F) on its edges.
    pub(super) fn forward(
        &self,
        v: &Tensor,
        features: &Tensor,
        graph: &Arc<Edges>,
    ) -> Result<Tensor> {
        let n = self.norm.forward(v)?;
        let heard = messages(&self.ends.forward(&n)?, &self.edges.forward(features)?, graph)?;
        v + self.update.forward(&Tensor::cat(&[&n, &heard], 1)?)?
    }
}
