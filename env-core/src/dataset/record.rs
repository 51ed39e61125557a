//! Solved grasps as named tensors.
//!
//! F frames, V nodes and T tetrahedra of the model mesh, A anchors of all frames, P contact points
//! of the truth mesh. Fields and anchors are 32-bit floats; poses (position, then quaternion x, y,
//! z, w), resultant forces and torques are 64-bit floats. Names of the tensors of grasp `007` begin
//! with `007.`, followed by `first.` or `second.` for those of its pads.

use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    config::PadModels,
    plan::Plan,
    ramp::GraspFrame,
    tensor::{Tensor, Tensors},
};
use crate::{
    deformation::{Deformation, Wrench},
    fem::{Carried, Carrier},
    geometry::TetMesh,
};

/// Metadata of a grasp in a shard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Entry {
    /// Grasp to be solved.
    pub(super) plan: Plan,
    /// Number of frames solved.
    pub(super) frames: usize,
    /// Error that ended it early.
    pub(super) error: Option<String>,
}

/// Grasps of one object, ready to be written to a file.
pub(super) type GraspTensors = Tensors<Entry>;

/// Tensors by name.
pub(super) type Named = Vec<(String, Tensor)>;

impl GraspTensors {
    /// Returns a grasp that is not tried, with the `reason`.
    pub(super) fn unreached(plan: &Plan, reason: String) -> Self {
        Self::of_grasp(Entry { plan: plan.clone(), frames: 0, error: Some(reason) }, Vec::new())
    }

    /// Returns one grasp; its number is put in front of the names of its `tensors`.
    pub(super) fn of_grasp(entry: Entry, tensors: Named) -> Self {
        let number = entry.plan.name.rsplit('/').next().unwrap_or_default();
        let tensors = tensors.into_iter().map(|(name, t)| (format!("{number}.{name}"), t));
        Self { tensors: tensors.collect(), entries: vec![entry] }
    }
}

/// Tensors of a grasp by two pads; fields are carried from the truth mesh to the model mesh.
pub(super) fn of_pads(frames: &[GraspFrame], carrier: &Carrier) -> Named {
    let count = frames.len();
    let number = |field: fn(&GraspFrame) -> f64| Tensor::double(frames.iter().map(field), &[count]);
    let object = frames.iter().flat_map(|f| pose(&f.grasped.object));
    let mut tensors = vec![
        ("force".to_owned(), number(|f| f.force)),
        ("closing".to_owned(), number(|f| f.closing)),
        ("residual".to_owned(), number(|f| f.grasped.residual)),
        ("object".to_owned(), Tensor::double(object, &[count, 7])),
    ];
    for (side, name) in ["first", "second"].into_iter().enumerate() {
        let bodies: Vec<_> = frames.iter().map(|f| &f.grasped.pads[side]).collect();
        let pressed = bodies.iter().flat_map(|pad| pose(&pad.poses[0]));
        let placed = frames.iter().flat_map(|f| pose(&f.pads[side]));
        let mut own = of_bodies(&bodies, carrier);
        own.push(("press", Tensor::double(pressed, &[count, 7])));
        own.push(("pose", Tensor::double(placed, &[count, 7])));
        own.push(("wrench", wrenches(bodies.iter().map(|pad| &pad.wrench))));
        tensors.extend(own.into_iter().map(|(what, tensor)| (format!("{name}.{what}"), tensor)));
    }
    tensors
}

/// Fields of a soft body on the model mesh (V, T), and the resultant of its contact.
pub struct BodyFields {
    /// Displacement (V) in m, and von Mises stress (T) in Pa.
    pub carried: Carried,
    /// Contact force (V) in N.
    pub contact_force: Vec<Vector3<f64>>,
    /// Resultant force (N) and torque (N m) of contact.
    pub wrench: Wrench,
}

impl BodyFields {
    /// Carries a solution to the model mesh.
    pub(super) fn of(solved: &Deformation, carrier: &Carrier) -> Self {
        Self {
            carried: carrier.fields(&solved.history.displacement),
            contact_force: carrier.spread(&solved.contact_force),
            wrench: solved.wrench,
        }
    }
}

