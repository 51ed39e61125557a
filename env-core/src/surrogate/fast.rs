//! The corrector without Candle: the same results on one thread, in reused buffers.
//!
//! Plain Candle ([`Corrector::forward`]) is the reference. Shapes as in the corrector, with one
//! press.

#![allow(clippy::inline_always)] // Code that is not inlined is not compiled for the processor.

use std::cell::RefCell;

use candle_core::Result;

use super::{
    corrector::{Corrector, OF_LAYER, OUTPUTS},
    features::{DIRECTIONS, Fields, PadInput},
    graph::{LAYERS, PadGraph, SCALES},
    ops::PadStress,
    stress_head::{StressHead, Stresses},
    trunk::{self, Dense, Trunk},
};
use crate::{geometry::PadMesh, simd::vectorised};

/// The network on one pad.
pub(super) struct PadInference {
    trunk: Trunk,
    nodes: [Dense; 2],
    stress: StressHead,
    elements: PadStress,
    columns: usize,
}

thread_local! {
    /// Reused from press to press: to free and allocate them costs as much as a layer.
    static BUFFERS: RefCell<PadBuffers> = RefCell::default();
}

/// Buffers of a forward pass.
#[derive(Default)]
struct PadBuffers {
    trunk: trunk::TrunkBuffers,
    hidden: Vec<f32>,
    output: Vec<f32>,
    corners: Vec<f32>,
    stress: Vec<f32>,
}

impl PadInference {
    /// Prepares `network` for the `graph` of `pad`.
    pub(super) fn new(network: &Corrector, graph: &PadGraph, pad: &PadMesh) -> Result<Self> {
        let columns = graph.columns as u32;
        // Nodes ordered by column, then layer.
        let place = |node: u32| node % columns * (LAYERS as u32 + 1) + node / columns;
        let tets = pad.mesh.tets.iter().map(|tet| tet.map(place)).collect();
        let heads = [&network.corners, &network.strain, &network.stress];
        Ok(Self {
            trunk: Trunk::new(&network.scales, &graph.levels, Some(&graph.edges))?,
            nodes: Dense::pair(&network.nodes)?,
            stress: StressHead::new(heads, LAYERS + 1, tets)?,
            elements: PadStress::new(pad, pad.thickness()),
            columns: graph.columns,
        })
    }

    /// Corrects the linear solution in `input`; stress is left empty unless `with_stress`.
    pub(super) fn forward(&self, input: &PadInput, with_stress: bool) -> Fields {
        BUFFERS.with_borrow_mut(|buffers| self.forward_in(buffers, input, with_stress))
    }

    fn forward_in(&self, buffers: &mut PadBuffers, input: &PadInput, with_stress: bool) -> Fields {
        let PadBuffers { trunk, hidden, output, corners, stress } = buffers;
        let latent = self.trunk.latent(&input.features, &[&[]; SCALES], trunk);
        self.nodes[0].forward_relu(latent, hidden);
        self.nodes[1].forward(hidden, output);
        let displacement = self.displaced(input, output);
        let (forces, force) = pressed(input, output);
        let stress = if with_stress {
            let [before, after] =
                [&input.displacement, &displacement].map(|u| self.moved(u, stress));
            let stresses = Stresses {
                linear: &input.stress,
                moved: [&before, &after],
                amplitude: input.amplitude,
            };
            self.stress.forward(latent, &stresses, corners)
        } else {
            Vec::new()
        };
        Fields { displacement, stress, forces, force }
    }

    /// Stress of the tetrahedra (T) under the displacement `u` (V, 3); `stress` is a buffer.
    fn moved(&self, u: &[f32], stress: &mut Vec<f32>) -> Vec<f32> {
        let arranged = self.elements.arranged(u.as_chunks().0);
        vectorised(
            #[inline(always)]
            || self.elements.stress(&arranged, stress),
        );
        self.elements.places().iter().map(|&place| stress[place as usize]).collect()
    }

