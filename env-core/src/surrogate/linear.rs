//! The linear answer that the network corrects: `compliance` on a mesh as fine as the truth's, carried
//! to the model mesh.
//!
//! Linear elasticity can be condensed in advance on any mesh, so what a coarse mesh would miss need not
//! be learnt: displacement is interpolated at the model mesh's nodes, contact forces are spread on
//! them, stress is averaged over its tetrahedra.

use nalgebra::{Isometry3, Vector3};

use super::features::Gel;
use crate::{
    Result,
    compliance::{Compliance, Options},
    deformation::{Deformation, Law, Moduli, Press, SoftBody},
    geometry::{PadMesh, Transfer},
    sensor::Sensor,
};

/// A gel's linear model.
pub(super) struct Linear {
    compliance: Compliance,
    transfer: Transfer,
}

/// A linear answer on the model mesh. V nodes, T tetrahedra, S shapes.
#[derive(Clone, Debug)]
pub(super) struct Carried {
    /// (V) in m.
    pub(super) displacement: Vec<Vector3<f64>>,
    /// (V) in N.
    pub(super) contact_force: Vec<Vector3<f64>>,
    /// (T) in Pa.
    pub(super) von_mises: Vec<f64>,
    /// (S).
    pub(super) poses: Vec<Isometry3<f64>>,
}

impl Linear {
    /// That of a gel on a mesh of `nodes` nodes, answering on `model`.
    pub(super) fn new(sensor: &Sensor, gel: &Gel, nodes: usize, model: &PadMesh) -> Result<Self> {
        let fine = sensor.pad(nodes)?;
        let transfer = Transfer::new(&fine.mesh, &model.mesh)?;
        let options = Options { friction: gel.friction, sweeps: 0 };
        Ok(Self { compliance: Compliance::new(body(&fine, gel.moduli)?, options)?, transfer })
    }

    /// The answers along `press`, until one fails.
    pub(super) fn path(&self, press: &Press) -> Vec<Result<Deformation>> {
        self.compliance.solve_path(press)
    }

    /// An answer on the model mesh.
    pub(super) fn carry(&self, fine: &Deformation) -> Carried {
        Carried {
            displacement: self.transfer.interpolate(&fine.displacement),
            contact_force: self.transfer.spread(&fine.contact_force),
            von_mises: self.transfer.average(&fine.von_mises),
            poses: fine.poses.clone(),
        }
    }
}

/// A pad mesh of a gel.
pub(super) fn body(pad: &PadMesh, moduli: Moduli) -> Result<SoftBody> {
    SoftBody::new(pad.mesh.clone(), Law::default(), moduli, &pad.base)
}
