//! Quasi-static finite elements: equilibrium of a soft body with the rigid shapes pressed into it.
//!
//! Large strains, several material laws ([`Law`](crate::deformation::Law)) and elements
//! ([`Element`]), frictional contact on the faces of the surface ([`crate::contact`]), Newton's
//! method with a sparse Cholesky factorisation. Contact is the most nonlinear part and involves few
//! nodes: the body's stiffness is condensed to them, contact is solved on that small system, and
//! one factorisation serves for about a frame. Where contact involves many nodes, a factor is
//! likewise reused while contact changes.
//!
//! Precision. A frame is returned when the norm of the residual force is at most
//! [`FemOptions::tolerance`]; for bodies stiffer than 1 MPa the tolerance grows in proportion.
//! Shapes penetrate by [`FemOptions::softness`] × pressure / Young's modulus, and a sticking point
//! creeps by four times that × friction. At the default softness this costs 0.3 % of the force at a
//! depth of 0.5 mm, 0.1 % at 1 mm. A solution in which a point is deeper than 250 softnesses, or
//! than half of the body's smallest extent, is an error; so is one with a shape wholly inside the
//! body, or more than ten softnesses inside the held faces, which are rigid and carry no contact
//! force here. Contact points lie 0.4 mm apart, closer for a shape thinner than 0.6 mm
//! ([`Shape::thickness`]), but not closer than 1/128 of a face's width, and at most a million in
//! all: a shape that would need more along its path is refused.

mod attempt;
mod carry;
mod cell;
mod condensed;
mod dense;
mod direct;
mod drive;
mod element;
#[cfg(test)]
mod examples;
mod follower;
mod gmres;
mod grasp;
mod loads;
mod linearised;
mod material;
mod newton;
#[cfg(test)]
mod oracle;
mod ordering;
mod patches;
mod pattern;
mod push;
mod region;
mod solid;
mod spacing;
mod sparse;
mod springs;
mod surface;
mod system;
mod tangent;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use nalgebra::{Matrix3, Point3, Vector3};

#[cfg(doc)]
use crate::geometry::Shape;
use crate::{
    Error, Result,
    contact::{Backing, ContactLaw, check_first, holds, is_engulfed},
    deformation::{
        Deformation, DeformationModel, Drive, History, Press, SoftBody, solve_in_parallel,
    },
    geometry::TetMesh,
};

use drive::PressSolver;
use system::System;

pub use carry::{Carried, Carrier};
pub use element::Element;
pub(crate) use gmres::{GmresSolution, gmres};
pub use grasp::{Grasp, Grasped, Hold};
pub(crate) use linearised::{Linearised, SolverWorkspace};

/// Settings of a [`Fem`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FemOptions {
    /// Kind of element.
    pub element: Element,
    /// Coefficient of Coulomb friction between body and shapes.
    pub friction: f64,
    /// Norm of the residual force at which a frame has converged, for a body of 1 `MPa` or softer
    /// (N).
    pub tolerance: f64,
    /// Depth by which a shape penetrates where the pressure equals Young's modulus (m).
    pub softness: f64,
    /// Most Newton steps in one load step. A body that buckles takes many.
    pub iterations: usize,
    /// Newton steps in all load steps of a frame after which no load step that fails is subdivided.
    pub patience: usize,
}

impl Default for FemOptions {
    fn default() -> Self {
        Self {
            element: Element::default(),
            friction: 0.0,
            tolerance: 1e-7,
            softness: 2e-6,
            iterations: 60,
            patience: usize::MAX,
        }
    }
}

impl FemOptions {
    /// Norm of the residual force at which a frame of `body` has converged (N).
    pub(crate) fn tolerance_for(&self, body: &SoftBody) -> f64 {
        self.tolerance * (body.stiffest() / 1e6).max(1.0)
    }
}

/// The finite-element model of one soft body.
#[derive(Clone)]
pub struct Fem {
    body: SoftBody,
    system: Arc<System>,
    limits: newton::StoppingCriteria,
}

impl Fem {
    /// Discretises `body` and analyses its stiffness matrix; returns an error if no face of it can
    /// move.
    pub fn new(body: SoftBody, options: FemOptions) -> Result<Self> {
        if !(options.tolerance.is_finite() && options.tolerance > 0.0) {
            let expected = "a finite force above 0 N";
            return Err(Error::invalid("tolerance", options.tolerance, expected));
        }
        let law = ContactLaw::new(options.softness, options.friction)?;
        let system = Arc::new(System::new(&body, options.element, law));
        if system.surface.is_empty() {
            return Err(held_all_round(&body));
        }
        let tolerance = options.tolerance_for(&body);
        let FemOptions { iterations, patience, .. } = options;
        let limits = newton::StoppingCriteria { tolerance, iterations, patience, plain: false };
        Ok(Self { body, system, limits })
    }

