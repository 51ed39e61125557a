//! Selection of the points that can touch at all: a distance changes no faster than the point
//! moves.
//!
//! Shapes: C surface points, N nodes, S rigid shapes; pairs are numbered shape by shape (S × C).

use nalgebra::{Isometry3, Point3, Vector3};

use super::{ContactStep, SurfacePoint, Touch};

/// Clearance above which the exact distance of a pair is not needed (m).
pub(super) const SURE: f64 = 1e-3;

/// Last measured position of every pair of shape and point, in the frame of the shape, and the
/// distance there (m).
#[derive(Clone, Debug, Default)]
pub struct DistanceCache(Vec<(Point3<f64>, f64)>);

impl ContactStep<'_> {
    /// Sets the nodes' displacement at the beginning of the step (N) and the distances `seen` in an
    /// earlier step of the same shapes and points. Both save measurements of distances.
    #[must_use]
    pub fn with_seen(mut self, origin: Vec<Vector3<f64>>, seen: DistanceCache) -> Self {
        self.origin = origin;
        if seen.0.len() == self.seen.len() {
            self.seen = seen.0;
        }
        self
    }

    /// Returns the measured distances, for the next step.
    pub fn into_seen(self) -> DistanceCache {
        DistanceCache(self.seen)
    }

    /// Returns [`ContactStep::touches`] for nodes displaced (N) from their positions at rest (N).
    pub fn touches_displaced(
        &mut self,
        poses: &[Isometry3<f64>],
        rest: &[Point3<f64>],
        displacement: &[Vector3<f64>],
    ) -> Vec<Touch> {
        let surface = self.surface;
        let near = self.near(poses, self.reach(displacement));
        let places: Vec<_> =
            near.iter().map(|&c| surface[c as usize].place(rest, displacement)).collect();
        self.touches_among(&near, poses, &places)
    }

    /// Upper bound of the motion of the surface points since the beginning of the step (m).
    fn reach(&self, displacement: &[Vector3<f64>]) -> f64 {
        if self.origin.len() != displacement.len() {
            return f64::INFINITY;
        }
        let moved =
            displacement.iter().zip(&self.origin).map(|(u, from)| (u - from).norm_squared());
        let weight = |point: &SurfacePoint| point.shares.iter().map(|(_, share)| share.abs()).sum();
        let most = self.surface.iter().map(weight).fold(1.0, f64::max);
        most * moved.fold(0.0, f64::max).sqrt()
    }

    /// Points that may be inside a shape at `poses` after a motion of at most `reach` (m).
    pub fn near(&self, poses: &[Isometry3<f64>], reach: f64) -> Vec<u32> {
        let points = self.surface.len();
        let mut near = vec![false; points];
        for (s, pose) in poses.iter().enumerate() {
            let reach = reach + self.motion(s, pose);
            for (near, room) in near.iter_mut().zip(&self.room[s * points..]) {
                *near |= *room <= reach;
            }
        }
        (0u32..).zip(near).filter(|(_, near)| *near).map(|(c, _)| c).collect()
    }

    /// Upper bound of the motion of the surface points in the frame of shape `s` as the shape moves
    /// to `pose` (m).
    fn motion(&self, s: usize, pose: &Isometry3<f64>) -> f64 {
        let from = &self.from[s];
        let shift = (pose.translation.vector - from.translation.vector).norm();
        let angle = from.rotation.angle_to(&pose.rotation);
        if angle == 0.0 {
            return shift;
        }
        let middle = from.translation.vector;
        let far = self.start.iter().map(|p| (p.coords - middle).norm_squared());
        shift + angle * far.fold(0.0, f64::max).sqrt()
    }

    /// Returns for each of the `points`, at `places`, whether it is within `margin` (m) of a shape.
    pub fn within(
        &mut self,
        margin: f64,
        points: &[u32],
        poses: &[Isometry3<f64>],
        places: &[Point3<f64>],
    ) -> Vec<bool> {
        let mut near = vec![false; points.len()];
        for (s, pose) in poses.iter().enumerate() {
            for ((near, &c), place) in near.iter_mut().zip(points).zip(places) {
                let local = pose.inverse_transform_point(place);
                let seen = &mut self.seen[s * self.surface.len() + c as usize];
                if (local - seen.0).norm() >= seen.1 - margin {
                    *seen = (local, self.shapes[s].distance(&local).value);
                    *near |= seen.1 < margin;
                }
            }
        }
        near
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;

    #[test]
    fn no_touch_is_missed_by_looking_at_what_is_near() {
        // A row of points under a ball that moves down and sideways while the points move down.
        let rest: Vec<_> = (0..60).map(|i| Point3::new(2e-4 * f64::from(i), 0.0, 0.0)).collect();
        let point = |node| SurfacePoint { shares: vec![(node, 1.0)], area: 1e-8, young: 1e5 };
        let (surface, shapes) =
            ((0..60).map(point).collect::<Vec<_>>(), [Shape::Sphere { radius: 4e-3 }]);
        let pose = |t: f64| vec![Isometry3::translation(6e-3 * t, 0.0, 4.1e-3 - 5e-4 * t)];
        let bent = |t: f64| -> Vec<_> {
            rest.iter().map(|p| Vector3::z() * (-1e-4 * t * (500.0 * p.x).sin().abs())).collect()
        };
        let (mut seen, mut most) = (DistanceCache::default(), 0);
        for i in 0..20 {
            let [from, to] = [f64::from(i), f64::from(i + 1)].map(|t| 0.05 * t);
            let places =
                |u: &[Vector3<f64>]| rest.iter().zip(u).map(|(p, u)| p + u).collect::<Vec<_>>();
            let step = || ContactStep::new(&shapes, &surface, pose(from), places(&bent(from)), &[]);
            let mut step_with_seen = step().with_seen(bent(from), seen);
            step_with_seen.runs_over(&pose(to), 1e-3);
            let quick = step_with_seen.touches_displaced(&pose(to), &rest, &bent(to));
            let all = step().touches(&pose(to), &places(&bent(to)));
            assert_eq!(quick, all, "step {i}");
            most = most.max(all.len());
            seen = step_with_seen.into_seen();
        }
        assert!((5..40).contains(&most), "{most} points touched at most");
    }
}
