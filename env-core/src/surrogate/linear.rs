//! The linear answer that the network corrects, on the model mesh.
//!
//! Linear elasticity can be condensed in advance on any mesh. The body is condensed on a mesh as
//! fine as that of the reference solutions, so the network need not learn what a coarse mesh would
//! miss. Contact is evaluated either at that mesh's many surface points ([`Contact::Points`]), or
//! at the nodes of the model mesh's face ([`Contact::Nodes`]), which is an order of magnitude
//! faster and leaves more to be learnt.

use std::sync::OnceLock;

use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    extension::Extension,
    features::PadMaterial,
    ops::{PadStress, Sparse},
};
use crate::{
    Result,
    compliance::{
        Compliance, Options,
        nodal::{LayeredPad, Nodal, NodeContact, Settled},
    },
    deformation::{Deformation, History, Law, Moduli, Press, SoftBody, Wrench},
    geometry::{PadMesh, Transfer},
    sensor::Sensor,
    simd::vectorised,
};

/// Points at which the linear model evaluates contact.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Contact {
    /// Surface points of its own mesh, as in finite elements.
    #[default]
    Points,
    /// Nodes of the model mesh's face.
    Nodes,
    /// Cells of a regular grid, of a size that follows the contact.
    Cells,
}

impl Contact {
    /// Name in the settings.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Points => "points",
            Self::Nodes => "nodes",
            Self::Cells => "cells",
        }
    }
}

/// Linear model of a gel.
pub(super) struct LinearBaseline {
    solver: Solver,
    transfer: Transfer,
}

enum Solver {
    Points(Compliance),
    Nodes(Box<Nodes>),
    /// Contact on cells; their forces are spread over the nodes of the face.
    Cells(Box<(LayeredPad, Nodes)>),
}

/// Contact at nodes, and the response of the meshes to its forces.
struct Nodes {
    nodal: Nodal,
    extension: Extension,
    fine: PadMesh,
    /// Operator for stress, computed on first use.
    stress: OnceLock<Stress>,
}

/// Operator from forces on the face to stress.
struct Stress {
    extension: Extension,
    elements: PadStress,
    /// Shares of the fine mesh's tetrahedra in each tetrahedron of the model mesh.
    shares: Sparse,
}

/// An answer of the linear model, before it is transferred to the model mesh.
pub(super) enum LinearAnswer {
    Points(Box<Deformation>),
    Nodes(Box<Settled>),
}

/// A linear answer on the model mesh. V nodes, T tetrahedra, S shapes.
#[derive(Clone, Debug)]
pub(super) struct LinearFields {
    /// Displacement (V) in m.
    pub(super) displacement: Vec<Vector3<f64>>,
    /// Contact force (V) in N.
    pub(super) contact_force: Vec<Vector3<f64>>,
    /// Von Mises stress (T) in Pa, or empty.
    pub(super) von_mises: Vec<f64>,
    /// Poses of the shapes (S).
    pub(super) poses: Vec<Isometry3<f64>>,
    /// Contact on cells, if it was evaluated there.
    pub(super) cells: Option<CellContact>,
}

/// Contact on cells as the nodes of the face see it.
#[derive(Clone, Debug)]
pub(super) struct CellContact {
    /// Nodes that bear some, ascending.
    pub(super) nodes: Vec<(u32, NodeContact)>,
    /// Side of a cell (m).
    pub(super) spacing: f64,
}

impl LinearBaseline {
    /// Builds the model of a gel on a mesh of at most `nodes` nodes, with answers on `model`.
    pub(super) fn new(
        sensor: &Sensor,
        gel: &PadMaterial,
        nodes: usize,
        contact: Contact,
        model: &PadMesh,
    ) -> Result<Self> {
        let fine = sensor.pad(nodes)?;
        let transfer = Transfer::new(&fine.mesh, &model.mesh)?;
        let options = Options { friction: gel.friction, sweeps: 0 };
        let compliance = Compliance::new(body(&fine, gel.moduli)?, options)?;
        let solver = match contact {
            Contact::Points => Solver::Points(compliance),
            Contact::Nodes | Contact::Cells => {
                let nodal = compliance.at_coarse_nodes(&fine, model)?;
                let layered = match contact {
                    Contact::Cells => {
                        Some(LayeredPad::new(&compliance, &sensor.outline, &fine, model)?)
                    }
                    _ => None,
                };
                let extension = Extension::new(&nodal, |u, force| {
                    let mut moved = transfer.interpolate(u);
                    if let Some(layered) = &layered {
                        layered.replace(force, &mut moved);
                    }
                    flat(&moved)
                });
                let nodes = Nodes { nodal, extension, fine, stress: OnceLock::new() };
                match layered {
                    Some(layered) => Solver::Cells(Box::new((layered, nodes))),
                    None => Solver::Nodes(Box::new(nodes)),
                }
            }
        };
        Ok(Self { solver, transfer })
    }

