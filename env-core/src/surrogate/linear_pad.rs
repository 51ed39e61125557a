//! Linear elasticity of a pad, with contact resolved as finely as it needs, as a model of presses.

use std::{sync::Arc, time::Instant};

use super::{
    linear::{LinearBaseline, LinearStress, PadFields, body},
    material::PadMaterial,
};
use crate::{
    Error, Result,
    compliance::nodal::{ContactResolution, ContactSolution},
    contact::Backing,
    deformation::{
        Deformation, DeformationModel, Moduli, Press, SoftBody, Wanted, solve_frames,
        solve_in_parallel,
    },
    fem::Linearised,
    sensor::Sensor,
};

/// Linear elastic model of a sensor's pad. Copies share the precomputed data.
#[derive(Clone)]
pub struct LinearPad {
    linear: Arc<LinearBaseline>,
    body: Arc<SoftBody>,
    /// Elements of the mesh of `body`, for the residual force of an answer.
    elements: Arc<Linearised>,
    stress: LinearStress,
}

/// Parts of a full answer.
const STRESSED: Wanted = Wanted { stress: true, residual: false };
/// Nodes of the mesh whose stress is that away from contact.
const NODES: usize = 2000;

impl LinearPad {
    /// Builds the model of the gel of `sensor`, with answers on a mesh of at most `nodes` nodes
    /// and contact at the `resolution`.
    pub fn new(
        sensor: &Sensor,
        moduli: Moduli,
        friction: f64,
        nodes: usize,
        resolution: ContactResolution,
    ) -> Result<Self> {
        let pad = sensor.pad(nodes)?;
        let gel = PadMaterial { moduli, friction, thickness: sensor.outline.thickness };
        let linear = LinearBaseline::new(sensor, &gel, NODES, &pad, resolution)?;
        let body = body(&pad, moduli)?;
        let elements = Arc::new(Linearised::new(&body)?);
        let (linear, body, stress) = (Arc::new(linear), Arc::new(body), LinearStress::Resolved);
        Ok(Self { linear, body, elements, stress })
    }

    /// Returns this model with the stress under forces spread over the nodes: too low under small
    /// contact, but steady while contact moves over the mesh, as limits of stress need it.
    #[must_use]
    pub fn with_spread_stress(self) -> Self {
        Self { stress: LinearStress::Spread, ..self }
    }

    /// Body whose nodes and tetrahedra the answers refer to.
    pub fn body(&self) -> &SoftBody {
        &self.body
    }

    /// Held faces of the pad.
    pub(crate) fn backing(&self) -> &Backing {
        self.linear.backing()
    }

    fn last(&self, press: &Press, wanted: Wanted) -> Result<Deformation> {
        self.fields(self.linear.path(press).pop().expect("a press has a frame")?, wanted)
    }

    fn fields(&self, settled: ContactSolution, wanted: Wanted) -> Result<Deformation> {
        let start = Instant::now();
        let stress = if wanted.stress { self.stress } else { LinearStress::Omitted };
        let PadFields { displacement, contact_force, von_mises, poses } =
            self.linear.carry(&settled, stress)?.fields;
        let residual = if wanted.residual {
            let residual = self.elements.residual(&displacement, &contact_force);
            residual.ok_or(Error::Inverted)?
        } else {
            0.0
        };
        let ContactSolution { wrench, sliding, history, iterations, seconds, .. } = settled;
        Ok(Deformation {
            displacement,
            von_mises,
            contact_force,
            wrench,
            sliding,
            poses,
            history,
            iterations,
            residual,
            seconds: seconds + start.elapsed().as_secs_f64(),
            predicted_error: None,
        })
    }
}

impl DeformationModel for LinearPad {
    /// Solves the presses in parallel, each on one thread. Residual forces, which are those of
    /// hyperelastic elements on the mesh of the body, are left 0 unless they are asked for: where a
    /// linear solution turns tetrahedra inside out, there are none.
    fn solve(&self, presses: &[Press]) -> Vec<Result<Deformation>> {
        solve_in_parallel(presses, |press| {
            self.linear.on_face(press.shapes(), self.last(press, STRESSED)?)
        })
    }

    fn solve_partially(&self, presses: &[Press], wanted: Wanted) -> Vec<Result<Deformation>> {
        solve_in_parallel(presses, |press| self.last(press, wanted))
    }

    fn solve_path(&self, press: &Press) -> Vec<Result<Deformation>> {
        solve_frames(self.linear.path(press), |answer| {
            self.linear.on_face(press.shapes(), self.fields(answer?, STRESSED)?)
        })
    }
}
