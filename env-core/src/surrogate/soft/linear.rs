//! The linear answer that the network corrects: on a mesh as fine as that of the reference
//! solutions, carried to the model mesh. What a coarse mesh would miss of the surface, and so of where
//! contact begins, need not be learnt.

use crate::{
    Result,
    compliance::{Compliance, ComplianceOptions, Scratch},
    deformation::{Deformation, Law, Moduli, Press, SoftBody},
    geometry::{TetMesh, Transfer},
};

/// A soft object's linear model.
pub(super) struct SoftBaseline {
    compliance: Compliance,
    transfer: Transfer,
}

impl SoftBaseline {
    /// On the mesh `fine`, answering on `model`.
    pub(super) fn new(
        fine: TetMesh,
        model: &TetMesh,
        moduli: Moduli,
        friction: f64,
    ) -> Result<Self> {
        let transfer = Transfer::new(&fine, model)?;
        let body = SoftBody::new(fine, Law::default(), moduli, &[])?;
        let compliance = Compliance::free(body, ComplianceOptions { friction, sweeps: 0 })?;
        Ok(Self { compliance, transfer })
    }

    /// The answers along `press`, until one fails. Their histories are those of the fine mesh.
    pub(super) fn path(&self, press: &Press) -> Vec<Result<Deformation>> {
        let answers = self.compliance.solve_path(press).into_iter();
        answers.map(|answer| answer.map(|fine| self.carry(fine))).collect()
    }

    /// The answer at the end of `press`; its residual is 0 unless it is wanted.
    pub(super) fn last(
        &self,
        press: &Press,
        with_residual: bool,
        scratch: &mut Scratch,
    ) -> Result<Deformation> {
        let fine = self.compliance.last(press, with_residual, scratch)?;
        Ok(self.carry(fine))
    }

    /// Memory for [`SoftBaseline::last`].
    pub(super) fn scratch(&self) -> Scratch {
        self.compliance.scratch()
    }

    fn carry(&self, fine: Deformation) -> Deformation {
        Deformation {
            displacement: self.transfer.interpolate(&fine.displacement),
            contact_force: self.transfer.spread(&fine.contact_force),
            von_mises: self.transfer.average(&fine.von_mises),
            ..fine
        }
    }
}
