//! Input of the network for a squeeze, as dimensionless numbers.
//!
//! Lengths are in units of the object's size L, stresses of the shear modulus μ, forces of E L².
//! The network's outputs are multiplied by the squeeze's own amplitude, so without contact they are
//! zero.
//!
//! Shapes: V nodes, T tetrahedra.

use nalgebra::{Matrix3, Vector3};

use super::{graph::ObjectGraph, grip::Grip};
use crate::{
    deformation::Deformation,
    surrogate::{features::flat, material::PadMaterial},
};

/// Number of features of a node: displacement, contact force, place and normal, 1 on the surface,
/// distances from both fingers before and after, places on their faces, and features of the
/// squeeze.
pub(super) const FEATURES: usize = VECTORS + 1 + 2 * 5 + GLOBALS;
/// Number of features, the first ones, that are components of vectors.
const VECTORS: usize = 4 * 3;
/// Number of features of the squeeze as a whole: amplitude, compressibility, friction, force over
/// amplitude.
const GLOBALS: usize = 4;
/// Distance from a finger's face, in units of L, at which contact is no longer corrected.
const REACH: f64 = 0.12;

/// A squeeze with its linear solution.
pub(super) struct ObjectInput {
    /// Rotation from the object's frame to the grip's.
    pub(super) turn: Matrix3<f64>,
    /// Features of the nodes, vectors in the grip's frame (V, [`FEATURES`]).
    pub(super) features: Vec<f32>,
    /// Displacement of the linear solution (V, 3), in the object's frame like all fields below.
    pub(super) displacement: Vec<f32>,
    /// Its von Mises stress (T).
    pub(super) stress: Vec<f32>,
    /// Its contact forces (V, 3).
    pub(super) forces: Vec<f32>,
    /// Factor of each node's force in the force of the squeeze: 1/2 with the sign of its finger
    /// (V).
    pub(super) shares: Vec<f32>,
    /// Share of each node in the contact force, by which the unbalanced force is distributed (V).
    pub(super) bearing: Vec<f32>,
    /// Factor on the correction of contact: 1 at a face, 0 far from both and inside (V).
    pub(super) gates: Vec<f32>,
    /// Largest displacement of a node.
    pub(super) amplitude: f32,
    /// Largest contact force on a node.
    pub(super) strongest: f32,
}

impl ObjectInput {
    /// Returns the network's input for the `linear` answer to a squeeze by `grip`. `unit.thickness`
    /// is L.
    pub(super) fn new(
        graph: &ObjectGraph,
        unit: &PadMaterial,
        grip: &Grip,
        linear: &Deformation,
    ) -> Self {
        let length = graph.length;
        let largest = |field: &[Vector3<f64>]| field.iter().map(Vector3::norm).fold(0.0, f64::max);
        let (amplitude, strongest) =
            (largest(&linear.displacement), largest(&linear.contact_force));
        let (turn, middle) = (grip.turn(), grip.middle());
        let over = |x: f64, unit: f64| x / unit.max(f64::MIN_POSITIVE);
        let all: f64 = linear.contact_force.iter().map(Vector3::norm).sum();
        let globals = [
            5.0 * amplitude / length,
            10.0 * (0.5 - unit.moduli.poisson),
            unit.friction,
            over(all * length, unit.force() * amplitude).ln_1p(),
        ];
        let mut features = Vec::with_capacity(graph.places.len() * FEATURES);
        let (mut gates, mut shares) = (Vec::new(), Vec::new());
        for (i, rest) in graph.places.iter().enumerate() {
            let (u, normal) = (linear.displacement[i], graph.normals[i]);
            let moved = rest + u;
            let vectors = [
                turn * u / amplitude.max(f64::MIN_POSITIVE),
                turn * linear.contact_force[i] / strongest.max(f64::MIN_POSITIVE),
                turn * (moved - middle) / length,
                turn * normal,
            ];
            let outside = if normal == Vector3::zeros() { 0.0 } else { 1.0 };
            let mut nearest = f64::INFINITY;
            let fingers = grip.faces.map(|face| {
                let [before, after] = [rest, &moved].map(|p| face.inverse_transform_point(p));
                nearest = nearest.min(after.z.abs());
                [
                    (2.0 * before.z / length).clamp(-1.0, 1.0),
                    over(after.z, amplitude).clamp(-1.0, 1.0),
                    (8.0 * after.z / length).clamp(-1.0, 1.0),
                    (after.x.abs() / grip.half[0]).min(2.0) - 1.0,
                    (after.y.abs() / grip.half[1]).min(2.0) - 1.0,
                ]
            });
            let vectors = vectors.iter().flat_map(|v| [v.x, v.y, v.z]);
            let numbers = vectors.chain([outside]).chain(fingers.into_iter().flatten());
            features.extend(numbers.chain(globals).map(|x| x as f32));
            gates.push((outside * (1.0 - nearest / (REACH * length)).clamp(0.0, 1.0)) as f32);
            shares.push(if grip.nearer(&moved) == 0 { 0.5 } else { -0.5 });
        }
        Self {
            turn,
            features,
            displacement: flat(&linear.displacement, length),
            stress: linear.von_mises.iter().map(|s| (s / unit.moduli.shear()) as f32).collect(),
            forces: flat(&linear.contact_force, unit.force()),
            shares,
            bearing: linear.contact_force.iter().map(|f| over(f.norm(), all) as f32).collect(),
            gates,
            amplitude: (amplitude / length) as f32,
            strongest: (strongest / unit.force()) as f32,
        }
    }

    /// Features mirrored by the `signs` of the axes.
    pub(super) fn mirrored(&self, signs: &Vector3<f64>) -> Vec<f32> {
        let sign = |i: usize| if i < VECTORS { signs[i % 3] as f32 } else { 1.0 };
        self.features.iter().enumerate().map(|(i, x)| x * sign(i % FEATURES)).collect()
    }
}
