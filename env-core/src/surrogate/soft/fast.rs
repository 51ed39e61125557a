//! The network of squeezes without Candle: the same results on one thread, in reused buffers.
//!
//! Plain Candle ([`Soft::forward`]) is the reference. Shapes as there.

use candle_core::Result;
use nalgebra::Vector3;

use super::{graph::ObjectGraph, input::ObjectInput, network::Soft};
use crate::{
    geometry::TetMesh,
    surrogate::{
        features::Fields,
        stress_head::{StressHead, Stresses},
        trunk::{self, Dense, Trunk},
    },
};

/// The network on one object.
pub(super) struct ObjectInference {
    trunk: Trunk,
    nodes: [Dense; 2],
    stress: StressHead,
}

/// Buffers of a forward pass.
#[derive(Default)]
pub(super) struct ObjectBuffers {
    trunk: trunk::TrunkBuffers,
    hidden: Vec<f32>,
    output: Vec<f32>,
    corners: Vec<f32>,
}

impl ObjectInference {
    /// Prepares `network` for the `graph` of `mesh`.
    pub(super) fn new(network: &Soft, graph: &ObjectGraph, mesh: &TetMesh) -> Result<Self> {
        let heads = [&network.corners, &network.strain, &network.stress];
        Ok(Self {
            // Edge features depend on the frame of the grip.
            trunk: Trunk::new(&network.scales, &graph.levels, None)?,
            nodes: Dense::pair(&network.nodes)?,
            stress: StressHead::new(heads, 1, mesh.tets.clone())?,
        })
    }

    /// Computes the corrected answer to `input`.
    pub(super) fn forward(
        &self,
        input: &ObjectInput,
        graph: &ObjectGraph,
        scratch: &mut ObjectBuffers,
    ) -> Fields {
        let ObjectBuffers { trunk, hidden, output, corners } = scratch;
        let edges = [0, 1, 2].map(|scale| graph.edges(scale, &input.turn));
        let edges = edges.each_ref().map(Vec::as_slice);
        let latent = self.trunk.latent(&input.features, &edges, trunk);
        self.nodes[0].forward_relu(latent, hidden);
        self.nodes[1].forward(hidden, output);
        let displacement = displaced(input, output);
        let forces = pressed(input, output);
        let mut force = [0.0; 3];
        for (own, share) in forces.as_chunks::<3>().0.iter().zip(&input.shares) {
            (0..3).for_each(|i| force[i] += own[i] * share);
        }
        let [before, after] = [&input.displacement, &displacement].map(|u| {
            let mut stress = vec![0.0; input.stress.len()];
            graph.gradients.stress(u, &mut stress);
            stress
        });
        let stresses = Stresses {
            linear: &input.stress,
            moved: [&before, &after],
            amplitude: input.amplitude,
        };
        let stress = self.stress.forward(latent, &stresses, corners);
        Fields { displacement, stress, forces, force }
    }
}

/// A vector at each node that starts with number `first` of its six in `output`, in the object's
/// frame.
fn vectors<'a>(
    input: &ObjectInput,
    output: &'a [f32],
    first: usize,
) -> impl Iterator<Item = [f32; 3]> + 'a {
    let back = input.turn.transpose().cast::<f32>();
    output.as_chunks::<6>().0.iter().map(move |output| {
        let seen = Vector3::new(output[first], output[first + 1], output[first + 2]);
        (back * seen).into()
    })
}

fn displaced(input: &ObjectInput, output: &[f32]) -> Vec<f32> {
    let mut displacement = input.displacement.clone();
    let nodes = displacement.as_chunks_mut::<3>().0.iter_mut();
    for (node, added) in nodes.zip(vectors(input, output, 0)) {
        node.iter_mut().zip(added).for_each(|(u, x)| *u += input.amplitude * x);
    }
    displacement
}

/// Forces on the nodes, in balance.
fn pressed(input: &ObjectInput, output: &[f32]) -> Vec<f32> {
    let mut forces = input.forces.clone();
    let mut sum = [0.0; 3];
    let nodes = forces.as_chunks_mut::<3>().0.iter_mut().zip(&input.gates);
    for ((node, gate), added) in nodes.zip(vectors(input, output, 3)) {
        for i in 0..3 {
            node[i] += added[i] * gate * input.strongest;
            sum[i] += node[i];
        }
    }
    for (node, bearing) in forces.as_chunks_mut::<3>().0.iter_mut().zip(&input.bearing) {
        (0..3).for_each(|i| node[i] -= bearing * sum[i]);
    }
    forces
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::{
        super::network::tests::{network, numbers, squeezed, still},
        *,
    };

    #[test]
    fn its_answers_are_those_of_candle() {
        let (_, network) = network();
        for turn in [[0.0; 3], [0.4, -1.1, 2.0]] {
            let turn = UnitQuaternion::from_euler_angles(turn[0], turn[1], turn[2]);
            let (mesh, graph, input) = squeezed(&turn);
            let plain = network.forward(&input, &graph, &still()).unwrap();
            let fast = ObjectInference::new(&network, &graph, &mesh).unwrap();
            let found = fast.forward(&input, &graph, &mut ObjectBuffers::default());
            for (name, plain, own) in [
                ("displacement", &plain.displacement, &found.displacement[..]),
                ("stress", &plain.stress, &found.stress),
                ("forces", &plain.forces, &found.forces),
                ("force", &plain.force, &found.force),
            ] {
                let plain = numbers(plain);
                let scale = plain.iter().fold(0.0_f32, |most, x| most.max(x.abs()));
                let near = plain.iter().zip(own).all(|(a, b)| (a - b).abs() < 1e-4 * scale);
                assert!(plain.len() == own.len() && scale > 0.0 && near, "{name}, of {scale}");
            }
        }
    }
}
