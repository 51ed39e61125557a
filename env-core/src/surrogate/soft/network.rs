//! Network for the difference between finite elements and the linear solution of a squeezed object.
//!
//! A graph network in three scales (MeshGraphNets, Pfaff et al. 2021; scales as in Fortunato et al.
//! 2022) on the object's mesh. Its outputs are additions to the displacement of each node, to the
//! contact force on each node of the surface near a finger, and to the stress of each tetrahedron
//! that the corrected displacement implies. The forces sum to zero, as those on a free body do.
//!
//! Shapes: V nodes, T tetrahedra, H latent width, W width of a corner.

use candle_core::{Device, Result, Tensor};
use candle_nn::VarBuilder;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{
    graph::ObjectGraph,
    input::{FEATURES, ObjectInput},
};
use crate::surrogate::{
    graph::{EDGE_FEATURES, SCALES},
    layers::{Linear, Mlp},
    multi_scale::MultiScale,
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
    pub(super) scales: MultiScale,
    pub(super) nodes: Mlp,
    pub(super) corners: Linear,
    pub(super) strain: Linear,
    pub(super) stress: Linear,
}

/// Output of the network, in the units of [`ObjectInput`] and the object's frame.
pub(super) struct ObjectOutput {
    /// Displacement (V, 3).
    pub(super) displacement: Tensor,
    /// Von Mises stress (1, T).
    pub(super) stress: Tensor,
    /// Contact forces (V, 3).
    pub(super) forces: Tensor,
    /// Force of the squeeze (1, 3): half the difference of the fingers' forces.
    pub(super) force: Tensor,
}

impl Soft {
    pub(super) fn new(config: &SoftConfig, vb: &VarBuilder) -> Result<Self> {
        let SoftConfig { width, corner, down, up } = *config;
        Ok(Self {
            scales: MultiScale::new([FEATURES, width], down, up, vb)?,
            nodes: Mlp {
                first: Linear::new(width, width, &vb.pp("nodes.first"))?,
                second: Linear::zero(width, 6, &vb.pp("nodes.second"))?,
            },
            corners: Linear::new(width, corner, &vb.pp("corners"))?,
            strain: Linear::new(3, corner, &vb.pp("strain"))?,
            stress: Linear::zero(corner, 1, &vb.pp("stress"))?,
        })
    }

    /// Corrects the linear solution in `input`, seen in a mirror of the given `signs`.
    pub(super) fn forward(
        &self,
        input: &ObjectInput,
        graph: &ObjectGraph,
        signs: &Vector3<f64>,
    ) -> Result<ObjectOutput> {
        let nodes = input.gates.len();
        let latent = self.latent(input, graph, signs)?;
        let output = self.nodes.forward(&latent)?;
        // Back from the mirrored frame of the grip: v = Rᵀ S w, of rows w S R.
        let turn = nalgebra::Matrix3::from_diagonal(signs) * input.turn;
        let rows: Vec<f32> = turn.transpose().iter().map(|&x| x as f32).collect();
        let back = Tensor::from_vec(rows, (3, 3), &Device::Cpu)?;
        let part = |first: usize| output.narrow(1, first, 3)?.contiguous()?.matmul(&back);
        let given = |field: &[f32]| Tensor::from_slice(field, (nodes, 3), &Device::Cpu);
        let column = |field: &[f32]| Tensor::from_slice(field, (nodes, 1), &Device::Cpu);
        let before = given(&input.displacement)?;
        let displacement = (&before + (part(0)? * f64::from(input.amplitude))?)?;
        let pressed = part(3)?.broadcast_mul(&column(&input.gates)?)?;
        let forces = (given(&input.forces)? + (pressed * f64::from(input.strongest))?)?;
        let unbalanced = forces.sum_keepdim(0)?;
        let forces = (forces - column(&input.bearing)?.matmul(&unbalanced)?)?;
        let force = forces.broadcast_mul(&column(&input.shares)?)?.sum_keepdim(0)?;
        let stress = self.stressed(input, graph, &latent, [&before, &displacement])?;
        Ok(ObjectOutput { displacement, stress, forces, force })
    }