/// Fields, contact history and convergence of a soft body, frame by frame.
pub(super) fn of_bodies(frames: &[&Deformation], carrier: &Carrier) -> Vec<(&'static str, Tensor)> {
    let fields: Vec<_> = frames.iter().map(|frame| BodyFields::of(frame, carrier)).collect();
    of_frames(frames, &fields)
}

/// Returns [`of_bodies`] with the `fields` of each frame.
pub(super) fn of_frames(
    frames: &[&Deformation],
    fields: &[BodyFields],
) -> Vec<(&'static str, Tensor)> {
    let count = frames.len();
    let displacement: Vec<_> = fields.iter().flat_map(|f| &f.carried.displacement).collect();
    let force: Vec<_> = fields.iter().flat_map(|f| &f.contact_force).collect();
    let stress: Vec<_> = fields.iter().flat_map(|f| f.carried.von_mises.iter().copied()).collect();
    let rows = |all: usize| all / count.max(1);
    let (nodes, tets) = (rows(force.len()), rows(stress.len()));
    let anchors: Vec<_> = frames.iter().flat_map(|f| &f.history.anchors).collect();
    let each = frames.iter().map(|f| f.history.anchors.len());
    let total = anchors.len();
    vec![
        ("displacement", Tensor::single(flat(displacement), &[count, nodes, 3])),
        ("contact_force", Tensor::single(flat(force), &[count, nodes, 3])),
        ("von_mises", Tensor::single(stress, &[count, tets])),
        ("iterations", Tensor::counts(frames.iter().map(|f| f.iterations), &[count])),
        ("residual", Tensor::double(frames.iter().map(|f| f.residual), &[count])),
        ("anchors", Tensor::counts(each, &[count])),
        ("anchor_shape", Tensor::counts(anchors.iter().map(|a| a.shape as usize), &[total])),
        ("anchor_point", Tensor::counts(anchors.iter().map(|a| a.point as usize), &[total])),
        ("anchor_place", Tensor::single(anchors.iter().flat_map(|a| place(&a.place)), &[total, 3])),
    ]
}

/// Forces and torques (F, 6).
pub(super) fn wrenches<'a>(all: impl ExactSizeIterator<Item = &'a Wrench>) -> Tensor {
    let count = all.len();
    Tensor::double(all.flat_map(|w| flat(&[w.force, w.torque])), &[count, 6])
}

fn flat<'a>(vectors: impl IntoIterator<Item = &'a Vector3<f64>>) -> Vec<f64> {
    vectors.into_iter().flat_map(|v| [v.x, v.y, v.z]).collect()
}

fn place(point: &Point3<f64>) -> [f64; 3] {
    [point.x, point.y, point.z]
}

/// Position and quaternion.
pub(super) fn pose(pose: &Isometry3<f64>) -> [f64; 7] {
    let (p, q) = (pose.translation, pose.rotation);
    [p.x, p.y, p.z, q.i, q.j, q.k, q.w]
}

impl PadModels {
    /// File of the pads' model mesh, see [`mesh_file`].
    pub(super) fn mesh_file(&self) -> Vec<u8> {
        mesh_file(&self.model.mesh, &self.model.base, &self.truth.contact_points())
    }
}

/// Serialises a model mesh: `vertices` (V, 3) in m, `tets` (T, 4) and `fixed` nodes, with the
/// positions of the `contact_points` of the truth mesh (P, 3), to which the indices of anchors
/// refer.
pub(super) fn mesh_file(mesh: &TetMesh, fixed: &[u32], points: &[Point3<f64>]) -> Vec<u8> {
    let corners = mesh.tets.iter().flatten().map(|&i| i as usize);
    let vertices = mesh.vertices.iter().flat_map(place);
    let places = points.iter().flat_map(place);
    let tensors = vec![
        ("vertices".to_owned(), Tensor::double(vertices, &[mesh.vertices.len(), 3])),
        ("tets".to_owned(), Tensor::counts(corners, &[mesh.tets.len(), 4])),
        ("fixed".to_owned(), Tensor::counts(fixed.iter().map(|&i| i as usize), &[fixed.len()])),
        ("contact_points".to_owned(), Tensor::single(places, &[points.len(), 3])),
    ];
    GraspTensors { tensors, entries: Vec::new() }.to_bytes()
}