    /// Solves the frames of `press`, in order; the first that fails is an error and the last.
    pub(super) fn path(&self, press: &Press) -> Vec<Result<LinearAnswer>> {
        match &self.solver {
            Solver::Points(compliance) => {
                let answers = compliance.solve_path(press).into_iter();
                answers.map(|answer| Ok(LinearAnswer::Points(Box::new(answer?)))).collect()
            }
            Solver::Nodes(nodes) => {
                let answers = nodes.nodal.settled_path(press).into_iter();
                answers.map(|settled| Ok(LinearAnswer::Nodes(Box::new(settled?)))).collect()
            }
            Solver::Cells(both) => {
                let answers = both.0.settled_path(press).into_iter();
                answers.map(|settled| Ok(LinearAnswer::Nodes(Box::new(settled?)))).collect()
            }
        }
    }

    /// Transfers an answer to the model mesh; its stress is left empty unless `with_stress`.
    pub(super) fn carry(&self, answer: &LinearAnswer, with_stress: bool) -> LinearFields {
        match (answer, &self.solver) {
            (LinearAnswer::Nodes(settled), Solver::Nodes(nodes)) => {
                self.at_nodes(nodes, settled, &settled.forces, with_stress)
            }
            (LinearAnswer::Nodes(settled), Solver::Cells(both)) => {
                let (layered, nodes) = &**both;
                let contacts = layered.contacts(settled);
                let forces: Vec<_> = contacts.iter().map(|(node, c)| (*node, c.force)).collect();
                let mut fields = self.at_nodes(nodes, settled, &forces, with_stress);
                layered.refine(settled, &mut fields.displacement);
                let spacing = layered.spacing(settled);
                fields.cells = Some(CellContact { nodes: contacts, spacing });
                fields
            }
            (LinearAnswer::Points(fine), _) => {
                let stress = || self.transfer.average(&fine.von_mises);
                LinearFields {
                    displacement: self.transfer.interpolate(&fine.displacement),
                    contact_force: self.transfer.spread(&fine.contact_force),
                    von_mises: if with_stress { stress() } else { Vec::new() },
                    poses: fine.poses.clone(),
                    cells: None,
                }
            }
            (LinearAnswer::Nodes(_), Solver::Points(_)) => {
                unreachable!("answers come from this model")
            }
        }
    }
}

impl LinearBaseline {
    /// Fields under `forces` (N) on nodes of the face, which come first among all.
    fn at_nodes(
        &self,
        nodes: &Nodes,
        settled: &Settled,
        forces: &[(u32, Vector3<f64>)],
        with_stress: bool,
    ) -> LinearFields {
        let displacement = nodes.extension.displacement(forces);
        let displacement = displacement.as_chunks::<3>().0.iter();
        let displacement: Vec<_> = displacement.map(|&u| Vector3::from(u).cast()).collect();
        let mut contact_force = vec![Vector3::zeros(); displacement.len()];
        for (node, force) in forces {
            contact_force[*node as usize] = *force;
        }
        let stress = || nodes.von_mises(forces, &self.transfer);
        LinearFields {
            displacement,
            contact_force,
            von_mises: if with_stress { stress() } else { Vec::new() },
            poses: settled.history.poses.clone(),
            cells: None,
        }
    }
}

impl Nodes {
    /// Von Mises stress of the model mesh under `forces` (N) on its face in Pa, averaged from the
    /// fine mesh.
    fn von_mises(&self, forces: &[(u32, Vector3<f64>)], transfer: &Transfer) -> Vec<f64> {
        let stress = self.stress.get_or_init(|| Stress::new(self, transfer));
        if forces.is_empty() {
            return vec![0.0; stress.shares.height()];
        }
        let displacement = stress.extension.displacement(forces);
        let mut fine = Vec::new();
        vectorised(
            #[inline(always)]
            || stress.elements.stress(&displacement, &mut fine),
        );
        let shear = self.nodal.body().moduli()[0].shear();
        let mean = |tet: usize| -> f32 {
            stress.shares.row(tet).map(|(place, share)| fine[place] * share).sum()
        };
        (0..stress.shares.height()).map(|tet| shear * f64::from(mean(tet))).collect()
    }
}

