//! Baseline, A and B: encoders, rounds, decoders.
//!
//! Shapes: V gel nodes, O object nodes, N = V + O, E edges of a kind, T tetrahedra, H latent width.

use std::sync::Arc;

use candle_core::{DType, Device, Result, Tensor};
use candle_nn::VarBuilder;

use super::{
    blocks::{Perceptron, Update},
    config::{PaperConfig, Variant},
    rigid,
    scene::{CONTACT_FEATURES, MESH_FEATURES, NODE_FEATURES, PaperScene},
};
use crate::surrogate::ops::{Sparse, sparse};

/// Units of the decoders' outputs, in thicknesses and in shear moduli: the root mean square of a
/// typical press is about 1.
pub(super) const DISPLACEMENT: f64 = 0.01;
pub(super) const STRESS: f64 = 0.05;

/// One of the paper's networks.
pub(super) struct Paper {
    nodes: Perceptron,
    mesh: Perceptron,
    contact: Perceptron,
    /// Blocks of the rounds: one each, or one for all.
    blocks: Vec<Block>,
    rounds: usize,
    displacement: Perceptron,
    stress: Perceptron,
    /// B's decoder of the rigid motion.
    rigid: Option<Perceptron>,
}

/// A round of message passing.
struct Block {
    mesh: Update,
    contact: Update,
    nodes: Update,
    tets: Option<Update>,
    whole: Option<Update>,
}

/// Latent features, updated in every round.
pub(super) struct Latent {
    /// Nodes (N, H).
    pub(super) nodes: Tensor,
    /// Edges of the mesh (E, H).
    pub(super) mesh: Tensor,
    /// Contact edges (E, H).
    pub(super) contact: Tensor,
    /// Tetrahedra (T, H), of A and B.
    pub(super) tets: Option<Tensor>,
    /// Global feature (1, H), of B.
    pub(super) whole: Option<Tensor>,
}

/// Output of a network, in units of thickness and shear modulus.
pub(super) struct PaperOutput {
    /// Displacement of the gel (V, 3), zero at bonded nodes.
    pub(super) displacement: Tensor,
    /// Displacement of the object since it touched (O, 3).
    pub(super) object: Tensor,
    /// Von Mises stress (T).
    pub(super) stress: Tensor,
    /// Rotation, row by row, and translation of the gel (12), if the network outputs one.
    pub(super) rigid: Option<Tensor>,
}

impl Paper {
    pub(super) fn new(config: &PaperConfig, vb: &VarBuilder) -> Result<Self> {
        let PaperConfig { variant, width, rounds, shared, norm, .. } = *config;
        let encoder = |name: &str, inputs| Perceptron::encoder(inputs, width, norm, &vb.pp(name));
        let decoder = |name: &str, outputs| Perceptron::decoder(width, outputs, &vb.pp(name));
        let blocks = 0..if shared { rounds.min(1) } else { rounds };
        Ok(Self {
            nodes: encoder("encoder.nodes", NODE_FEATURES)?,
            mesh: encoder("encoder.mesh", MESH_FEATURES)?,
            contact: encoder("encoder.contact", CONTACT_FEATURES)?,
            blocks: blocks
                .map(|i| Block::new(config, &vb.pp("rounds").pp(i)))
                .collect::<Result<_>>()?,
            rounds,
            displacement: decoder("decoder.displacement", 3)?,
            stress: decoder("decoder.stress", 1)?,
            rigid: (variant == Variant::B).then(|| decoder("decoder.rigid", 9)).transpose()?,
        })
    }

    /// Returns whether it is variant B.
    pub(super) fn has_motion(&self) -> bool {
        self.rigid.is_some()
    }

    /// Computes the answer to `scene`.
    pub(super) fn forward(&self, scene: &PaperScene) -> Result<PaperOutput> {
        let mut latent = self.encode(scene)?;
        for round in 0..self.rounds {
            latent = self.blocks[round % self.blocks.len()].forward(&latent, scene)?;
        }
        self.decode(&latent, scene)
    }

