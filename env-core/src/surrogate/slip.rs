//! Sliding share of a contact by corrected forces.
//!
//! Under a deep press linear elasticity pushes the gel aside too far, and cells seem to slide that
//! would stick. The network corrects the forces around each node of the face. Where their friction
//! falls well below that of the linear solution, cells that slide there are counted as sticking; not
//! so as far as the contact slides as a whole.

use nalgebra::{Point3, Vector3};

use super::linear::CellContact;

/// Friction of the corrected force over that of the linear one, each relative to its normal part,
/// below which cells stick, and above which they slide.
const RELIEF: [f64; 2] = [0.75, 0.95];

/// Returns the sliding share of the normal force: `linear`, that of the linear solution with its
/// contact on `cells`, with the corrected `forces` on the nodes of the face (N), which lie at
/// `places`.
pub(super) fn corrected(
    linear: f64,
    cells: &CellContact,
    places: &[Point3<f64>],
    forces: &[Vector3<f64>],
    friction: f64,
) -> f64 {
    if linear == 0.0 || friction == 0.0 {
        return linear;
    }
    let used = used(cells, places, friction);
    let [mut before, mut after] = [Share::default(); 2];
    for (node, contact) in cells.nodes.iter().filter(|(_, contact)| contact.borne > 0.0) {
        let normal = contact.normal.normalize();
        let [own, corrected] =
            [contact.force, forces[*node as usize]].map(|force| parts(&force, &normal));
        let slides = contact.sliding / contact.borne;
        before.add(own[0], slides);
        // At most the friction that it may have: tangential / normal against the linear solution's.
        let [low, high] = RELIEF.map(|part| part * own[1] * corrected[0]);
        let relieved = (high - corrected[1] * own[0]) / (high - low).max(f64::MIN_POSITIVE);
        after.add(corrected[0], slides * (1.0 - relieved.clamp(0.0, 1.0) * (1.0 - used)));
    }
    let [before, after] = [before, after].map(|share| share.mean());
    if before > 0.0 { (linear * after / before).min(1.0) } else { linear }
}

/// Normal force, at least 0, and size of the tangential force.
fn parts(force: &Vector3<f64>, normal: &Vector3<f64>) -> [f64; 2] {
    let pressing = force.dot(normal);
    [pressing.max(0.0), (force - pressing * normal).norm()]
}

/// Mean weighted by the normal force.
#[derive(Clone, Copy, Default)]
struct Share {
    all: f64,
    sliding: f64,
}

impl Share {
    fn add(&mut self, pressing: f64, slides: f64) {
        self.all += pressing;
        self.sliding += pressing * slides;
    }

    fn mean(&self) -> f64 {
        if self.all > 0.0 { self.sliding / self.all } else { 0.0 }
    }
}

/// Part of the friction of the whole contact that the linear solution uses: 0 where forces along
/// the face balance each other, 1 where all of it slides or turns about its normal. Greatest force
/// and greatest torque limit each other as the axes of an ellipse do (Howe and Cutkosky 1996).
fn used(cells: &CellContact, places: &[Point3<f64>], friction: f64) -> f64 {
    let nodes = cells.nodes.iter();
    let force: Vector3<f64> = nodes.clone().map(|(_, contact)| contact.force).sum();
    let normal: Vector3<f64> = nodes.clone().map(|(_, contact)| contact.normal).sum();
    let Some(normal) = normal.try_normalize(0.0) else { return 0.0 };
    let [pressing, along] = parts(&force, &normal);
    let pressed = nodes.map(|(node, contact)| {
        let pressing = contact.force.dot(&normal).max(0.0);
        (places[*node as usize].coords, contact.force, pressing)
    });
    let all: f64 = pressed.clone().map(|(.., pressing)| pressing).sum();
    if all <= 0.0 {
        return 0.0;
    }
    let middle: Vector3<f64> =
        pressed.clone().map(|(place, _, pressing)| place * pressing / all).sum();
    let [mut torque, mut most] = [0.0; 2];
    for (place, force, pressing) in pressed {
        let arm = place - middle;
        torque += arm.cross(&force).dot(&normal);
        most += friction * pressing * arm.cross(&normal).norm();
    }
    let share = |value: f64, most: f64| if most > 0.0 { value / most } else { 0.0 };
    share(along, friction * pressing).hypot(share(torque, most)).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compliance::nodal::NodeContact;

    const FRICTION: f64 = 0.5;
    const PLACES: [[f64; 2]; 4] = [[1e-3, 0.0], [0.0, 1e-3], [-1e-3, 0.0], [0.0, -1e-3]];

    /// Four nodes around the middle of a face, each pressed by 1 N along −z; on the first two cells
    /// slide. Their friction, along the given directions, is at its limit.
    fn contact(directions: [[f64; 2]; 4]) -> (CellContact, Vec<Point3<f64>>) {
        let slides = [1.0, 1.0, 0.0, 0.0];
        let normal = -Vector3::z();
        let node = |([x, y], slides): ([f64; 2], f64)| {
            let force = normal + FRICTION * Vector3::new(x, y, 0.0);
            let borne = force.norm();
            let normal = normal * borne;
            NodeContact { force, borne, normal, sliding: slides * borne, ..NodeContact::default() }
        };
        let nodes = (0..).zip(directions.into_iter().zip(slides).map(node)).collect();
        let places = PLACES.map(|[x, y]| Point3::new(x, y, 0.0)).to_vec();
        (CellContact { nodes, spacing: 1e-3 }, places)
    }

    /// Share of four nodes of which half slides, where friction along the face is multiplied by
    /// `factor` and the normal force of the nodes on which cells slide by `pressing`.
    fn found(directions: [[f64; 2]; 4], factor: f64, pressing: f64) -> f64 {
        let (cells, places) = contact(directions);
        let forces = cells.nodes.iter().map(|(node, contact)| {
            let pressing = if *node < 2 { pressing } else { 1.0 };
            let along = factor * pressing;
            contact.force.component_mul(&Vector3::new(along, along, pressing))
        });
        corrected(0.5, &cells, &places, &forces.collect::<Vec<_>>(), FRICTION)
    }

    #[test]
    fn cells_stick_where_corrected_friction_is_below_its_limit() {
        let outwards = PLACES.map(|place| place.map(|x| 1e3 * x));
        for (factor, expected) in [(1.0, 0.5), (1.2, 0.5), (0.96, 0.5), (0.85, 0.25), (0.7, 0.0)] {
            let share = found(outwards, factor, 1.0);
            assert!((share - expected).abs() < 1e-12, "{share} where {factor} of friction is left");
        }
        // Where the nodes that slide bear a third of the force.
        assert!((found(outwards, 1.0, 0.5) - 1.0 / 3.0).abs() < 1e-12);
        assert_eq!(found(outwards, 1.0, 0.0), 0.0);
    }

    #[test]
    fn what_slides_or_turns_as_a_whole_slides() {
        let [dragged, turned] = [[[1.0, 0.0]; 4], PLACES.map(|[x, y]| [-1e3 * y, 1e3 * x])];
        assert!((found(dragged, 0.6, 1.0) - 0.5).abs() < 1e-12);
        assert!((found(turned, 0.6, 1.0) - 0.5).abs() < 1e-12);
        // Friction of the first and the third balances that of the others: half of it pulls.
        let half = [[1.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [1.0, 0.0]];
        let share = found(half, 0.6, 1.0);
        assert!(share > 0.2 && share < 0.45, "{share}");
    }
}
