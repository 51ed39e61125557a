//! The network of pads: the difference between finite elements and the linear solution.
//!
//! A graph network on the pad's columns (MeshGraphNets, Pfaff et al. 2021, in three scales as in
//! MultiScale MeshGraphNets, Fortunato et al. 2022). Its input is the answer of linear elasticity
//! with friction. Its outputs are corrections: of the displacement of each node, of the force on
//! each touching node, and, for each tetrahedron, of the stress that the corrected displacement
//! implies. Without contact all corrections are exactly zero.
//!
//! Shapes: B presses in a batch, C columns, K free layers, V = C (K + 1) nodes, T tetrahedra, D
//! directions, H latent width, W width of a corner.

use candle_core::{Device, Result, Tensor};
use candle_nn::VarBuilder;
use serde::{Deserialize, Serialize};

use super::{
    features::{DIRECTIONS, FEATURES, Fields, PadInput},
    graph::{LAYERS, PadGraph, SCALES},
    layers::{Linear, Mlp},
    multi_scale::MultiScale,
    ops::{sparse, von_mises},
};

/// Sizes of the network.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CorrectorConfig {
    /// Latent width H.
    pub width: usize,
    /// Rounds of message passing at each scale on the way down, the finest first.
    pub down: [usize; SCALES],
    /// Rounds at each scale but the coarsest on the way up.
    pub up: [usize; SCALES - 1],
    /// Width W of the hidden features of a tetrahedron's corner.
    pub corner: usize,
}

impl Default for CorrectorConfig {
    fn default() -> Self {
        Self { width: 32, down: [1, 1, 1], up: [1, 1], corner: 16 }
    }
}

/// The network.
pub(super) struct Corrector {
    pub(super) scales: MultiScale,
    pub(super) nodes: Mlp,
    pub(super) corners: Linear,
    pub(super) strain: Linear,
    pub(super) stress: Linear,
}

/// Presses on one graph as tensors.
pub(super) struct PadBatch {
    /// Features of the columns (B C, F).
    features: Tensor,
    /// Linear displacement (B V, 3).
    displacement: Tensor,
    /// Linear von Mises stress (B, T).
    stress: Tensor,
    /// Linear contact forces on the face (B, C, 3).
    forces: Tensor,
    /// Linear contact force on all other nodes (B, 3).
    other_force: Tensor,
    /// Factors on the corrections of contact forces (B, C, 1).
    gates: Tensor,
    /// Normals of the object (B, C, 3).
    normals: Tensor,
    /// Vectors along which displacements are corrected (B, C, 3 D).
    directions: Tensor,
    /// Largest displacement of a node (B, 1, 1).
    amplitude: Tensor,
    /// Largest contact force on a node (B, 1, 1).
    strongest: Tensor,
}

/// Corrected answers of a batch, in the units of [`PadInput`].
pub(super) struct CorrectorOutput {
    /// Displacement (B V, 3).
    pub(super) displacement: Tensor,
    /// Von Mises stress (B, T).
    pub(super) stress: Tensor,
    /// Contact forces on the face (B, C, 3).
    pub(super) forces: Tensor,
    /// Net contact force (B, 3).
    pub(super) force: Tensor,
}

impl PadBatch {
    pub(super) fn new(inputs: &[&PadInput]) -> Result<Self> {
        let (count, device) = (inputs.len(), &Device::Cpu);
        let columns = inputs[0].gates.len();
        let all = |field: fn(&PadInput) -> &[f32]| -> Vec<f32> {
            inputs.iter().flat_map(|input| field(input)).copied().collect()
        };
        let single = |field: fn(&PadInput) -> f32| {
            let values: Vec<f32> = inputs.iter().map(|input| field(input)).collect();
            Tensor::from_vec(values, (count, 1, 1), device)
        };
        let displacement = all(|x| &x.displacement);
        let nodes = displacement.len() / 3;
        let width = inputs[0].features.len() / columns;
        Ok(Self {
            features: Tensor::from_vec(all(|x| &x.features), (count * columns, width), device)?,
            displacement: Tensor::from_vec(displacement, (nodes, 3), device)?,
            stress: Tensor::from_vec(all(|x| &x.stress), (count, inputs[0].stress.len()), device)?,
            forces: Tensor::from_vec(all(|x| &x.forces), (count, columns, 3), device)?,
            other_force: Tensor::from_vec(all(|x| &x.other_force), (count, 3), device)?,
            gates: Tensor::from_vec(all(|x| &x.gates), (count, columns, 1), device)?,
            normals: Tensor::from_vec(all(|x| &x.normals), (count, columns, 3), device)?,
            directions: Tensor::from_vec(
                all(|x| &x.directions),
                (count, columns, 3 * DIRECTIONS),
                device,
            )?,
            amplitude: single(|x| x.amplitude)?,
            strongest: single(|x| x.strongest)?,
        })
    }

    fn presses(&self) -> Result<usize> {
        self.amplitude.dim(0)
    }
}

impl Corrector {
    pub(super) fn new(config: &CorrectorConfig, vb: &VarBuilder) -> Result<Self> {
        let CorrectorConfig { width, corner, down, up } = *config;
        let zero = |vb: VarBuilder| Linear::zero(width, OUTPUTS, &vb);
        let nodes = vb.pp("nodes");
        Ok(Self {
            scales: MultiScale::new([FEATURES, width], down, up, vb)?,
            nodes: Mlp {
                first: Linear::new(width, width, &nodes.pp("first"))?,
                second: zero(nodes.pp("second"))?,
            },
            corners: Linear::new(width, (LAYERS + 1) * corner, &vb.pp("corners"))?,
            strain: Linear::new(3, corner, &vb.pp("strain"))?,
            stress: Linear::zero(corner, 1, &vb.pp("stress"))?,
        })
    }

