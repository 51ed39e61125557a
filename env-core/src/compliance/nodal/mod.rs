//! Contact at the nodes: the same linear elasticity, answered in a fraction of the time.
//!
//! [`Compliance`] feels contact at many points of every face and solves for the forces by Newton's
//! method. Here every node of the skin stands for the area around it and touches the shape nearest
//! to it, and the forces are found by projected Gauss–Seidel sweeps (Jourdan, Alart and Jean 1998):
//! three numbers of one node at a time, Coulomb's cone included. Nothing is factorised, so nothing
//! fails where a contact is large, and a press that goes on from the forces before takes a few
//! sweeps. What is lost is the contact between the nodes: where cells have the side h, a ball of
//! radius R is felt up to h²/4R late, 0.08 mm for 4 mm on cells of 1.15 mm. A shape thinner than the
//! cells is an error where it stands deeper between nodes than an eighth of its thickness.
//!
//! Shapes: M contact nodes, V nodes, S rigid shapes.

mod between;
mod patch;
mod settle;
mod skin;
mod walk;

use std::sync::Arc;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::Compliance;
use crate::{
    Error, Result,
    contact::ContactLaw,
    deformation::{Deformation, DeformationModel, History, Press, SoftBody, Wrench},
    geometry::PadMesh,
};

use skin::Skin;
use walk::{Scratch, Walk};

/// The compliance model of one soft body with contact at its nodes. Copies share what was computed in
/// advance.
#[derive(Clone)]
pub struct Nodal {
    skin: Arc<Skin>,
    law: ContactLaw,
}

/// Where a press ends, without fields.
#[derive(Clone, Debug, PartialEq)]
pub struct Settled {
    /// Contact nodes that touch, and the forces on them (N).
    pub forces: Vec<(u32, Vector3<f64>)>,
    /// Resultant of all contact on the soft body.
    pub wrench: Wrench,
    /// What the contact remembers.
    pub history: History,
    /// Sweeps since the last frame.
    pub iterations: usize,
    /// Wall time (s).
    pub seconds: f64,
}

impl Nodal {
    /// The body.
    pub fn body(&self) -> &SoftBody {
        &self.skin.condensed.body
    }

    /// What `carry` makes of the displacement of all nodes (V) in m under a unit force on each contact
    /// node along each axis (3M).
    pub(crate) fn unit_responses<T>(&self, carry: impl Fn(&[Vector3<f64>]) -> T) -> Vec<T> {
        let rest = &self.skin.condensed.rest;
        let mut workspace = rest.workspace();
        let answer = |i: usize| {
            let force = Vector3::ith(i % 3, 1.0);
            carry(&rest.displacement(&self.spread(&[((i / 3) as u32, force)]), &mut workspace))
        };
        (0..3 * self.skin.places.len()).map(answer).collect()
    }

    /// Forces on contact nodes as forces on the nodes of the mesh (V) in N.
    fn spread(&self, forces: &[(u32, Vector3<f64>)]) -> Vec<Vector3<f64>> {
        let condensed = &self.skin.condensed;
        let mut all = vec![Vector3::zeros(); condensed.rest.places().len()];
        for (node, force) in forces {
            for &(rank, share) in &self.skin.loads[*node as usize] {
                all[condensed.skin[rank as usize] as usize] += force * share;
            }
        }
        all
    }

    /// Every frame of `press`, in order; the first that is not solved is an error and the last.
    pub fn settled_path(&self, press: &Press) -> Vec<Result<Settled>> {
        let mut scratch = Scratch::default();
        match Walk::new(&self.skin, self.law_of(press), press, &mut scratch) {
            Ok(walk) => walk.every(press),
            Err(error) => vec![Err(error)],
        }
    }

    /// Where `press` ends.
    pub fn settle(&self, press: &Press) -> Result<Settled> {
        self.settled_path(press).pop().expect("a press has a frame")
    }

    /// The fields of an answer, solved for on the whole mesh.
    pub fn deformation(&self, settled: Settled) -> Result<Deformation> {
        let rest = &self.skin.condensed.rest;
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
            poses: settled.history.poses.clone(),
            history: settled.history,
            iterations: settled.iterations,
            residual: left.iter().map(Vector3::norm_squared).sum::<f64>().sqrt(),
            seconds: settled.seconds,
        })
    }

    /// The law with the friction of `press`.
    fn law_of(&self, press: &Press) -> ContactLaw {
        ContactLaw { friction: press.friction().unwrap_or(self.law.friction), ..self.law }
    }
}

impl Compliance {
    /// The same body and friction with contact at the nodes, without sweeps of nonlinearity.
    pub fn at_nodes(&self) -> Nodal {
        let skin = Skin::new(Arc::clone(&self.condensed));
        Nodal { skin: Arc::new(skin), law: self.settings.law }
    }

    /// As [`Compliance::at_nodes`] of the pad mesh `fine`, at the nodes of the face of a coarser one.
    pub fn at_coarse_nodes(&self, fine: &PadMesh, coarse: &PadMesh) -> Result<Nodal> {
        let skin = Skin::coarse(Arc::clone(&self.condensed), fine, coarse)?;
        Ok(Nodal { skin: Arc::new(skin), law: self.settings.law })
    }
}

impl DeformationModel for Nodal {
    /// Presses are solved in parallel, each on one thread.
    fn solve(&mut self, presses: &[Press]) -> Vec<Result<Deformation>> {
        let model = &*self;
        let last = |press| model.solve_path(press).pop().expect("a press has a frame");
        presses.par_iter().map(last).collect()
    }

    fn solve_path(&self, press: &Press) -> Vec<Result<Deformation>> {
        let answers = self.settled_path(press).into_iter();
        answers.map(|settled| self.deformation(settled?)).collect()
    }
}
