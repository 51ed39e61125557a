//! The network of squeezes without Candle: the same numbers, on one thread, in buffers that are kept.
//!
//! Plain Candle ([`Soft::forward`]) is the oracle. Shapes as there.

use candle_core::Result;
use nalgebra::Vector3;

use super::{graph::ObjectGraph, network::Soft, question::ObjectInput};
use crate::{
    geometry::TetMesh,
    surrogate::{
        metrics::Fields,
        stress_head::{StressHead, Stresses},
        trunk::{self, Dense, Trunk, relu},
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
    says: Vec<f32>,
    corners: Vec<f32>,
}

impl ObjectInference {
    /// `network` on the `graph` of `mesh`.
    pub(super) fn new(network: &Soft, graph: &ObjectGraph, mesh: &TetMesh) -> Result<Self> {
        let heads = [&network.corners, &network.strain, &network.stress];
        Ok(Self {
            // Edges are seen in the frame of each grip.
            trunk: Trunk::new(&network.scales, &graph.levels, None)?,
            nodes: Dense::pair(&network.nodes)?,
            stress: StressHead::new(heads, 1, mesh.tets.clone())?,
        })
    }

    /// The corrected answer to `question`.
    pub(super) fn forward(
        &self,
        question: &ObjectInput,
        graph: &ObjectGraph,
        scratch: &mut ObjectBuffers,
    ) -> Fields {
        let ObjectBuffers { trunk, hidden, says, corners } = scratch;
        let edges = [0, 1, 2].map(|scale| graph.edges(scale, &question.turn));
        let edges = edges.each_ref().map(Vec::as_slice);
        let latent = self.trunk.latent(&question.features, &edges, trunk);
        self.nodes[0].forward(latent, hidden);
        relu(hidden);
        self.nodes[1].forward(hidden, says);
        let displacement = displaced(question, says);
        let forces = pressed(question, says);
        let mut force = [0.0; 3];
        for (own, share) in forces.as_chunks::<3>().0.iter().zip(&question.shares) {
            (0..3).for_each(|i| force[i] += own[i] * share);
        }
        let [before, after] = [&question.displacement, &displacement].map(|u| {
            let mut stress = vec![0.0; question.stress.len()];
            graph.gradients.stress(u, &mut stress);
            stress
        });
        let stresses = Stresses {
            linear: &question.stress,
            moved: [&before, &after],
            amplitude: question.amplitude,
        };
        let stress = self.stress.forward(latent, &stresses, corners);
        Fields { displacement, stress, forces, force }
    }
}

/// A vector at each node that starts with number `first` of its six in `says`, in the object's frame.
fn said<'a>(
    question: &ObjectInput,
    says: &'a [f32],
    first: usize,
) -> impl Iterator<Item = [f32; 3]> + 'a {
    let back = question.turn.transpose().cast::<f32>();
    says.as_chunks::<6>().0.iter().map(move |says| {
        let seen = Vector3::new(says[first], says[first + 1], says[first + 2]);
        (back * seen).into()
    })
}

fn displaced(question: &ObjectInput, says: &[f32]) -> Vec<f32> {
    let mut displacement = question.displacement.clone();
    let nodes = displacement.as_chunks_mut::<3>().0.iter_mut();
    for (node, added) in nodes.zip(said(question, says, 0)) {
        node.iter_mut().zip(added).for_each(|(u, x)| *u += question.amplitude * x);
    }
    displacement
}

/// Forces on the nodes, in balance.
fn pressed(question: &ObjectInput, says: &[f32]) -> Vec<f32> {
    let mut forces = question.forces.clone();
    let mut sum = [0.0; 3];
    let nodes = forces.as_chunks_mut::<3>().0.iter_mut().zip(&question.gates);
    for ((node, gate), added) in nodes.zip(said(question, says, 3)) {
        for i in 0..3 {
            node[i] += added[i] * gate * question.strongest;
            sum[i] += node[i];
        }
    }
    for (node, bearing) in forces.as_chunks_mut::<3>().0.iter_mut().zip(&question.bearing) {
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
    fn it_says_what_candle_says() {
        let (_, network) = network();
        for turn in [[0.0; 3], [0.4, -1.1, 2.0]] {
            let turn = UnitQuaternion::from_euler_angles(turn[0], turn[1], turn[2]);
            let (mesh, graph, question) = squeezed(&turn);
            let plain = network.forward(&question, &graph, &still()).unwrap();
            let fast = ObjectInference::new(&network, &graph, &mesh).unwrap();
            let found = fast.forward(&question, &graph, &mut ObjectBuffers::default());
            for (name, plain, own) in [
                ("displacement", &plain.displacement, &found.displacement[..]),
                ("stress", &plain.stress, &found.stress),
                ("forces", &plain.forces, &found.forces),
                ("force", &plain.force, &found.force),
            ] {
                let plain = numbers(plain);
                let scale = plain.iter().fold(0.0_f32, |most, x| most.max(x.abs()));
                let far = plain.iter().zip(own).fold(0.0_f32, |far, (a, b)| far.max((a - b).abs()));
                assert!(plain.len() == own.len() && scale > 0.0, "{name}: {scale}");
                assert!(far < 1e-4 * scale, "{name}: {far} of {scale}");
            }
        }
    }
}
