//! Compliance model with contact at the nodes: the same linear elasticity in a fraction of the
//! time.
//!
//! [`Compliance`] evaluates contact at many points of every face and solves for the forces by
//! Newton's method. Here every contact node represents the area around it and touches the nearest
//! shape. The forces are found by projected Gauss–Seidel sweeps (Jourdan, Alart and Jean 1998), the
//! three components of one node at a time, with Coulomb's cone. Nothing is factorised, so no
//! factorisation fails where a contact is large, and a press that continues from earlier forces
//! takes few sweeps. Contact is not evaluated between the nodes: on cells of side h, a ball of
//! radius R is detected up to h²/4R late, 0.08 mm for 4 mm on cells of 1.15 mm. For shapes thinner
//! than the cells, the depth between nodes is limited: to an eighth of the thickness where the
//! shape touches no node, else to a quarter. A larger depth is an error.
//!
//! Shapes: M contact nodes, V nodes, S rigid shapes.

mod between;
mod contact_nodes;
mod face_responses;
mod grid;
mod half_space;
mod kernel;
mod layered;
mod load_stepping;
mod model_face;
mod near_field;
mod patch;
mod plan_columns;
mod resolution;
mod settle;
mod side_compliance;
mod side_field;
mod sides;
mod spots;
mod state;
mod wall_contact;

use std::sync::Arc;

use nalgebra::Vector3;

use super::Compliance;
use crate::{
    Error, Result,
    contact::{self, ContactLaw},
    deformation::{Deformation, DeformationModel, Press, SoftBody, solve_in_parallel},
    geometry::PadMesh,
};

use contact_nodes::ContactNodes;
pub use face_responses::FaceResponses;
pub use layered::{LayeredPad, NodeContact};
use load_stepping::NodalLoadStepping;
use patch::NodalScratch;
pub use resolution::ContactResolution;
pub use sides::Sides;
pub use state::ContactSolution;

/// Largest coefficient of friction of contact at nodes.
///
/// Under a shape that is inclined against the surface, a force along the shape moves a node towards
/// or away from it. If friction is so large that the node is moved away faster than its normal force
/// presses it, the contact of that node alone has no solution or several, and sweeps may end in any.
/// On a half-space, the compliance of a point along the surface is r = (1 − ν/2)/(1 − ν) times that
/// along its normal (Johnson 1985, eqs. 3.18 and 3.75): 1.5 at most. At the worst inclination, which
/// has the cosine √(r/(1 + r)), friction may then be 2√r/(r − 1), 4.9.
pub const MOST_FRICTION: f64 = 4.0;

/// Returns an error unless `friction` is a coefficient of friction that contact at nodes can have.
pub(crate) fn check_friction(friction: f64) -> Result<()> {
    let checked = contact::check_friction(friction, MOST_FRICTION);
    checked.map_err(|error| error.hinting("finite elements take more"))
}

/// Compliance model of one soft body with contact at its nodes. Copies share the precomputed data.
#[derive(Clone)]
pub struct Nodal {
    nodes: Arc<ContactNodes>,
    law: ContactLaw,
}

impl Nodal {
    /// The body.
    pub fn body(&self) -> &SoftBody {
        &self.nodes.condensed.body
    }

    /// Applies `carry` to the displacement of all nodes (V) in m that `responses` give for a unit
    /// force on each contact node along each axis (3M). Forces on contact nodes must be distributed
    /// to the face alone.
    pub(crate) fn unit_responses<T>(
        &self,
        responses: &FaceResponses,
        carry: impl Fn(&[Vector3<f64>]) -> T,
    ) -> Vec<T> {
        let ContactNodes { condensed, loads, .. } = &*self.nodes;
        let answer = |i: usize| {
            let [node, axis] = [i / 3, i % 3];
            let load = |&(rank, share): &(u32, f64)| {
                (condensed.skin[rank as usize], Vector3::ith(axis, share))
            };
            let loads: Vec<_> = loads[node].iter().map(load).collect();
            carry(&responses.displacement(&loads))
        };
        (0..3 * loads.len()).map(answer).collect()
    }

