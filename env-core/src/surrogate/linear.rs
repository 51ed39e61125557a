//! The linear solution that the network corrects, on the model mesh.
//!
//! Contact is solved on a regular grid of cells whose size follows the contact ([`LayeredPad`]).
//! Its forces, spread over the nodes of the model mesh's face, displace a fine mesh on which linear
//! elasticity is condensed in advance; the network need not learn what a coarse mesh would miss.
//! Near the contact, displacement and, if asked for ([`LinearStress`]), stress are those under the
//! forces on cells.

use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};

use super::{
    extension::Extension,
    material::PadMaterial,
    ops::{PadStress, Sparse},
};
use crate::{
    Error, Result,
    compliance::{
        Compliance, ComplianceOptions,
        nodal::{ContactResolution, ContactSolution, LayeredPad, Nodal, NodeContact, Sides},
    },
    contact::Backing,
    deformation::{Deformation, Law, Moduli, Press, SoftBody},
    geometry::{PadMesh, PadOutline, Shape, Transfer},
    interrupt,
    recent::Recent,
    sensor::Sensor,
    simd::vectorised,
};

/// Linear model of a gel. Models of one gel that differ in friction or contact resolution share the
/// precomputed data.
pub(super) struct LinearBaseline {
    layered: LayeredPad,
    precomputed: Arc<Precomputed>,
}

/// Precomputed data of a gel.
struct Precomputed {
    /// Without friction.
    layered: LayeredPad,
    fine: FineMesh,
}

/// Gel and meshes, which determine precomputed data.
#[derive(Clone, PartialEq)]
struct MeshedGel {
    outline: PadOutline,
    moduli: Moduli,
    /// Most nodes of the fine mesh.
    nodes: usize,
    /// Cells of the model mesh.
    cells: [u32; 3],
}

/// Largest part of the contact that may be on the walls of a pad.
const ON_WALLS: f64 = 0.5;

/// A hundred to two hundred megabytes each.
static PRECOMPUTED: Recent<MeshedGel, Precomputed> = Recent::new(2);

/// The fine mesh, and its response to contact.
struct FineMesh {
    compliance: Compliance,
    /// Its response to forces around the nodes of the model mesh's face.
    nodal: Nodal,
    extension: Extension,
    mesh: PadMesh,
    transfer: Transfer,
    /// Operator for stress, computed on first use.
    stress: Recent<(), Stress>,
}

/// Operator from forces on the face to stress.
struct Stress {
    extension: Extension,
    elements: PadStress,
    /// Shares of the fine mesh's tetrahedra in each tetrahedron of the model mesh.
    shares: Sparse,
}

/// Stress of a linear solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum LinearStress {
    /// None.
    Omitted,
    /// That under the forces spread over the nodes of the face.
    Spread,
    /// That under the forces on cells near the contact, else as [`LinearStress::Spread`].
    Resolved,
}

impl LinearStress {
    /// Stress that the network is given and adds to. Its weights are trained for one of them.
    pub(super) const OF_NETWORK: Self = Self::Resolved;
}

/// Fields on the model mesh. V nodes, T tetrahedra, S shapes.
#[derive(Clone, Debug)]
pub(super) struct PadFields {
    /// Displacement (V) in m.
    pub(super) displacement: Vec<Vector3<f64>>,
    /// Contact force (V) in N.
    pub(super) contact_force: Vec<Vector3<f64>>,
    /// Von Mises stress (T) in Pa, or empty.
    pub(super) von_mises: Vec<f64>,
    /// Poses of the shapes (S).
    pub(super) poses: Vec<Isometry3<f64>>,
}

/// A linear solution on the model mesh, with its contact on cells.
#[derive(Clone, Debug)]
pub(super) struct LinearFields {
    pub(super) fields: PadFields,
    pub(super) cells: CellContact,
}