impl Stress {
    fn new(nodes: &Nodes, transfer: &Transfer) -> Self {
        let elements = PadStress::new(&nodes.fine, 1.0);
        let extension = Extension::new(&nodes.nodal, |u, _| {
            let u: Vec<[f64; 3]> = u.iter().map(|&u| u.into()).collect();
            elements.arranged(&u)
        });
        let share = |&(tet, share): &(u32, f64)| (elements.places()[tet as usize], share as f32);
        let shares: Vec<_> =
            transfer.parts().map(|parts| parts.iter().map(share).collect()).collect();
        let shares = Sparse::new(&shares, elements.count());
        Self { extension, elements, shares }
    }
}

fn flat(u: &[Vector3<f64>]) -> Vec<f64> {
    u.iter().flat_map(|u| [u.x, u.y, u.z]).collect()
}

impl LinearAnswer {
    /// History of the contact.
    pub(super) fn history(&self) -> &History {
        match self {
            Self::Points(fine) => &fine.history,
            Self::Nodes(settled) => &settled.history,
        }
    }

    /// Resultant of all contact.
    pub(super) fn wrench(&self) -> Wrench {
        match self {
            Self::Points(fine) => fine.wrench,
            Self::Nodes(settled) => settled.wrench,
        }
    }

    /// Number of solver iterations, and wall time (s).
    pub(super) fn effort(&self) -> (usize, f64) {
        match self {
            Self::Points(fine) => (fine.iterations, fine.seconds),
            Self::Nodes(settled) => (settled.iterations, settled.seconds),
        }
    }
}

/// Creates the soft body of a pad mesh.
pub(super) fn body(pad: &PadMesh, moduli: Moduli) -> Result<SoftBody> {
    SoftBody::new(pad.mesh.clone(), Law::default(), moduli, &pad.base)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::geometry::Shape;

    /// Creates a gel with contact at nodes, and solves a press of a ball into it.
    fn pressed() -> (Box<Nodes>, Settled) {
        let sensor = Sensor::named("gelsight-mini").unwrap();
        let moduli = Moduli { young: 3e5, poisson: 0.47 };
        let gel = PadMaterial { moduli, friction: 0.5, thickness: sensor.outline.thickness };
        let pad = sensor.pad(1000).unwrap();
        let linear = LinearBaseline::new(&sensor, &gel, 1000, Contact::Nodes, &pad).unwrap();
        let Solver::Nodes(nodes) = linear.solver else { panic!("contact at nodes") };
        let path = vec![vec![Isometry3::translation(1e-4, 0.0, 8e-3 - 5e-4)]];
        let press = Press::along(vec![Shape::Sphere { radius: 8e-3 }], path).unwrap();
        let settled = nodes.nodal.settle(&press).unwrap();
        (nodes, settled)
    }

    #[test]
    fn stress_by_the_matrix_is_that_of_a_solve_on_the_whole_mesh() {
        let (nodes, settled) = pressed();
        let same = Transfer::new(&nodes.fine.mesh, &nodes.fine.mesh).unwrap();
        let found = nodes.von_mises(&settled.forces, &same);
        let solved = same.average(&nodes.nodal.deformation(settled).unwrap().von_mises);
        let most = solved.iter().copied().fold(0.0, f64::max);
        let pairs = found.iter().zip(&solved);
        let error = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(found.len() == solved.len() && most > 1e3, "{most} Pa");
        // The matrix is rounded to 16 bits, which affects differences between neighbours most, and
        // the fast stress has single precision and a floor of 1e-5 of the shear modulus.
        assert!(error < 3e-4 * most, "{error} Pa of {most} Pa");
    }

    #[test]
    fn presses_that_wait_for_the_matrix_do_not_wait_for_ever() {
        const ROUNDS: usize = 3;
        let (mut nodes, settled) = pressed();
        let same = Transfer::new(&nodes.fine.mesh, &nodes.fine.mesh).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(8).build().unwrap();
        let (done, is_done) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            for round in 0..ROUNDS {
                nodes.stress = OnceLock::new();
                pool.in_place_scope(|scope| {
                    let ask = |_: &_| drop(nodes.von_mises(&settled.forces, &same));
                    scope.spawn(ask);
                    // The matrix is being computed here. If that used the pool, its thread could be
                    // handed one of these tasks while it waits for others, and would deadlock.
                    std::thread::sleep(Duration::from_millis(5));
                    (0..64).for_each(|_| scope.spawn(ask));
                });
                done.send(round).unwrap();
            }
        });
        let rounds = || is_done.recv_timeout(Duration::from_secs(30));
        let last = std::iter::from_fn(|| rounds().ok()).last();
        assert_eq!(last, Some(ROUNDS - 1), "rounds without a deadlock");
    }
}