    fn encode(&self, scene: &PaperScene) -> Result<Latent> {
        let nodes = self.nodes.forward(&scene.nodes)?;
        let width = nodes.dim(1)?;
        let zeros = |rows: usize| Tensor::zeros((rows, width), DType::F32, &Device::Cpu);
        let block = self.blocks.first();
        let tets =
            block.and_then(|block| block.tets.as_ref()).map(|_| zeros(scene.corners.height()));
        let whole = self.rigid.as_ref().map(|_| zeros(1));
        Ok(Latent {
            nodes,
            mesh: self.mesh.forward(&scene.mesh.features)?,
            contact: self.contact.forward(&scene.contact.features)?,
            tets: tets.transpose()?,
            whole: whole.transpose()?,
        })
    }

    fn decode(&self, latent: &Latent, scene: &PaperScene) -> Result<PaperOutput> {
        let gel = scene.free.dim(0)?;
        let moved = (self.displacement.forward(&latent.nodes)? * DISPLACEMENT)?;
        let stress = match &latent.tets {
            Some(tets) => self.stress.forward(tets)?,
            None => {
                averaged(&self.stress.forward(&latent.nodes.narrow(0, 0, gel)?)?, &scene.corners)?
            }
        };
        let rigid = match (&self.rigid, &latent.whole) {
            (Some(decoder), Some(whole)) => {
                Some(rigid::motion(&(decoder.forward(whole)?.flatten_all()? * DISPLACEMENT)?)?)
            }
            _ => None,
        };
        Ok(PaperOutput {
            displacement: moved.narrow(0, 0, gel)?.broadcast_mul(&scene.free)?,
            object: moved.narrow(0, gel, moved.dim(0)? - gel)?,
            stress: (stress.flatten_all()? * STRESS)?,
            rigid,
        })
    }
}

/// Means (T, 1) of nodal values (N, 1) over the corners of tetrahedra.
fn averaged(nodal: &Tensor, corners: &Arc<Sparse>) -> Result<Tensor> {
    sparse(nodal, corners)? * 0.25
}

impl Block {
    fn new(config: &PaperConfig, vb: &VarBuilder) -> Result<Self> {
        let update = |name: &str, parts| Update::new(parts, config, &vb.pp(name));
        let tets = config.variant != Variant::Baseline;
        let whole = config.variant == Variant::B;
        Ok(Self {
            mesh: update("mesh", 3)?,
            contact: update("contact", 3)?,
            nodes: update("nodes", if whole { 4 } else { 3 })?,
            tets: tets.then(|| update("tets", 2)).transpose()?,
            whole: whole.then(|| update("whole", 1)).transpose()?,
        })
    }

    fn forward(&self, latent: &Latent, scene: &PaperScene) -> Result<Latent> {
        let mesh = self.mesh.edges(&latent.mesh, &latent.nodes, &scene.mesh)?;
        let contact = self.contact.edges(&latent.contact, &latent.nodes, &scene.contact)?;
        let heard = [sparse(&mesh, &scene.mesh.sums)?, sparse(&contact, &scene.contact.sums)?];
        let nodes =
            self.nodes.nodes(&latent.nodes, [&heard[0], &heard[1]], latent.whole.as_ref())?;
        let tets = self.tets.as_ref().zip(latent.tets.as_ref());
        let gel = nodes.narrow(0, 0, scene.free.dim(0)?)?;
        let tets = tets.map(|(update, t)| update.tets(t, &gel, &scene.corners)).transpose()?;
        let whole = self.whole.as_ref().zip(latent.whole.as_ref());
        let whole = whole.map(|(update, g)| update.whole(g, &nodes)).transpose()?;
        Ok(Latent { nodes, mesh, contact, tets, whole })
    }
}

#[cfg(test)]
mod tests {
    use super::{
        super::{
            config::Input,
            gels::PaperGels,
            samples::{PaperSample, tests::pressed_ball},
        },
        *,
    };
    use crate::surrogate::{parameters::Parameters, train::Network};