    /// Corrects the linear solutions of `batch`, all on one `graph`.
    pub(super) fn forward(&self, batch: &PadBatch, graph: &PadGraph) -> Result<CorrectorOutput> {
        let PadGraph { edges, levels, .. } = graph;
        let latent = self.scales.latent(&batch.features, edges, levels, batch.presses()?)?;
        let output = self.nodes.forward(&latent)?;
        let displacement = displaced(batch, &output)?;
        let (forces, force) = pressed(batch, &output)?;
        let stress = self.stressed(batch, graph, &latent, &displacement)?;
        Ok(CorrectorOutput { displacement, stress, forces, force })
    }

    /// Corrects the linear solution of one press.
    pub(super) fn fields(&self, input: &PadInput, graph: &PadGraph) -> Result<Fields> {
        let answer = self.forward(&PadBatch::new(&[input])?, graph)?;
        Fields::of([&answer.displacement, &answer.stress, &answer.forces, &answer.force])
    }

    fn stressed(
        &self,
        batch: &PadBatch,
        graph: &PadGraph,
        latent: &Tensor,
        displacement: &Tensor,
    ) -> Result<Tensor> {
        let presses = batch.presses()?;
        let amplitude = batch.amplitude.reshape((presses, 1))?;
        let before = von_mises(&batch.displacement, &graph.gradients)?;
        let after = von_mises(displacement, &graph.gradients)?;
        let unit = (&amplitude + f64::from(f32::MIN_POSITIVE))?;
        let relative = |x: &Tensor| x.broadcast_div(&unit)?.reshape((presses * graph.tets(), 1));
        let strains = [relative(&batch.stress)?, relative(&before)?, relative(&after)?];
        let corner = self.corners.forward(latent)?;
        let corner = corner.reshape((presses * graph.columns * (LAYERS + 1), ()))?;
        let corners = sparse(&corner, &graph.corners)?;
        let strain = self.strain.forward(&Tensor::cat(&strains, 1)?)?;
        let added = self.stress.forward(&(corners + strain)?.relu()?)?;
        let added = added.reshape((presses, graph.tets()))?.broadcast_mul(&amplitude)?;
        (&batch.stress + (after - before)?)? + added
    }
}

/// Number of outputs of a column for each of its layers: an addition to the displacement, factors
/// by which it grows along the face and across it, and its corrections along [`DIRECTIONS`].
pub(super) const OF_LAYER: usize = 3 + 2 + DIRECTIONS;
/// Number of outputs of a column for its contact force: an addition, factors by which it grows
/// along the face and across it, and corrections along the object's normal in units of the
/// strongest force and of its own.
const OF_FORCE: usize = 3 + 2 + 2;
/// Number of outputs of a column.
pub(super) const OUTPUTS: usize = LAYERS * OF_LAYER + OF_FORCE;

/// Corrected displacement of all nodes (B V, 3).
fn displaced(batch: &PadBatch, output: &Tensor) -> Result<Tensor> {
    let (presses, columns) = (batch.presses()?, batch.gates.dim(1)?);
    let output = output.narrow(1, 0, LAYERS * OF_LAYER)?;
    let output = output.reshape((presses, columns, LAYERS, OF_LAYER))?.transpose(1, 2)?;
    let all = batch.displacement.reshape((presses, LAYERS + 1, columns, 3))?;
    let (free, base) = (all.narrow(1, 0, LAYERS)?, all.narrow(1, LAYERS, 1)?);
    let added = output.narrow(3, 0, 3)?.broadcast_mul(&batch.amplitude.unsqueeze(3)?)?;
    let mut corrected = ((&free + added)? + (&free * growth(&output)?)?)?;
    for direction in 0..DIRECTIONS {
        let along = batch.directions.narrow(2, 3 * direction, 3)?.unsqueeze(1)?;
        let size = output.narrow(3, 5 + direction, 1)?;
        corrected = (corrected + size.broadcast_mul(&along)?)?;
    }
    Tensor::cat(&[&corrected, &base], 1)?.reshape(batch.displacement.shape())
}

/// Corrected contact forces on the face (B, C, 3), and net contact force (B, 3).
fn pressed(batch: &PadBatch, output: &Tensor) -> Result<(Tensor, Tensor)> {
    let (presses, columns) = (batch.presses()?, batch.gates.dim(1)?);
    let output = output.narrow(1, LAYERS * OF_LAYER, OF_FORCE)?;
    let output = output.reshape((presses, columns, OF_FORCE))?;
    let unit = batch.gates.broadcast_mul(&batch.strongest)?;
    let along = output.narrow(2, 5, 1)?.mul(&unit)?;
    let own = batch.forces.sqr()?.sum_keepdim(2)?.sqrt()?;
    let along = (along + output.narrow(2, 6, 1)?.mul(&own)?)?;
    let added = output.narrow(2, 0, 3)?.broadcast_mul(&unit)?;
    let added = (added + batch.normals.broadcast_mul(&along)?)?;
    let forces = ((&batch.forces + added)? + (&batch.forces * growth(&output)?)?)?;
    let force = (forces.sum(1)? + &batch.other_force)?;
    Ok((forces, force))
}

/// Factors of growth of a vector (…, 3) among the outputs (…, 5 and more): one along the face, one
/// across it.
fn growth(output: &Tensor) -> Result<Tensor> {
    let axis = output.rank() - 1;
    let [along, across] = [output.narrow(axis, 3, 1)?, output.narrow(axis, 4, 1)?];
    Tensor::cat(&[&along, &along, &across], axis)
}