    /// Features of the nodes after all rounds (V, H).
    fn latent(
        &self,
        input: &ObjectInput,
        graph: &ObjectGraph,
        signs: &Vector3<f64>,
    ) -> Result<Tensor> {
        let turn = nalgebra::Matrix3::from_diagonal(signs) * input.turn;
        let edges = |scale: usize| {
            let features = graph.edges(scale, &turn);
            let count = features.len() / EDGE_FEATURES;
            Tensor::from_vec(features, (count, EDGE_FEATURES), &Device::Cpu)
        };
        let edges = [edges(0)?, edges(1)?, edges(2)?];
        let nodes = input.gates.len();
        let features = Tensor::from_vec(input.mirrored(signs), (nodes, FEATURES), &Device::Cpu)?;
        self.scales.latent(&features, &edges, &graph.levels, 1)
    }

    fn stressed(
        &self,
        input: &ObjectInput,
        graph: &ObjectGraph,
        latent: &Tensor,
        displacement: [&Tensor; 2],
    ) -> Result<Tensor> {
        let amplitude = f64::from(input.amplitude);
        let count = input.stress.len();
        let linear = Tensor::from_slice(&input.stress, (1, count), &Device::Cpu)?;
        let [before, after] = displacement.map(|u| von_mises(u, &graph.gradients));
        let (before, after) = (before?, after?);
        let unit = amplitude + f64::from(f32::MIN_POSITIVE);
        let relative = |x: &Tensor| (x / unit)?.reshape((count, 1));
        let strains = [relative(&linear)?, relative(&before)?, relative(&after)?];
        let corners = sparse(&self.corners.forward(latent)?, &graph.corners)?;
        let strain = self.strain.forward(&Tensor::cat(&strains, 1)?)?;
        let added = self.stress.forward(&(corners + strain)?.relu()?)?;
        (linear + (after - before)?)? + (added.reshape((1, count))? * amplitude)?
    }
}

