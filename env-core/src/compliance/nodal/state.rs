//! State of a press with contact at the nodes, and its solution. A press begins with the shapes
//! outside of the body, or as a history left it.

use std::slice;

use nalgebra::{Isometry3, Point3, Vector3};

use super::contact_nodes::ContactNodes;
use crate::{
    Error, Result,
    contact::{backed_off, check_first, clearance},
    deformation::{Anchor, History, Wrench},
    geometry::Shape,
};

/// Shortest first part of the lift of a shape (m).
const SHORTEST: f64 = 1e-6;

/// Touching node.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    pub(super) rank: u32,
    pub(super) shape: u32,
    /// Place where friction holds it, in the frame of the shape.
    pub(super) stuck: Point3<f64>,
    /// Force of the shape on the node (N).
    pub(super) force: Vector3<f64>,
    /// Outward normal of the shape there; zero if it has not been measured yet.
    pub(super) normal: Vector3<f64>,
}

/// State of body and shapes in balance.
pub(super) struct NodalState {
    pub(super) poses: Vec<Isometry3<f64>>,
    /// Index of the set of contact nodes that touch.
    pub(super) level: usize,
    /// Touching nodes, ascending by rank.
    pub(super) held: Vec<Held>,
    pub(super) wrench: Wrench,
    /// Largest displacement of a node near the shapes (m).
    pub(super) amplitude: f64,
    pub(super) sweeps: usize,
}

/// Solution of a press without fields.
#[derive(Clone, Debug, PartialEq)]
pub struct ContactSolution {
    /// Index of the set of contact nodes, if the model has several.
    pub level: usize,
    /// Touching contact nodes with the forces on them (N).
    pub forces: Vec<(u32, Vector3<f64>)>,
    /// Outward normal of the shape at each of them.
    pub normals: Vec<Vector3<f64>>,
    /// Resultant of all contact on the soft body.
    pub wrench: Wrench,
    /// Share of the normal force that slides.
    pub sliding: f64,
    /// History from which a later press may continue.
    pub history: History,
    /// Sweeps since the last frame.
    pub iterations: usize,
    /// Wall time (s).
    pub seconds: f64,
}

/// Touching nodes with the forces on them (N).
pub(super) fn forces(held: &[Held]) -> Vec<(u32, Vector3<f64>)> {
    held.iter().map(|held| (held.rank, held.force)).collect()
}

/// Returns the `first` poses with each shape that overlaps the body at rest moved out of it, to
/// where it is taken to come from: to above a pad if it does not reach below its base. Returns an
/// error if one is wholly inside the body.
pub(super) fn outside(
    levels: &[ContactNodes],
    shapes: &[Shape],
    first: &[Isometry3<f64>],
) -> Result<Vec<Isometry3<f64>>> {
    let (nodes, mesh) = (&levels[0], levels[0].condensed.body.mesh());
    let finest = levels.last().and_then(ContactNodes::grid);
    let depth = |shape: &Shape, pose: &Isometry3<f64>| match finest {
        Some(grid) => -grid.clearance(slice::from_ref(shape), slice::from_ref(pose)),
        None => -clearance(slice::from_ref(shape), slice::from_ref(pose), &nodes.places),
    };
    let depths: Vec<_> = shapes.iter().zip(first).map(|(shape, pose)| depth(shape, pose)).collect();
    check_first(shapes.len(), |i| depths[i] <= 0.0 && nodes.engulfs(&shapes[i], &first[i]))?;
    let start = |((shape, pose), sunk): ((&Shape, &Isometry3<f64>), &f64)| {
        if finest.is_some() && *sunk <= 0.0 {
            return *pose;
        }
        let most = finest.map_or(0.0, |grid| grid.outline().thickness);
        let above = lifted(pose, [*sunk, most], |pose| depth(shape, pose));
        above.unwrap_or_else(|| {
            let (shape, pose) = (slice::from_ref(shape), slice::from_ref(pose));
            backed_off(shape, pose, &nodes.points, &nodes.places, mesh)[0]
        })
    };
    Ok(shapes.iter().zip(first).zip(&depths).map(start).collect())
}

/// Moves a shape, `sunk` into a pad (m), along z until its `depth` there (m) is 0; `None` if it is
/// not after `most` (m).
fn lifted(
    pose: &Isometry3<f64>,
    [sunk, most]: [f64; 2],
    depth: impl Fn(&Isometry3<f64>) -> f64,
) -> Option<Isometry3<f64>> {
    let (mut step, mut lift, mut above) = (sunk.max(SHORTEST), 0.0, *pose);
    while lift < most {
        lift = f64::min(lift + step, most);
        step *= 2.0;
        above.translation.vector.z = pose.translation.vector.z + lift;
        if depth(&above) <= 0.0 {
            return Some(above);
        }
    }
    None
}

/// Restores the state of a `history`; returns an error if it is of another model.
pub(super) fn recalled(levels: &[ContactNodes], history: &History) -> Result<NodalState> {
    let points = levels.iter().map(ContactNodes::len).sum();
    history.check(&levels[0].identity(), 0, points)?;
    if history.forces.len() != history.anchors.len() {
        let expected = format!("the forces at its {} anchors", history.anchors.len());
        return Err(Error::invalid("history", history.forces.len(), expected));
    }
    // Points are counted through all levels; those of a history are of one.
    let (mut level, mut first) = (levels.len() - 1, 0);
    if let Some(anchor) = history.anchors.first() {
        level = 0;
        while anchor.point >= first + levels[level].len() as u32 {
            first += levels[level].len() as u32;
            level += 1;
        }
    }
    let nodes = &levels[level];
    let of_level = |anchor: &Anchor| (first..first + nodes.len() as u32).contains(&anchor.point);
    if !history.anchors.iter().all(of_level) {
        return Err(Error::invalid("history", "anchors on several levels", "anchors on one"));
    }
    let held = |(anchor, force): (&Anchor, &Vector3<f64>)| Held {
        rank: anchor.point - first,
        shape: anchor.shape,
        stuck: anchor.place,
        force: *force,
        normal: Vector3::zeros(),
    };
    let mut held: Vec<_> = history.anchors.iter().zip(&history.forces).map(held).collect();
    held.sort_unstable_by_key(|held| held.rank);
    held.dedup_by_key(|held| held.rank);
    // A touching node is at the place where it sticks, apart from the compliance of the contact
    // law.
    let (mut amplitude, mut wrench) = (0f64, Wrench::default());
    for Held { rank, shape, stuck, force, .. } in &held {
        let place = history.poses[*shape as usize] * stuck;
        amplitude = amplitude.max((place - nodes.place(*rank)).norm());
        wrench.add_force(force, &place.coords);
    }
    Ok(NodalState { poses: history.poses.clone(), level, amplitude, held, wrench, sweeps: 0 })
}
