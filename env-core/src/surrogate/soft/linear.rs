//! The linear solution that the network corrects: on a mesh as fine as that of the reference
//! solutions, carried to the model mesh. The network then need not correct errors of a coarse
//! surface, and so of the onset of contact.

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
    /// Builds the model on the mesh `fine`, with answers on `model`.
    pub(super) fn new(
        fine: TetMesh,
        model: &TetMesh,
        moduli: Moduli,
        friction: f64,
    ) -> Result<Self> {
        let transfer = Transfer::new(&fine, model)?;
        let body = SoftBody::new(fine, Law::default(), moduli, &[])?;
        let compliance = Compliance::free(body, ComplianceOptions { friction, corrections: 0 })?;
        Ok(Self { compliance, transfer })
    }

    /// Solves the frames of `press`, in order; the first that fails is an error and the last. Their
    /// histories are those of the fine mesh.
    pub(super) fn path(&self, press: &Press) -> Vec<Result<Deformation>> {
        let answers = self.compliance.solve_path(press).into_iter();
        answers.map(|answer| answer.map(|fine| self.carry(fine))).collect()
    }

    /// Solves the last frame of `press`; its residual is 0 unless `with_residual`.
    pub(super) fn last(
        &self,
        press: &Press,
        with_residual: bool,
        scratch: &mut Scratch,
    ) -> Result<Deformation> {
        let fine = self.compliance.last(press, with_residual, scratch)?;
        Ok(self.carry(fine))
    }

    /// Working memory for [`SoftBaseline::last`].
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
