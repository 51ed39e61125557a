//! State in which a press begins: with the shapes outside of the body, or as a history left it.

use std::slice;

use nalgebra::{Isometry3, Point3, Vector3};

use super::{
    contact_nodes::ContactNodes,
    load_stepping::{Held, NodalState},
};
use crate::{
    Error, Result,
    contact::backed_off,
    deformation::{Anchor, History, Wrench},
    geometry::Shape,
};

/// Number of first cells in a shape from which they tell where it came from.
const TELLING: usize = 4;
/// Depth of the cells in a shape (m), and the same relative to its thickness, up to which the
/// first cells need not tell.
const SUNK: [f64; 2] = [1e-4, 0.25];
/// Largest number of times that the lift of a shape is doubled.
const DOUBLED: usize = 20;

/// Returns the `first` poses with each shape that overlaps the body at rest moved out of it, to where
/// it is taken to come from.
pub(super) fn outside(
    levels: &[ContactNodes],
    shapes: &[Shape],
    first: &[Isometry3<f64>],
) -> Vec<Isometry3<f64>> {
    let (nodes, mesh) = (&levels[0], levels[0].condensed.body.mesh());
    let start = |(shape, pose): (&Shape, &Isometry3<f64>)| {
        lifted(levels, shape, pose).unwrap_or_else(|| {
            let (shape, pose) = (slice::from_ref(shape), slice::from_ref(pose));
            backed_off(shape, pose, &nodes.points, &nodes.places, mesh)[0]
        })
    };
    shapes.iter().zip(first).map(start).collect()
}

/// Moves a shape that has sunk into a pad between the cells of the first grid out along z; `None`
/// if it has not.
fn lifted(levels: &[ContactNodes], shape: &Shape, pose: &Isometry3<f64>) -> Option<Isometry3<f64>> {
    let finest = levels.last()?.grid()?;
    let holds =
        |place: &&Point3<f64>| shape.distance(&pose.inverse_transform_point(place)).value < 0.0;
    if levels[0].places.iter().filter(holds).take(TELLING).count() == TELLING {
        return None;
    }
    let depth = |pose: Isometry3<f64>| -finest.clearance(slice::from_ref(shape), &[pose]);
    let mut step = depth(*pose);
    if step <= f64::min(SUNK[0], SUNK[1] * shape.thickness()) {
        return None;
    }
    let mut lifted = *pose;
    for _ in 0..DOUBLED {
        lifted.translation.vector.z += step;
        step *= 2.0;
        if depth(lifted) <= 0.0 {
            break;
        }
    }
    Some(lifted)
}

/// Restores the state of a `history`; returns an error if it is of another model.
pub(super) fn recalled(levels: &[ContactNodes], history: &History) -> Result<NodalState> {
    history.check(0, levels.iter().map(ContactNodes::len).sum())?;
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
        wrench.force += force;
        wrench.torque += place.coords.cross(force);
    }
    Ok(NodalState { poses: history.poses.clone(), level, amplitude, held, wrench, sweeps: 0 })
}