    fn displaced(&self, input: &PadInput, output: &[f32]) -> Vec<f32> {
        let mut displacement = input.displacement.clone();
        let columns = self.columns;
        let directions = input.directions.as_chunks::<{ 3 * DIRECTIONS }>().0;
        let of_columns = output.as_chunks::<OUTPUTS>().0.iter().zip(directions);
        for (column, (output, directions)) in of_columns.enumerate() {
            let layers = output[..LAYERS * OF_LAYER].as_chunks::<OF_LAYER>().0;
            for (layer, output) in layers.iter().enumerate() {
                let node = &mut displacement[3 * (layer * columns + column)..][..3];
                for (axis, u) in node.iter_mut().enumerate() {
                    let mut corrected = *u * growth(output, axis) + input.amplitude * output[axis];
                    for (size, direction) in output[5..].iter().zip(directions.as_chunks::<3>().0) {
                        corrected += size * direction[axis];
                    }
                    *u = corrected;
                }
            }
        }
        displacement
    }
}

fn pressed(input: &PadInput, output: &[f32]) -> (Vec<f32>, [f32; 3]) {
    let mut forces = input.forces.clone();
    let mut sum = input.other_force;
    let columns = forces.as_chunks_mut::<3>().0.iter_mut().zip(&input.gates);
    let columns = columns.zip(input.normals.as_chunks::<3>().0);
    for (((force, gate), normal), output) in columns.zip(output.as_chunks::<OUTPUTS>().0) {
        let output = &output[LAYERS * OF_LAYER..];
        let unit = gate * input.strongest;
        let own = force.iter().map(|x| x * x).sum::<f32>().sqrt();
        let along = output[5] * unit + output[6] * own;
        for axis in 0..3 {
            force[axis] = force[axis] * growth(output, axis) + output[axis] * unit;
            force[axis] += along * normal[axis];
            sum[axis] += force[axis];
        }
    }
    (forces, sum)
}

/// Factor by which the outputs of a vector multiply its component along `axis`.
fn growth(output: &[f32], axis: usize) -> f32 {
    1.0 + output[if axis == 2 { 4 } else { 3 }]
}

#[cfg(test)]
mod tests {
    use candle_core::Tensor;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::{
        super::{
            corrector::{CorrectorConfig, PadBatch},
            features::FEATURES,
            parameters::Parameters,
        },
        *,
    };
    use crate::sensor::Sensor;

    /// Compares both paths for random inputs and random weights.
    #[test]
    fn its_answers_are_those_of_candle() {
        // Corner widths that are a multiple of the vector width, and not.
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
        let input = PadInput {
            features: numbers(graph.columns * FEATURES, 1.0),
            displacement: numbers(3 * nodes, 0.02),
            stress: numbers(graph.tets(), 0.1),
            forces: numbers(3 * graph.columns, 0.1),
            other_force: [0.1, 0.2, 0.3],
            gates: numbers(graph.columns, 1.0),
            normals: numbers(3 * graph.columns, 1.0),
            directions: numbers(3 * DIRECTIONS * graph.columns, 0.02),
            amplitude: 0.1,
            strongest: 0.1,
        };
        let answer = network.forward(&PadBatch::new(&[&input]).unwrap(), &graph).unwrap();
        let fast = PadInference::new(&network, &graph, &pad).unwrap();
        let found = fast.forward(&input, true);
        let near = |name: &str, plain: &Tensor, own: &[f32]| {
            let plain: Vec<f32> = plain.flatten_all().unwrap().to_vec1().unwrap();
            let scale = plain.iter().fold(0.0_f32, |most, x| most.max(x.abs()));
            let near = plain.iter().zip(own).all(|(a, b)| (a - b).abs() < 1e-4 * scale);
            assert!(plain.len() == own.len() && scale > 0.0 && near, "{name}, of {scale}");
        };
        near("displacement", &answer.displacement, &found.displacement);
        near("stress", &answer.stress, &found.stress);
        near("forces", &answer.forces, &found.forces);
        near("force", &answer.force, &found.force);
    }
}
