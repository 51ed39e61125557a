//! Finite elements of an elastic layer without sides, on the nodes of a pad.

use nalgebra::Vector3;

use crate::{
    Result,
    deformation::{Law, Moduli, SoftBody},
    fem::{Linearised, SolverWorkspace},
    geometry::PadMesh,
};

/// Distance in thicknesses as far as the layer goes on beyond the sides of the pad.
const BEYOND: f64 = 2.5;

/// Elements of a flat layer that have the nodes of a pad in plan and depth. What they and those of the
/// pad give differs by the influence of the sides and of the curved face, and not by the error of the
/// mesh, which is the same. V nodes of the pad.
pub struct LayerElements {
    elements: Linearised,
    /// Nodes in the places of the pad's (V).
    nodes: Vec<u32>,
}

impl LayerElements {
    /// Builds the layer of a `pad`; fails if it cannot be meshed.
    pub fn new(pad: &PadMesh, moduli: Moduli) -> Result<Self> {
        let (layer, nodes) = pad.as_layer(BEYOND * pad.thickness())?;
        let body = SoftBody::new(layer.mesh, Law::Linear, moduli, &layer.base)?;
        Ok(Self { elements: Linearised::new(&body)?, nodes })
    }

    /// Working memory of one thread.
    pub(super) fn workspace(&self) -> SolverWorkspace {
        self.elements.workspace()
    }

    /// Displacement in the places of the pad's nodes (V) in m under `forces` there (V) in N.
    pub(super) fn displacement(
        &self,
        forces: &[Vector3<f64>],
        workspace: &mut SolverWorkspace,
    ) -> Vec<Vector3<f64>> {
        let mut all = vec![Vector3::zeros(); self.elements.places().len()];
        for (node, force) in self.nodes.iter().zip(forces) {
            all[*node as usize] = *force;
        }
        let moved = self.elements.displacement(&all, workspace);
        self.nodes.iter().map(|node| moved[*node as usize]).collect()
    }
}
