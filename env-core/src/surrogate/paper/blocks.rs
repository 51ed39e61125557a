//! The perceptron of MeshGraphNets, and the updates of edges, nodes, tetrahedra and the global
//! feature in a round.
//!
//! Shapes: N rows, V nodes, E edges, T tetrahedra, H latent width.

use candle_core::{Result, Tensor};
use candle_nn::{Init, VarBuilder};

use super::{config::PaperConfig, scene::Links};
use crate::surrogate::{
    layers::{LayerNorm, Linear},
    ops::{Sparse, ends, linear_layer, sparse},
};

/// W (x₁, …, xₖ) + b for a concatenation of parts that are all H wide, computed part by part:
/// W₁ x₁ + … + Wₖ xₖ + b.
pub(super) struct EdgeLinear {
    /// Weight (H, K H).
    pub(super) weight: Tensor,
    /// Bias (H).
    pub(super) bias: Tensor,
}

impl EdgeLinear {
    fn new(parts: usize, width: usize, vb: &VarBuilder) -> Result<Self> {
        let bound = 1.0 / ((parts * width) as f64).sqrt();
        let init = Init::Uniform { lo: -bound, up: bound };
        let weight = vb.get_with_hints((width, parts * width), "weight", init)?;
        Ok(Self { weight, bias: vb.get_with_hints(width, "bias", Init::Const(0.0))? })
    }

    /// Wₖ xₖ (N, H) of part `k` (N, H), the first with the bias.
    fn part(&self, k: usize, x: &Tensor) -> Result<Tensor> {
        let width = self.bias.dims1()?;
        let weight = self.weight.narrow(1, k * width, width)?.contiguous()?;
        if k == 0 {
            return linear_layer(x, &weight, &self.bias, false);
        }
        linear_layer(x, &weight, &self.bias.zeros_like()?, false)
    }
}

/// Layers after the first of a perceptron of two hidden layers: relu, the second layer, relu,
/// the third, and a layer norm if there is one.
pub(super) struct Tail {
    second: Linear,
    third: Linear,
    norm: Option<LayerNorm>,
}

impl Tail {
    fn new(width: usize, outputs: usize, norm: bool, vb: &VarBuilder) -> Result<Self> {
        let second = Linear::new(width, width, &vb.pp("second"))?;
        let third = Linear::new(width, outputs, &vb.pp("third"))?;
        Self::of(second, third, norm, vb)
    }

    fn of(second: Linear, third: Linear, norm: bool, vb: &VarBuilder) -> Result<Self> {
        let outputs = third.bias.dims1()?;
        Ok(Self {
            second,
            third,
            norm: norm.then(|| LayerNorm::new(outputs, &vb.pp("norm"))).transpose()?,
        })
    }

    /// Maps the first layer's positive part (N, H) to the outputs.
    fn forward(&self, hidden: &Tensor) -> Result<Tensor> {
        let x = self.third.forward(&self.second.forward_relu(hidden)?)?;
        self.norm.as_ref().map_or(Ok(x.clone()), |norm| norm.forward(&x))
    }
}

/// A perceptron of two hidden layers: encoder or decoder.
pub(super) struct Perceptron {
    first: Linear,
    tail: Tail,
}

impl Perceptron {
    pub(super) fn encoder(
        inputs: usize,
        width: usize,
        norm: bool,
        vb: &VarBuilder,
    ) -> Result<Self> {
        let first = Linear::new(inputs, width, &vb.pp("first"))?;
        Ok(Self { first, tail: Tail::new(width, width, norm, vb)? })
    }

    /// Creates a decoder whose outputs start at zero: a random field on every node is worse than
    /// none, and larger than the response to a light press.
    pub(super) fn decoder(width: usize, outputs: usize, vb: &VarBuilder) -> Result<Self> {
        let first = Linear::new(width, width, &vb.pp("first"))?;
        let second = Linear::new(width, width, &vb.pp("second"))?;
        let third = Linear::zero(width, outputs, &vb.pp("third"))?;
        Ok(Self { first, tail: Tail::of(second, third, false, vb)? })
    }