    /// Positions at rest of the contact points (m), numbered as in a history's anchors. A press of
    /// a shape thinner than 0.6 mm has more of them.
    pub fn contact_points(&self) -> Vec<Point3<f64>> {
        let still = vec![Vector3::zeros(); self.system.nodes.places.len()];
        self.system.surface_places(&still)
    }

    /// The body.
    pub fn body(&self) -> &SoftBody {
        &self.body
    }

    /// Held faces of the body.
    pub(crate) fn backing(&self) -> &Backing {
        &self.system.backing
    }

    /// Number of unknowns, and of entries in the factor of the stiffness matrix.
    pub fn size(&self) -> (usize, usize) {
        let (pattern, _) = self.system.whole_pattern();
        (pattern.size(), pattern.fill())
    }

    /// Returns the fields of a solution with this `history` on another mesh of the body, or an
    /// error if the history is of another model or the mesh of another body.
    pub fn carry(&self, history: &History, to: &TetMesh) -> Result<Carried> {
        self.check_history(history)?;
        Ok(Carrier::new(self, to)?.fields(&history.displacement))
    }

    /// Returns the Cauchy stress of a solution with this `history`, volume average over each
    /// tetrahedron (T) in Pa, or an error if the history is of another model.
    pub fn stress(&self, history: &History) -> Result<Vec<Matrix3<f64>>> {
        self.check_history(history)?;
        Ok(self.system.solid.cauchy(&history.displacement))
    }

    /// Solves every frame of `press`, in order; the first that fails is an error and the last.
    pub fn solve_path(&self, press: &Press) -> Vec<Result<Deformation>> {
        let system = self.system.suited(&self.body, press);
        let checked = |system| self.check_start(&system, press).map(|()| system);
        match self.check_force(press).and(system).and_then(checked) {
            Ok(system) => PressSolver::new(&system, self.body.mesh(), self.limits).frames(press),
            Err(error) => vec![Err(error)],
        }
    }

    /// Refuses a history of another model.
    fn check_history(&self, history: &History) -> Result<()> {
        // A press of a thin shape has its own contact points, so their number is not limited here.
        history.check(&self.system.identity, self.system.nodes.places.len(), usize::MAX)
    }

    /// Refuses a push whose force is not above the tolerance of the residual force.
    fn check_force(&self, press: &Press) -> Result<()> {
        let tolerance = self.limits.tolerance;
        match press.drive() {
            Drive::Force { force, .. } if *force <= tolerance => {
                let expected = format!("more than the tolerance of {tolerance:.2e} N");
                Err(Error::invalid("force", format!("{force:.2e} N"), expected))
            }
            _ => Ok(()),
        }
    }

    /// Refuses a press from rest with a shape wholly inside the body.
    fn check_start(&self, system: &System, press: &Press) -> Result<()> {
        if press.history().is_some() {
            return Ok(());
        }
        let rest = vec![Vector3::zeros(); system.nodes.places.len()];
        let places = system.surface_places(&rest);
        let (shapes, first) = (press.shapes(), press.drive().first());
        check_first(shapes.len(), |i| {
            let (shape, pose) = (&shapes[i], &first[i]);
            !holds(shape, pose, &places) && is_engulfed(shape, pose, self.body.mesh(), &rest)
        })
    }
}

/// Returns the error for a `body` whose faces are all held.
pub(crate) fn held_all_round(body: &SoftBody) -> Error {
    let found = format!("{} of {} nodes", body.fixed().len(), body.mesh().vertices.len());
    Error::invalid("fixed", found, "a face of the surface that is not held all round")
}

impl DeformationModel for Fem {
    /// Solves presses in parallel, each on one thread.
    fn solve(&self, presses: &[Press]) -> Vec<Result<Deformation>> {
        let last =
            |press: &Press| self.solve_path(press).pop().expect("a press has a frame or an error");
        solve_in_parallel(presses, last)
    }

    fn solve_path(&self, press: &Press) -> Vec<Result<Deformation>> {
        self.solve_path(press)
    }
}
