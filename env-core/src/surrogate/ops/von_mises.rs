//! Von Mises stress of a neo-Hookean solid from its displacement.
//!
//! With F = 1 + Σ uₐ ⊗ ∇Nₐ in a linear tetrahedron, J = det F and b = F Fᵀ, the deviator of the
//! Cauchy stress is μ/J dev b (Bonet and Wood 2008, eq. 6.29), so σ/μ = √(3/2 dev b : dev b) / J.
//! The volumetric part of the law does not enter, and neither does Poisson's ratio.

use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp1, Layout, Result, Shape, Tensor};
use nalgebra::{Matrix3, Vector3};

use super::{numbers, with_numbers};
use crate::geometry::TetMesh;

/// Least J in the denominator of the stress; smaller values are replaced by it. Gels are not
/// pressed to half of their volume: a smaller J is that of a tetrahedron which coarse or linear
/// displacements have folded.
pub(super) const FLATTEST: f32 = 0.5;
/// Added to the squared stress, so that its root is differentiable everywhere.
pub(super) const EPSILON: f32 = 1e-10;

/// Tetrahedra and the gradients of their shape functions.
#[derive(Clone, Debug, PartialEq)]
pub(in super::super) struct ShapeGradients {
    nodes: usize,
    tets: Vec<[u32; 4]>,
    /// ∇N of the last three corners; that of the first is minus their sum.
    pub(super) slopes: Vec<Matrix3<f32>>,
}

impl ShapeGradients {
    /// Computes the gradients of `mesh`, with lengths in units of `length` (m).
    pub(in super::super) fn new(mesh: &TetMesh, length: f64) -> Self {
        let slopes = (0..mesh.tets.len()).map(|t| {
            let [a, b, c, d] = mesh.corners(t);
            let edges = Matrix3::from_columns(&[b - a, c - a, d - a]) / length;
            edges.try_inverse().expect("soft bodies have no flat tetrahedra").cast::<f32>()
        });
        Self { nodes: mesh.vertices.len(), tets: mesh.tets.clone(), slopes: slopes.collect() }
    }

    /// Deformation gradient F of tetrahedron `t` for the displacement `u` (V, 3).
    fn strain(&self, t: usize, u: &[f32]) -> Matrix3<f32> {
        let [a, b, c, d] =
            self.tets[t].map(|node| Vector3::from_column_slice(&u[3 * node as usize..][..3]));
        Matrix3::identity() + Matrix3::from_columns(&[b - a, c - a, d - a]) * self.slopes[t]
    }

    /// Writes the stress over μ (T) for the displacement `u` (V, 3) in units of the length.
    pub(in super::super) fn stress(&self, u: &[f32], stress: &mut [f32]) {
        for (t, stress) in stress.iter_mut().enumerate() {
            *stress = value(&self.strain(t, u));
        }
    }

    /// Adds to `du` (V, 3) the derivative by displacement, given the `gradient` (T) by stress.
    fn back(&self, u: &[f32], gradient: &[f32], du: &mut [f32]) {
        for (t, gradient) in gradient.iter().enumerate() {
            let by_edges = slope(&self.strain(t, u)) * self.slopes[t].transpose() * *gradient;
            let [first, others @ ..] = self.tets[t].map(|node| 3 * node as usize);
            for (node, edge) in others.iter().zip(by_edges.column_iter()) {
                for i in 0..3 {
                    du[node + i] += edge[i];
                    du[first + i] -= edge[i];
                }
            }
        }
    }
}

fn deviator(f: &Matrix3<f32>) -> Matrix3<f32> {
    let b = f * f.transpose();
    b - Matrix3::from_diagonal_element(b.trace() / 3.0)
}

/// Von Mises stress over μ for the deformation gradient `f`.
fn value(f: &Matrix3<f32>) -> f32 {
    (1.5 * deviator(f).norm_squared() + EPSILON).sqrt() / f.determinant().max(FLATTEST)
}