/// Contact on cells, distributed to the nodes of the face.
#[derive(Clone, Debug)]
pub(super) struct CellContact {
    /// Nodes that bear some, ascending.
    pub(super) nodes: Vec<(u32, NodeContact)>,
    /// Side of a cell (m).
    pub(super) spacing: f64,
}

impl LinearBaseline {
    /// Creates the model of a gel on a mesh of at most `nodes` nodes, with answers on `model`, a
    /// mesh of the sensor's pad, and contact at the `resolution`. It is built in seconds, or in no
    /// time if one of the same gel is in use or was used lately.
    pub(super) fn new(
        sensor: &Sensor,
        gel: &PadMaterial,
        nodes: usize,
        model: &PadMesh,
        resolution: ContactResolution,
    ) -> Result<Self> {
        gel.moduli.check()?;
        let (outline, moduli) = (sensor.outline, gel.moduli);
        let of = MeshedGel { outline, moduli, nodes, cells: model.cells };
        let build = || Precomputed::new(&of, model);
        let precomputed = PRECOMPUTED.get(&of, build)?;
        let layered = precomputed.layered.with(gel.friction, resolution)?;
        Ok(Self { layered, precomputed })
    }

    /// Held faces of the pad.
    pub(super) fn backing(&self) -> &Backing {
        self.layered.backing()
    }

    /// Part of the contact of `shapes` at `poses` (S) that is on the pad's walls, where this model
    /// feels nothing: 0 to 1.
    pub(super) fn share_on_walls(&self, shapes: &[Shape], poses: &[Isometry3<f64>]) -> f64 {
        self.layered.share_on_walls(shapes, poses)
    }

    /// Returns the answer to a press of `shapes`, or an error if they press mostly on the walls.
    pub(super) fn on_face(&self, shapes: &[Shape], answer: Deformation) -> Result<Deformation> {
        let share = self.share_on_walls(shapes, &answer.poses);
        if share > ON_WALLS { Err(Error::OnWalls { share }) } else { Ok(answer) }
    }

    /// Solves the frames of `press`, in order; the first that fails is an error and the last.
    pub(super) fn path(&self, press: &Press) -> Vec<Result<ContactSolution>> {
        self.layered.settled_path(press)
    }

    /// Transfers an answer to the model mesh, with this `stress`.
    pub(super) fn carry(
        &self,
        settled: &ContactSolution,
        stress: LinearStress,
    ) -> Result<LinearFields> {
        let fine = &self.precomputed.fine;
        let nodes = self.layered.contacts(settled);
        let forces: Vec<_> = nodes.iter().map(|(node, contact)| (*node, contact.force)).collect();
        let displacement = fine.extension.displacement(&forces);
        let displacement = displacement.as_chunks::<3>().0.iter();
        let mut displacement: Vec<_> = displacement.map(|&u| Vector3::from(u).cast()).collect();
        self.layered.refine(settled, &mut displacement);
        let mut contact_force = vec![Vector3::zeros(); displacement.len()];
        for (node, force) in &forces {
            contact_force[*node as usize] = *force;
        }
        let von_mises = match stress {
            LinearStress::Omitted => Vec::new(),
            LinearStress::Spread => fine.von_mises(&forces, &fine.transfer, None)?,
            LinearStress::Resolved => {
                let near = self.layered.stress_near_contact(settled, &displacement);
                fine.von_mises(&forces, &fine.transfer, Some(&near))?
            }
        };
        let fields = PadFields {
            displacement,
            contact_force,
            von_mises,
            poses: settled.history.poses.clone(),
        };
        let cells = CellContact { nodes, spacing: self.layered.spacing(settled) };
        Ok(LinearFields { fields, cells })
    }
}

