//! Message passing in three scales, from features of nodes to their latent rows, by Candle's
//! layers.
//!
//! MeshGraphNets (Pfaff et al. 2021) on scales as in Fortunato et al. (2022). Networks train on
//! these layers; [`Trunk`](super::trunk::Trunk) computes the same results faster.
//!
//! Shapes: B presses in a batch, N nodes, E edges, H latent width.

use candle_core::{Result, Tensor};
use candle_nn::VarBuilder;

use super::{
    graph::{EDGE_FEATURES, Level, SCALES},
    layers::{LayerNorm, Linear, Mlp, Round},
    ops::sparse,
};

/// Layers of the network.
pub(super) struct MultiScale {
    pub(super) encoder: Mlp,
    /// Rounds at each scale on the way down, the finest first.
    pub(super) down: [Vec<Round>; SCALES],
    /// Rounds at each scale but the coarsest on the way up.
    pub(super) up: [Vec<Round>; SCALES - 1],
    /// Layers to each coarser scale.
    pub(super) lower: [Linear; SCALES - 1],
    /// Layers back from each coarser scale.
    pub(super) raise: [Linear; SCALES - 1],
    pub(super) global: Mlp,
    pub(super) norm: LayerNorm,
}

impl MultiScale {
    /// Creates layers from `features` to `width` numbers per node, with `down` and `up` rounds at
    /// each scale.
    pub(super) fn new(
        [features, width]: [usize; 2],
        down: [usize; SCALES],
        up: [usize; SCALES - 1],
        vb: &VarBuilder,
    ) -> Result<Self> {
        let rounds = |count: usize, vb: VarBuilder| {
            (0..count)
                .map(|i| Round::new(width, EDGE_FEATURES, &vb.pp(i)))
                .collect::<Result<Vec<_>>>()
        };
        let link = |name: &str, i: usize| Linear::new(width, width, &vb.pp(name).pp(i));
        Ok(Self {
            encoder: Mlp::new([features, width, width], &vb.pp("encoder"))?,
            down: [
                rounds(down[0], vb.pp("down.0"))?,
                rounds(down[1], vb.pp("down.1"))?,
                rounds(down[2], vb.pp("down.2"))?,
            ],
            up: [rounds(up[0], vb.pp("up.0"))?, rounds(up[1], vb.pp("up.1"))?],
            lower: [link("lower", 0)?, link("lower", 1)?],
            raise: [link("raise", 0)?, link("raise", 1)?],
            global: Mlp::new([width, width, width], &vb.pp("global"))?,
            norm: LayerNorm::new(width, &vb.pp("norm"))?,
        })
    }

    /// Latent rows (B N, H) of the finest of `levels` for the `features` of its nodes (B N, F),
    /// with the features `edges` of the edges of each level (E, `EDGE_FEATURES`).
    pub(super) fn latent(
        &self,
        features: &Tensor,
        edges: &[Tensor; SCALES],
        levels: &[Level; SCALES],
        presses: usize,
    ) -> Result<Tensor> {
        let rounds = |rounds: &[Round], v: Tensor, scale: usize| {
            let (features, graph) = (&edges[scale], &levels[scale].edges);
            rounds.iter().try_fold(v, |v, round| round.forward(&v, features, graph))
        };
        let links = [0, 1].map(|i| levels[i].links.as_ref().expect("a coarser scale"));
        let fine = rounds(&self.down[0], self.encoder.forward(features)?, 0)?;
        let middle = self.lower[0].forward(&sparse(&fine, &links[0][1])?)?;
        let middle = rounds(&self.down[1], middle, 1)?;
        let coarse = self.lower[1].forward(&sparse(&middle, &links[1][1])?)?;
        let coarse = self.shared(&rounds(&self.down[2], coarse, 2)?, presses)?;
        let raised = self.raise[1].forward(&sparse(&coarse, &links[1][0])?)?;
        let middle = rounds(&self.up[1], (middle + raised)?, 1)?;
        let raised = self.raise[0].forward(&sparse(&middle, &links[0][0])?)?;
        self.norm.forward(&rounds(&self.up[0], (fine + raised)?, 0)?)
    }

    /// Adds to each row of `v` (B N, H) a function of the mean row of its press.
    fn shared(&self, v: &Tensor, presses: usize) -> Result<Tensor> {
        let by_press = v.reshape((presses, (), v.dim(1)?))?;
        let global = self.global.forward(&by_press.mean(1)?)?;
        by_press.broadcast_add(&global.unsqueeze(1)?)?.reshape(v.shape())
    }
}
