//! Selection of the facets that the shapes may touch.
//!
//! Shapes: F facets, S rigid shapes, V nodes.

use nalgebra::{Isometry3, Point3, Vector3};

use super::condensed::{Condensed, SkinFacet};
use crate::geometry::Shape;

/// Ball round the points of a displaced facet.
#[derive(Clone, Copy)]
pub(super) struct Bound {
    centre: Point3<f64>,
    radius: f64,
}

/// Bounds of all facets with the nodes displaced (V) in m.
pub(super) fn bounds(condensed: &Condensed, displacement: &[Vector3<f64>]) -> Vec<Bound> {
    let bound = |facet: &SkinFacet| {
        let moved = || facet.nodes.iter().map(|&node| displacement[node as usize]);
        let mean = moved().sum::<Vector3<f64>>() / facet.nodes.len() as f64;
        let spread = moved().map(|u| (u - mean).norm_squared()).fold(0.0, f64::max).sqrt();
        Bound { centre: facet.centre + mean, radius: facet.radius + facet.gain * spread }
    };
    condensed.facets.iter().map(bound).collect()
}

/// Distances of the facets from the shapes, measured only where needed.
#[derive(Default)]
pub(super) struct Reach {
    /// Last measured position of each centre in the frame of the shape, and its distance (S × F) in
    /// m.
    seen: Vec<(Point3<f64>, f64)>,
}

impl Reach {
    /// Returns for each facet whether a shape may touch it or come within `margin` (m) of it.
    pub(super) fn reached(
        &mut self,
        shapes: &[Shape],
        poses: &[Isometry3<f64>],
        bounds: &[Bound],
        margin: f64,
    ) -> Vec<bool> {
        let never = (Point3::origin(), f64::NAN);
        self.seen.resize(shapes.len() * bounds.len(), never);
        let mut reached = vec![false; bounds.len()];
        let seen = self.seen.chunks_mut(bounds.len().max(1));
        for ((shape, pose), seen) in shapes.iter().zip(poses).zip(seen) {
            for ((bound, seen), reached) in bounds.iter().zip(seen).zip(&mut reached) {
                let centre = pose.inverse_transform_point(&bound.centre);
                *reached |= is_nearer(shape, seen, centre, bound.radius + margin);
            }
        }
        reached
    }
}

/// Returns whether a `point` in the frame of `shape` is nearer than `reach`. A distance changes no
/// faster than the point moves, so it is measured only where the last measurement `seen` does not
/// decide.
fn is_nearer(shape: &Shape, seen: &mut (Point3<f64>, f64), point: Point3<f64>, reach: f64) -> bool {
    let moved = (point - seen.0).norm();
    if seen.1 - moved >= reach {
        return false;
    }
    if seen.1 + moved < reach {
        return true;
    }
    *seen = (point, shape.distance(&point).value);
    seen.1 < reach
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_seen_before_does_not_change_what_is_reached() {
        let shapes = [
            Shape::Sphere { radius: 0.01 },
            Shape::Cuboid { half_extents: Vector3::repeat(0.004) },
        ];
        let place = |i: i32, j: i32| Point3::new(2e-3 * f64::from(i), 1e-3 * f64::from(j), 0.0);
        let bounds: Vec<_> = (-10..=10)
            .flat_map(|i| (-10..=10).map(move |j| Bound { centre: place(i, j), radius: 1e-3 }))
            .collect();
        let mut reach = Reach::default();
        for i in 0..100 {
            let angle = 0.1 * f64::from(i);
            let pose = |z: f64| Isometry3::translation(0.02 * angle.sin(), 0.01 * angle.cos(), z);
            let poses = [pose(0.009), pose(-0.003)];
            let found = reach.reached(&shapes, &poses, &bounds, 1e-4);
            assert_eq!(found, Reach::default().reached(&shapes, &poses, &bounds, 1e-4), "step {i}");
            assert!(found.contains(&true) && found.contains(&false), "step {i} tells nothing");
        }
    }
}