impl Precomputed {
    fn new(of: &MeshedGel, model: &PadMesh) -> Result<Self> {
        let (outline, moduli) = (&of.outline, of.moduli);
        let mesh = PadMesh::with_nodes(outline, of.nodes)?;
        let transfer = Transfer::new(&mesh.mesh, &model.mesh)?;
        interrupt::check()?;
        let compliance = Compliance::new(body(&mesh, moduli)?, ComplianceOptions::default())?;
        interrupt::check()?;
        let nodal = compliance.at_coarse_nodes(&mesh, model)?;
        interrupt::check()?;
        let sides = Sides::new(outline, moduli, Sides::VERTICES)?;
        let layered = LayeredPad::new(&compliance, outline, model, &sides)?;
        interrupt::check()?;
        let size = 3 * model.mesh.vertices.len();
        let extension = Extension::new(layered.unit_responses().map(|u| flat(&u)), size);
        let stress = Recent::new(1);
        let fine = FineMesh { compliance, nodal, extension, mesh, transfer, stress };
        Ok(Self { layered, fine })
    }
}

impl FineMesh {
    /// Von Mises stress of the model mesh (T) in Pa: that given as `near`, elsewhere that under
    /// `forces` (N) on its face, averaged from the fine mesh.
    fn von_mises(
        &self,
        forces: &[(u32, Vector3<f64>)],
        transfer: &Transfer,
        near: Option<&[Option<f64>]>,
    ) -> Result<Vec<f64>> {
        let near = |tet: usize| near.and_then(|near| near[tet]);
        let tets = transfer.parts().len();
        if forces.is_empty() {
            return Ok(vec![0.0; tets]);
        }
        if let Some(all) = (0..tets).map(near).collect() {
            return Ok(all);
        }
        let stress = self.stress.get(&(), || Ok(Stress::new(self, transfer)))?;
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
        let spread = |tet: usize| shear * f64::from(mean(tet));
        Ok((0..tets).map(|tet| near(tet).unwrap_or_else(|| spread(tet))).collect())
    }
}

