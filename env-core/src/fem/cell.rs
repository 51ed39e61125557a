//! Strain and stiffness of one cell.

use nalgebra::{Matrix3, Vector3};

use super::{
    element::Cell,
    material::{Material, Volumetric},
    tangent::Tangent,
};

/// Deformation gradient F and U at an energy point.
pub(super) type PointState = (Matrix3<f64>, Volumetric);

impl<const M: usize> Cell<M> {
    /// Deformation gradient F = 1 + Σ uₐ ⊗ ∇Nₐ at point `k`.
    pub(super) fn deformation_gradient(
        &self,
        k: usize,
        displacement: &[Vector3<f64>],
    ) -> Matrix3<f64> {
        let point = &self.points[k];
        let mut f = Matrix3::identity();
        for (&local, gradient) in point.local.iter().zip(&point.gradients) {
            let u = displacement[self.nodes[local as usize] as usize];
            f += u * gradient.transpose();
        }
        f
    }

    /// Evaluates U at the cell's points: at each one's own dilatation, or at the mean of all.
    pub(super) fn volumetric(&self, material: &Material, states: &mut [PointState]) {
        if !self.averaged {
            for (f, volumetric) in states {
                *volumetric = material.volumetric(material.dilatation(f));
            }
            return;
        }
        let (mut volume, mut deformed) = (0.0, 0.0);
        for (point, (f, _)) in self.points.iter().zip(states.iter()) {
            volume += point.volume;
            deformed += point.volume * material.dilatation(f);
        }
        let shared = material.volumetric(deformed / volume);
        for (_, volumetric) in states {
            *volumetric = shared;
        }
    }

    /// ∂θ/∂u times volume, summed over `points`, for the cell's nodes, and the volume of the
    /// points.
    fn dilatation_gradient(
        &self,
        material: &Material,
        points: std::ops::Range<usize>,
        states: &[PointState],
    ) -> (Vec<Vector3<f64>>, f64) {
        let (mut gradient, mut volume) = (vec![Vector3::zeros(); self.nodes.len()], 0.0);
        for (point, (f, _)) in self.points[points.clone()].iter().zip(&states[points]) {
            let slope = material.dilatation_gradient(f) * point.volume;
            for (&local, g) in point.local.iter().zip(&point.gradients) {
                gradient[local as usize] += slope * g;
            }
            volume += point.volume;
        }
        (gradient, volume)
    }

    /// Computes the stiffness of the cell into `dense`: blocks of its nodes, lower triangle by
    /// rows.
    pub(super) fn stiffness(
        &self,
        material: &Material,
        states: &[PointState],
        filtered: bool,
        dense: &mut Vec<Matrix3<f64>>,
    ) {
        let count = self.nodes.len();
        dense.clear();
        dense.resize(count * (count + 1) / 2, Matrix3::zeros());
        for (point, (f, volumetric)) in self.points.iter().zip(states) {
            let tangent = material.tangent(f, volumetric.pressure);
            let tangent = if filtered { tangent.filtered() } else { tangent };
            add_tangent(&tangent, &point.local, &point.gradients, point.volume, dense);
        }
        let groups = if self.averaged { 1 } else { self.points.len() };
        let size = self.points.len() / groups;
        for group in 0..groups {
            let points = group * size..(group + 1) * size;
            let stiffness = states[points.start].1.stiffness;
            let stiffness = if filtered { stiffness.abs() } else { stiffness };
            let (gradient, volume) = self.dilatation_gradient(material, points, states);
            for i in 0..count {
                let scaled = gradient[i] * (stiffness / volume);
                for j in 0..=i {
                    dense[i * (i + 1) / 2 + j] += scaled * gradient[j].transpose();
                }
            }
        }
    }
}

fn add_tangent<const M: usize>(
    tangent: &Tangent,
    local: &[u8; M],
    gradients: &[Vector3<f64>; M],
    volume: f64,
    dense: &mut [Matrix3<f64>],
) {
    for a in 0..M {
        for b in 0..M {
            let (i, j) = (local[a] as usize, local[b] as usize);
            if j <= i {
                let block = tangent.block(&gradients[a], &gradients[b]);
                dense[i * (i + 1) / 2 + j] += block * volume;
            }
        }
    }
}