    /// Distributes forces on contact nodes to the nodes of the mesh (V) in N.
    fn spread(&self, forces: &[(u32, Vector3<f64>)]) -> Vec<Vector3<f64>> {
        let condensed = &self.nodes.condensed;
        let mut all = vec![Vector3::zeros(); condensed.rest.places().len()];
        for (node, force) in forces {
            for &(rank, share) in &self.nodes.loads[*node as usize] {
                all[condensed.skin[rank as usize] as usize] += force * share;
            }
        }
        all
    }

    /// Solves every frame of `press`, in order; the first that fails is an error and the last.
    pub fn settled_path(&self, press: &Press) -> Vec<Result<ContactSolution>> {
        let mut scratch = NodalScratch::default();
        let levels = (std::slice::from_ref(&*self.nodes), ContactResolution::FAST);
        match NodalLoadStepping::new(levels, self.law, press, &mut scratch) {
            Ok(stepping) => stepping.every(press),
            Err(error) => vec![Err(error)],
        }
    }

    /// Solves `press` and returns its last frame.
    pub fn settle(&self, press: &Press) -> Result<ContactSolution> {
        self.settled_path(press).pop().expect("a press has a frame")
    }

    /// Computes the fields of a solution on the whole mesh; returns an error if an element is
    /// inverted.
    pub fn deformation(&self, settled: ContactSolution) -> Result<Deformation> {
        let rest = &self.nodes.condensed.rest;
        let contact_force = self.spread(&settled.forces);
        let mut workspace = rest.workspace();
        let displacement = rest.displacement(&contact_force, &mut workspace);
        let elastic = rest.elastic_force(&displacement, &mut workspace);
        let mut left = elastic.ok_or(Error::Inverted)?;
        left.iter_mut().zip(&contact_force).for_each(|(left, force)| *left -= force);
        rest.release(&mut left);
        Ok(Deformation {
            von_mises: rest.von_mises(&displacement),
            displacement,
            contact_force,
            wrench: settled.wrench,
            sliding: settled.sliding,
            poses: settled.history.poses.clone(),
            history: settled.history,
            iterations: settled.iterations,
            residual: left.iter().map(Vector3::norm_squared).sum::<f64>().sqrt(),
            seconds: settled.seconds,
            predicted_error: None,
        })
    }
}

impl Compliance {
    /// Returns a model of the same body and friction with contact at the nodes, without
    /// corrections for nonlinearity; an error if the friction is above [`MOST_FRICTION`].
    pub fn at_nodes(&self) -> Result<Nodal> {
        check_friction(self.settings.law.friction)?;
        let nodes = ContactNodes::new(Arc::clone(&self.condensed));
        Ok(Nodal { nodes: Arc::new(nodes), law: self.settings.law })
    }

    /// Returns [`Compliance::at_nodes`] with contact at the face nodes of a `coarse` mesh of the
    /// pad whose mesh is `fine`.
    pub fn at_coarse_nodes(&self, fine: &PadMesh, coarse: &PadMesh) -> Result<Nodal> {
        let nodes = ContactNodes::coarse(Arc::clone(&self.condensed), fine, coarse)?;
        Ok(Nodal { nodes: Arc::new(nodes), law: self.settings.law })
    }
}

impl DeformationModel for Nodal {
    /// Solves presses in parallel, each on one thread.
    fn solve(&self, presses: &[Press]) -> Vec<Result<Deformation>> {
        let last = |press: &Press| self.solve_path(press).pop().expect("a press has a frame");
        solve_in_parallel(presses, last)
    }

    fn solve_path(&self, press: &Press) -> Vec<Result<Deformation>> {
        let answers = self.settled_path(press).into_iter();
        answers.map(|settled| self.deformation(settled?)).collect()
    }
}