    fn scene(gels: &PaperGels, sample: &PaperSample) -> PaperScene {
        PaperScene::new(&gels.pads[0], &sample.patch, sample.push(Input::Translation), 0).unwrap()
    }

    fn network(config: &PaperConfig) -> (Parameters, Paper) {
        let parameters = Parameters::drawn(3);
        let network = Paper::new(config, &parameters.builder()).unwrap();
        awaken(&parameters);
        (parameters, network)
    }

    /// Draws weights of the decoders, which start at zero.
    fn awaken(parameters: &Parameters) {
        for (name, variable) in parameters.all() {
            if name.starts_with("decoder") && name.ends_with("third.weight") {
                let drawn = variable.randn_like(0.0, 0.3).unwrap();
                variable.set(&drawn).unwrap();
            }
        }
    }

    #[test]
    fn tetrahedra_send_nothing_back() {
        let (gels, sample) = pressed_ball();
        let (_, network) = network(&PaperConfig { width: 8, rounds: 1, ..PaperConfig::default() });
        let scene = scene(&gels, &sample);
        let latent = network.encode(&scene).unwrap();
        let zeros = latent.tets.clone().unwrap();
        let ones =
            Latent { tets: Some(zeros.ones_like().unwrap()), ..network.encode(&scene).unwrap() };
        let [plain, other] =
            [&latent, &ones].map(|l| network.blocks[0].forward(l, &scene).unwrap());
        let difference = |a: &Tensor, b: &Tensor| -> f32 {
            (a - b).unwrap().abs().unwrap().max_all().unwrap().to_scalar().unwrap()
        };
        assert_eq!(difference(&plain.nodes, &other.nodes), 0.0);
        assert_eq!(difference(&plain.mesh, &other.mesh), 0.0);
        assert_eq!(difference(&plain.contact, &other.contact), 0.0);
        assert_eq!(difference(&plain.whole.unwrap(), &other.whole.unwrap()), 0.0);
        assert!(difference(&plain.tets.unwrap(), &other.tets.unwrap()) > 0.1);
    }

    #[test]
    fn every_parameter_receives_a_gradient() {
        let (gels, sample) = pressed_ball();
        for variant in [Variant::Baseline, Variant::A, Variant::B] {
            for input in [Input::Translation, Input::Force] {
                let (width, rounds) = (8, 2);
                let config =
                    PaperConfig { variant, input, width, rounds, ..PaperConfig::default() };
                let parameters = Parameters::drawn(3);
                let network = <super::super::target::TrainablePaper as Network>::new(
                    &config,
                    &parameters.builder(),
                );
                awaken(&parameters);
                let loss = network.unwrap().loss(&gels, &[&sample], 1).unwrap();
                let gradients = loss.total.backward().unwrap();
                for (name, variable) in parameters.all() {
                    let gradient = gradients.get(&variable);
                    let gradient =
                        gradient.unwrap_or_else(|| panic!("{variant:?}: none for {name}"));
                    let most = gradient.abs().unwrap().max_all().unwrap();
                    assert!(most.to_scalar::<f32>().unwrap() > 0.0, "{variant:?}: zero for {name}");
                }
            }
        }
    }

    #[test]
    fn rounds_may_share_their_weights_and_go_without_norms() {
        let (gels, sample) = pressed_ball();
        let plain = PaperConfig { width: 8, rounds: 3, norm: false, ..PaperConfig::default() };
        let shared = PaperConfig { shared: true, ..plain };
        let count = |config: &PaperConfig| network(config).0.all().len();
        let one = PaperConfig { rounds: 1, ..plain };
        assert_eq!(count(&shared), count(&one));
        assert!(count(&plain) > count(&shared));
        assert!(!network(&plain).0.all().iter().any(|(name, _)| name.contains("norm")));
        let scene = scene(&gels, &sample);
        let output = |config: &PaperConfig| network(config).1.forward(&scene).unwrap().displacement;
        let difference =
            (output(&shared) - output(&one)).unwrap().abs().unwrap().max_all().unwrap();
        assert!(difference.to_scalar::<f32>().unwrap() > 0.0);
    }
}