/// Derivative of [`value`] by F: 3 dev(b) F / (J² σ) − σ F⁻ᵀ; the second term is zero where J is
/// below [`FLATTEST`].
fn slope(f: &Matrix3<f32>) -> Matrix3<f32> {
    let (j, stress) = (f.determinant(), value(f));
    let shape = deviator(f) * f * (3.0 / (j.max(FLATTEST).powi(2) * stress));
    match f.try_inverse() {
        Some(inverse) if j > FLATTEST => shape - inverse.transpose() * stress,
        _ => shape,
    }
}

struct VonMises(Arc<ShapeGradients>);

/// Von Mises stress over μ (B, T) for the displacement `u` (B V, 3) in units of the length.
pub(in super::super) fn von_mises(u: &Tensor, mesh: &Arc<ShapeGradients>) -> Result<Tensor> {
    u.contiguous()?.apply_op1(VonMises(Arc::clone(mesh)))
}

impl CustomOp1 for VonMises {
    fn name(&self) -> &'static str {
        "von-mises"
    }

    fn cpu_fwd(&self, u: &CpuStorage, layout: &Layout) -> Result<(CpuStorage, Shape)> {
        let (u, tets) = (numbers(u, layout)?, self.0.tets.len());
        let presses = u.chunks_exact(3 * self.0.nodes);
        let mut stress = vec![0.0; presses.len() * tets];
        let shape = (presses.len(), tets).into();
        for (u, stress) in presses.zip(stress.chunks_exact_mut(tets)) {
            self.0.stress(u, stress);
        }
        Ok((CpuStorage::F32(stress), shape))
    }

    fn bwd(&self, u: &Tensor, _stress: &Tensor, gradient: &Tensor) -> Result<Option<Tensor>> {
        let mut du = vec![0.0; u.elem_count()];
        with_numbers([u, gradient], |[u, gradient]| {
            let size = 3 * self.0.nodes;
            let presses = u.chunks_exact(size).zip(gradient.chunks_exact(self.0.tets.len()));
            for ((u, gradient), du) in presses.zip(du.chunks_exact_mut(size)) {
                self.0.back(u, gradient, du);
            }
            Ok(())
        })?;
        Tensor::from_vec(du, u.shape(), u.device()).map(Some)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::{super::tests::*, *};

    fn mesh() -> TetMesh {
        let places = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.1, 0.0, 1.0]];
        let mut vertices = places.map(Point3::from).to_vec();
        vertices.push(Point3::new(1.0, 1.0, 1.0));
        TetMesh { vertices, tets: vec![[0, 1, 2, 3], [1, 2, 3, 4]] }
    }

    #[test]
    fn simple_shear_has_its_closed_form() {
        // F = 1 + γ e_x ⊗ e_y: b − 1 = γ (xy + yx) + γ² xx, so σ/μ = √(3 γ² + γ⁴).
        let (mesh, shear) = (mesh(), 0.3);
        let u: Vec<f32> =
            mesh.vertices.iter().flat_map(|p| [shear * p.y as f32, 0.0, 0.0]).collect();
        let mut stress = [0.0; 2];
        ShapeGradients::new(&mesh, 1.0).stress(&u, &mut stress);
        let exact = (3.0 * shear.powi(2) + shear.powi(4)).sqrt();
        assert!(stress.iter().all(|s| (s / exact - 1.0).abs() < 1e-5), "{stress:?} for {exact}");
    }

    #[test]
    fn its_derivative_is_that_of_finite_differences() {
        let gradients = Arc::new(ShapeGradients::new(&mesh(), 1.0));
        let u = random(&[10, 3], 5);
        let small = u.affine(0.2, 0.0).unwrap();
        u.set(&small).unwrap();
        check_derivatives(std::slice::from_ref(&u), || von_mises(&u, &gradients));
    }
}