#[cfg(test)]
pub(super) mod tests {
    use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion};

    use super::{
        super::{grip::Grip, samples::squeezing},
        *,
    };
    use crate::{
        compliance::{Compliance, ComplianceOptions},
        deformation::{Deformation, Law, Moduli, Press, SoftBody},
        geometry::{Shape, TetMesh},
        objects::tets_within,
        surrogate::{material::PadMaterial, parameters::Parameters},
    };

    const MODULI: Moduli = Moduli { young: 1e5, poisson: 0.45 };

    /// A ball of 2 cm squeezed by 1 mm from either side, everything turned by `turn`: its mesh,
    /// graph and input.
    pub(in super::super) fn squeezed(
        turn: &UnitQuaternion<f64>,
    ) -> (TetMesh, ObjectGraph, ObjectInput) {
        let mut mesh = tets_within(&Shape::Sphere { radius: 0.02 }, 150).unwrap();
        // No two distances are equal, or coarse scales would depend on rounding.
        for (i, place) in mesh.vertices.iter_mut().enumerate() {
            let shift = Vector3::from([1.0, 2.0, 3.0].map(|k| (k * (i * i) as f64).sin()));
            *place += 2e-4 * shift;
        }
        let half = Vector3::new(0.01, 0.012, 0.002);
        let flip = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let away = |z: f64| Isometry3::translation(0.0, 0.0, z);
        let poses = vec![away(-0.021), away(0.021) * flip];
        let fingers = vec![Shape::Cuboid { half_extents: half }; 2];
        let press = Press::along(fingers, vec![poses]).unwrap();
        let body = SoftBody::new(mesh.clone(), Law::default(), MODULI, &[]).unwrap();
        let model =
            Compliance::free(body, ComplianceOptions { friction: 0.8, corrections: 0 }).unwrap();
        let answer = model.solve_path(&press).pop().unwrap().unwrap();
        let rotated = |field: &[Vector3<f64>]| field.iter().map(|v| turn * v).collect();
        let answer = Deformation {
            displacement: rotated(&answer.displacement),
            contact_force: rotated(&answer.contact_force),
            poses: answer.poses.iter().map(|pose| turn * pose).collect(),
            ..answer
        };
        let turned = |p: &Point3<f64>| turn * p;
        mesh = TetMesh { vertices: mesh.vertices.iter().map(turned).collect(), ..mesh };
        let graph = ObjectGraph::new(&mesh);
        let unit = PadMaterial { moduli: MODULI, friction: 0.8, thickness: graph.length };
        let grip = Grip::of(&half, &answer.poses);
        let input = ObjectInput::new(&graph, &unit, &grip, &answer);
        (mesh, graph, input)
    }

    /// A network whose outputs are not zero.
    pub(in super::super) fn network() -> (Parameters, Soft) {
        let parameters = Parameters::drawn(3);
        let network = Soft::new(&SoftConfig::default(), &parameters.builder()).unwrap();
        for (name, variable) in parameters.all() {
            if name.starts_with("nodes.second") || name.starts_with("stress") {
                variable.set(&variable.randn_like(0.0, 0.1).unwrap()).unwrap();
            }
        }
        (parameters, network)
    }

    pub(in super::super) fn still() -> Vector3<f64> {
        Vector3::repeat(1.0)
    }

    pub(in super::super) fn numbers(tensor: &Tensor) -> Vec<f32> {
        tensor.flatten_all().unwrap().to_vec1().unwrap()
    }

    #[test]
    fn every_parameter_receives_a_gradient() {
        let ((_, graph, input), (parameters, network)) =
            (squeezed(&UnitQuaternion::identity()), network());
        let answer = network.forward(&input, &graph, &Vector3::new(-1.0, 1.0, 1.0)).unwrap();
        let sums = [&answer.displacement, &answer.forces, &answer.stress]
            .map(|field| field.sqr().unwrap().sum_all().unwrap());
        let total = (((&sums[0] + &sums[1]).unwrap()) + &sums[2]).unwrap();
        let gradients = total.backward().unwrap();
        for (name, variable) in parameters.all() {
            let gradient = gradients.get(&variable).unwrap_or_else(|| panic!("none for {name}"));
            let most = gradient.abs().unwrap().max_all().unwrap().to_scalar::<f32>().unwrap();
            assert!(most > 0.0, "zero for {name}");
        }
    }

    #[test]
    fn an_answer_turns_with_object_and_grip() {
        let turn = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.0);
        let (_, network) = network();
        let [(_, graph, here), (_, turned, there)] =
            [UnitQuaternion::identity(), turn].map(|t| squeezed(&t));
        let here = network.forward(&here, &graph, &still()).unwrap();
        let there = network.forward(&there, &turned, &still()).unwrap();
        let rows: Matrix3<f64> = Rotation3::from(turn).into_inner();
        let (a, b) = (numbers(&here.displacement), numbers(&there.displacement));
        let largest = a.iter().fold(0.0_f32, |most, x| most.max(x.abs()));
        for (a, b) in a.as_chunks::<3>().0.iter().zip(b.as_chunks::<3>().0) {
            let expected = rows * Vector3::from(*a).cast::<f64>();
            let error = (expected - Vector3::from(*b).cast::<f64>()).norm();
            // Single precision through ten layers.
            assert!(error < 1e-3 * f64::from(largest), "{b:?}, expected {expected}");
        }
        for (a, b) in numbers(&here.stress).iter().zip(numbers(&there.stress)) {
            assert!((a - b).abs() < 1e-3, "stress {b}, expected {a}");
        }
    }

    #[test]
    fn forces_are_in_balance_and_squeeze_with_what_is_said() {
        let ((_, graph, input), (_, network)) = (squeezed(&UnitQuaternion::identity()), network());
        let answer = network.forward(&input, &graph, &still()).unwrap();
        let forces = numbers(&answer.forces);
        let sum = forces
            .as_chunks::<3>()
            .0
            .iter()
            .fold(Vector3::zeros(), |sum, f| sum + Vector3::from(*f));
        let size: f32 = forces.iter().map(|f| f.abs()).sum();
        assert!(sum.norm() < 1e-5 * size, "{sum} of {size} are left");
        let force = numbers(&answer.force);
        for (force, found) in force.iter().zip(squeezing(&forces, &input.shares)) {
            assert!((force - found).abs() < 1e-5 * size, "{force}, expected {found}");
        }
    }
}
