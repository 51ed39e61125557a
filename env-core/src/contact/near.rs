//! Which points can touch at all: a distance changes no faster than the point moves.
//!
//! Shapes: C surface points, N nodes, S rigid shapes; pairs are numbered shape by shape (S × C).

use nalgebra::{Isometry3, Point3, Vector3};

use super::{ContactStep, SurfacePoint, Touch};

/// Room in which it does not matter how much of it there is (m).
pub(super) const SURE: f64 = 1e-3;

/// Where pairs of shape and point were last measured, and their distances.
#[derive(Clone, Debug, Default)]
pub struct Seen(Vec<(Point3<f64>, f64)>);

impl ContactStep<'_> {
    /// With the nodes' displacement at the beginning (N) and what an earlier step of the same shapes and
    /// points has `seen`: both spare measurements.
    #[must_use]
    pub fn knowing(mut self, origin: Vec<Vector3<f64>>, seen: Seen) -> Self {
        self.origin = origin;
        if seen.0.len() == self.seen.len() {
            self.seen = seen.0;
        }
        self
    }

    /// What was measured, for the next step.
    pub fn into_seen(self) -> Seen {
        Seen(self.seen)
    }

    /// As [`ContactStep::touches`], when the nodes are displaced (N) from their places at rest (N).
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

    /// How far a surface point may have gone from its beginning (m).
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

    /// Points that may be inside a shape at `poses` after a motion of `reach` (m).
    pub fn near(&self, poses: &[Isometry3<f64>], reach: f64) -> Vec<u32> {
        let points = self.surface.len();
        let mut near = vec![false; points];
        for (s, pose) in poses.iter().enumerate() {
            let reach = reach + self.way(s, pose);
            for (near, room) in near.iter_mut().zip(&self.room[s * points..]) {
                *near |= *room <= reach;
            }
        }
        (0u32..).zip(near).filter(|(_, near)| *near).map(|(c, _)| c).collect()
    }

    /// How far the farthest point of the surface goes in the frame of shape `s` on its way to `pose` (m),
    /// at most.
    fn way(&self, s: usize, pose: &Isometry3<f64>) -> f64 {
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

    /// Which of the `points`, at `places`, are within `margin` (m) of a shape at its pose.
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
        // A row of points under a ball that comes down and aside while the points give way.
        let rest: Vec<_> = (0..60).map(|i| Point3::new(2e-4 * f64::from(i), 0.0, 0.0)).collect();
        let point = |node| SurfacePoint { shares: vec![(node, 1.0)], area: 1e-8, young: 1e5 };
        let (surface, shapes) =
            ((0..60).map(point).collect::<Vec<_>>(), [Shape::Sphere { radius: 4e-3 }]);
        let pose = |t: f64| vec![Isometry3::translation(6e-3 * t, 0.0, 4.1e-3 - 5e-4 * t)];
        let bent = |t: f64| -> Vec<_> {
            rest.iter().map(|p| Vector3::z() * (-1e-4 * t * (500.0 * p.x).sin().abs())).collect()
        };
        let (mut seen, mut most) = (Seen::default(), 0);
        for i in 0..20 {
            let [from, to] = [f64::from(i), f64::from(i + 1)].map(|t| 0.05 * t);
            let places =
                |u: &[Vector3<f64>]| rest.iter().zip(u).map(|(p, u)| p + u).collect::<Vec<_>>();
            let step = || ContactStep::new(&shapes, &surface, pose(from), places(&bent(from)), &[]);
            let mut step_knowing = step().knowing(bent(from), seen);
            step_knowing.runs_over(&pose(to), 1e-3);
            let quick = step_knowing.touches_displaced(&pose(to), &rest, &bent(to));
            let all = step().touches(&pose(to), &places(&bent(to)));
            assert_eq!(quick, all, "step {i}");
            most = most.max(all.len());
            seen = step_knowing.into_seen();
        }
        assert!((5..40).contains(&most), "{most} points touched at most");
    }
}