    /// Maps (N, inputs) to (N, outputs).
    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor> {
        self.tail.forward(&self.first.forward_relu(x)?)
    }
}

/// f(x₁, …, xₖ) of a round: a perceptron on parts that are all H wide.
pub(super) struct Update {
    pub(super) first: EdgeLinear,
    pub(super) tail: Tail,
}

impl Update {
    pub(super) fn new(parts: usize, config: &PaperConfig, vb: &VarBuilder) -> Result<Self> {
        let width = config.width;
        let first = EdgeLinear::new(parts, width, &vb.pp("first"))?;
        Ok(Self { first, tail: Tail::new(width, width, config.norm, vb)? })
    }

    /// Edges: e + f(e, vₛ, vᵣ) (E, H).
    pub(super) fn edges(&self, e: &Tensor, v: &Tensor, links: &Links) -> Result<Tensor> {
        let own = self.first.part(0, e)?;
        let [sent, received] = [self.first.part(1, v)?, self.first.part(2, v)?];
        e + self.tail.forward(&ends(&own, &sent, &received, &links.edges)?)?
    }

    /// Nodes: v + f(v, Σ mesh, Σ contact, g) (V, H), without g if there is none.
    pub(super) fn nodes(
        &self,
        v: &Tensor,
        heard: [&Tensor; 2],
        g: Option<&Tensor>,
    ) -> Result<Tensor> {
        let [mesh, contact] = [self.first.part(1, heard[0])?, self.first.part(2, heard[1])?];
        let mut sum = ((self.first.part(0, v)? + mesh)? + contact)?;
        if let Some(g) = g {
            sum = sum.broadcast_add(&self.first.part(3, g)?)?;
        }
        v + self.tail.forward(&sum.relu()?)?
    }

    /// Tetrahedra: t + f(t, {v}) (T, H), where a set is the sum over its corners.
    pub(super) fn tets(
        &self,
        t: &Tensor,
        v: &Tensor,
        corners: &std::sync::Arc<Sparse>,
    ) -> Result<Tensor> {
        let heard = sparse(&self.first.part(1, v)?, corners)?;
        t + self.tail.forward(&(self.first.part(0, t)? + heard)?.relu()?)?
    }

    /// Global feature: g + f(mean v) (1, H).
    pub(super) fn whole(&self, g: &Tensor, v: &Tensor) -> Result<Tensor> {
        let mean = v.mean_keepdim(0)?;
        g + self.tail.forward(&self.first.part(0, &mean)?.relu()?)?
    }
}

#[cfg(test)]
mod tests {
    use candle_core::Device;

    use super::*;
    use crate::surrogate::{ops::Edges, parameters::Parameters};

    #[test]
    fn a_split_first_layer_is_the_layer_of_the_concatenation() {
        let config = PaperConfig { width: 8, ..PaperConfig::default() };
        let update = Update::new(3, &config, &Parameters::drawn(1).builder()).unwrap();
        let random = |rows: usize| Tensor::randn(0.0_f32, 1.0, (rows, 8), &Device::Cpu).unwrap();
        let (e, v) = (random(3), random(3));
        let links =
            Links::new(Edges { senders: vec![1, 2, 0], starts: vec![0, 2, 2, 3] }, e.clone());
        let rows =
            |rows: [u32; 3]| v.index_select(&Tensor::new(&rows, &Device::Cpu).unwrap(), 0).unwrap();
        let whole = Tensor::cat(&[&e, &rows([1, 2, 0]), &rows([0, 0, 2])], 1).unwrap();
        let hidden = linear_layer(&whole, &update.first.weight, &update.first.bias, true).unwrap();
        let plain = (&e + update.tail.forward(&hidden).unwrap()).unwrap();
        let split = update.edges(&e, &v, &links).unwrap();
        let most = (split - plain).unwrap().abs().unwrap().max_all().unwrap();
        let most: f32 = most.to_scalar().unwrap();
        // 24 products in another order, and a layer norm that may divide by a small deviation.
        assert!(most < 1e-5, "{most}");
    }
}
