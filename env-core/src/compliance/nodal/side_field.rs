//! Influence of the sides of a pad on the displacement of the mesh on which fields are output.
//!
//! It is that of finite elements ([`Sides`]) under forces on the nodes of their face; a force
//! elsewhere is shared among the four nodes around it.
//!
//! Shapes: F nodes of the elements' face, N free nodes of the output mesh.

use nalgebra::{Matrix3, Point3, Vector3};

use super::{plan_columns::PlanColumns, sides::Sides};
use crate::{
    Result,
    geometry::{PadMesh, Transfer},
};

/// Displacement of the output mesh's free nodes under unit forces on the face, by the sides.
pub(super) struct SideField {
    /// Columns of the elements' face.
    columns: PlanColumns,
    /// By loaded node (F, N), in m/N.
    rows: Vec<Matrix3<f32>>,
    free: usize,
}

impl SideField {
    /// Transfers the influence of the `sides` to the free nodes of a `model` mesh, its first.
    /// Returns an error if that is not a mesh of the same pad.
    pub(super) fn new(sides: &Sides, model: &PadMesh) -> Result<Self> {
        let (fine, free) = (&sides.mesh, model.face.len() * model.cells[2] as usize);
        let transfer = Transfer::new(&fine.mesh, &model.mesh)?;
        let row = |&node: &u32| {
            let under = |axis| {
                let moved = sides.displacement(&[(node, Vector3::ith(axis, 1.0))]);
                transfer.interpolate(&moved)
            };
            let [x, y, z] = [0, 1, 2].map(under);
            let block = move |i: usize| Matrix3::from_columns(&[x[i], y[i], z[i]]).cast::<f32>();
            (0..free).map(block)
        };
        let columns = PlanColumns::of(fine);
        Ok(Self { columns, rows: fine.face.iter().flat_map(row).collect(), free })
    }

    /// Displacement of the free nodes (N) under unit forces on a node of the elements' face (m/N).
    pub(super) fn row(&self, node: usize) -> &[Matrix3<f32>] {
        &self.rows[node * self.free..][..self.free]
    }

    /// Nodes of the elements' face around a point of the plan, with weights that sum to 1.
    pub(super) fn around(&self, point: &Point3<f64>) -> [(usize, f64); 4] {
        let [across, _] = self.columns.count();
        self.columns.around([point.x, point.y]).map(|([i, j], share)| (j * across + i, share))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{deformation::Moduli, sensor::Sensor};

    #[test]
    fn rows_are_what_the_elements_say_of_a_force_on_a_node() {
        let sensor = Sensor::named("gelsight-mini").unwrap();
        let model = sensor.pad(500).unwrap();
        let moduli = Moduli { young: 3e5, poisson: 0.47 };
        let sides = Sides::new(&sensor.outline, moduli, 150).unwrap();
        let (fine, field) = (&sides.mesh, SideField::new(&sides, &model).unwrap());
        let transfer = Transfer::new(&fine.mesh, &model.mesh).unwrap();
        let free = model.face.len() * model.cells[2] as usize;
        let force = Vector3::new(0.3, -0.2, -1.0);
        for &node in fine.face.iter().step_by(7) {
            let right = transfer.interpolate(&sides.displacement(&[(node, force)]));
            let most = right.iter().map(Vector3::norm).fold(0.0, f64::max);
            let around = field.around(&fine.mesh.vertices[node as usize]);
            let sum: f64 = around.iter().map(|(_, share)| share).sum();
            assert!((sum - 1.0).abs() < 1e-12, "shares of node {node} sum to {sum}");
            for (i, right) in right.iter().take(free).enumerate() {
                let part = |(from, share): &(usize, f64)| {
                    field.row(*from)[i].cast::<f64>() * (force * *share)
                };
                let found: Vector3<f64> = around.iter().map(part).sum();
                // Single precision.
                assert!((found - right).norm() < 1e-6 * most, "{found} m instead of {right} m");
            }
        }
    }
}