impl Stress {
    fn new(fine: &FineMesh, transfer: &Transfer) -> Self {
        let elements = PadStress::new(&fine.mesh, 1.0);
        let responses = fine.compliance.face_responses(&fine.mesh);
        let stress = fine.nodal.unit_responses(&responses, |u| {
            let u: Vec<[f64; 3]> = u.iter().map(|&u| u.into()).collect();
            elements.arranged(&u)
        });
        let size = stress.first().map_or(0, Vec::len);
        let extension = Extension::new(stress.into_iter(), size);
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

/// Creates the soft body of a pad mesh.
pub(super) fn body(pad: &PadMesh, moduli: Moduli) -> Result<SoftBody> {
    SoftBody::new(pad.mesh.clone(), Law::default(), moduli, &pad.base)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::geometry::Shape;

    const MODULI: Moduli = Moduli { young: 3e5, poisson: 0.47 };

    /// Creates a gel, and forces around its face nodes as of a ball.
    fn pressed() -> (FineMesh, ContactSolution) {
        let sensor = Sensor::named("gelsight-mini").unwrap();
        let pad = sensor.pad(1000).unwrap();
        let of =
            MeshedGel { outline: sensor.outline, moduli: MODULI, nodes: 1000, cells: pad.cells };
        let fine = Precomputed::new(&of, &pad).unwrap().fine;
        let path = vec![vec![Isometry3::translation(1e-4, 0.0, 8e-3 - 5e-4)]];
        let press = Press::along(vec![Shape::Sphere { radius: 8e-3 }], path).unwrap();
        let settled = fine.nodal.settle(&press).unwrap();
        (fine, settled)
    }

    /// Model of a Mini's gel.
    fn linear(friction: f64) -> Result<LinearBaseline> {
        let sensor = Sensor::named("gelsight-mini")?;
        let gel = PadMaterial { moduli: MODULI, friction, thickness: sensor.outline.thickness };
        LinearBaseline::new(&sensor, &gel, 1000, &sensor.pad(1000)?, ContactResolution::FAST)
    }

    #[test]
    fn gels_that_differ_in_friction_share_what_takes_long_and_have_their_own_friction() {
        let [slippery, rough] = [0.0, 0.8].map(|friction| linear(friction).unwrap());
        assert!(Arc::ptr_eq(&slippery.precomputed, &rough.precomputed));
        assert!(linear(-0.1).is_err_and(|error| error.to_string().contains("friction")));
        let at = |x: f64| vec![Isometry3::translation(x, 0.0, 3e-3 - 4e-4)];
        let path = vec![at(0.0), at(3e-4)];
        let press = Press::along(vec![Shape::Sphere { radius: 3e-3 }], path).unwrap();
        let sheared = |gel: &LinearBaseline| {
            gel.path(&press).pop().unwrap().unwrap().wrench.force.xy().norm()
        };
        let [without, with] = [&slippery, &rough].map(sheared);
        assert!(without < 0.05 * with, "{without} N, {with} N");
    }

    #[test]
    fn stress_by_the_matrix_is_that_of_a_solve_on_the_whole_mesh() {
        let (fine, settled) = pressed();
        let same = Transfer::new(&fine.mesh.mesh, &fine.mesh.mesh).unwrap();
        let found = fine.von_mises(&settled.forces, &same, None).unwrap();
        let solved = same.average(&fine.nodal.deformation(settled).unwrap().von_mises);
        let most = solved.iter().copied().fold(0.0, f64::max);
        let mut pairs = found.iter().zip(&solved);
        assert!(found.len() == solved.len() && most > 1e3, "{most} Pa");
        // The matrix is rounded to 16 bits, which affects differences between neighbours most, and
        // the fast stress has single precision and a floor of 1e-5 of the shear modulus.
        assert!(pairs.all(|(a, b)| (a - b).abs() < 3e-4 * most), "{most} Pa");
    }

    #[test]
    fn stress_is_resolved_near_the_contact_and_as_spread_elsewhere() {
        let linear = linear(0.5).unwrap();
        let radius = 1e-3;
        let path = vec![vec![Isometry3::translation(-5e-3, -6e-3, radius - 4e-4)]];
        let press = Press::along(vec![Shape::Sphere { radius }], path).unwrap();
        let settled = linear.path(&press).pop().unwrap().unwrap();
        let stress = |stress| linear.carry(&settled, stress).unwrap().fields.von_mises;
        let (spread, resolved) = (stress(LinearStress::Spread), stress(LinearStress::Resolved));
        assert!(stress(LinearStress::Omitted).is_empty());
        let mesh = Sensor::named("gelsight-mini").unwrap().pad(1000).unwrap().mesh;
        let centre = |tet: usize| {
            nalgebra::Point3::from(
                mesh.corners(tet).iter().map(|p| p.coords).sum::<Vector3<f64>>() / 4.0,
            )
        };
        let most = |stress: &[f64]| stress.iter().copied().fold(0.0, f64::max);
        assert!(most(&resolved) > 1.5 * most(&spread), "{} Pa", most(&resolved));
        for tet in 0..mesh.tets.len() {
            let is_far = centre(tet).x > 4e-3;
            assert!(resolved[tet].is_finite() && resolved[tet] >= 0.0);
            assert!(!is_far || resolved[tet] == spread[tet], "{} Pa", resolved[tet]);
        }
    }

    #[test]
    fn presses_that_wait_for_the_matrix_do_not_wait_for_ever() {
        const ROUNDS: usize = 3;
        let (mut fine, settled) = pressed();
        let same = Transfer::new(&fine.mesh.mesh, &fine.mesh.mesh).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(8).build().unwrap();
        let (done, is_done) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            for round in 0..ROUNDS {
                fine.stress = Recent::new(1);
                pool.in_place_scope(|scope| {
                    let ask = |_: &_| assert!(fine.von_mises(&settled.forces, &same, None).is_ok());
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
