//! Frames of a press, one after the other.

use std::time::Instant;

use nalgebra::{Isometry3, Point3, Vector3};

use super::{balance::norm, push::push, walk::Walk};
use crate::{
    Error, Result,
    contact::{between, clearance},
    deformation::{Deformation, Drive, History, Press},
    geometry::Shape,
};

/// Smallest part of a frame, or of an [`EDGE_STRIDE`], that is tried as a load step of its own.
const SHORTEST_STRIDE: f64 = 1.0 / 64.0;
/// Farthest that a shape with edges sinks in within one load step (m): a point of the surface that is
/// nearer to the wrong face of an edge would be pushed out there.
pub(super) const EDGE_STRIDE: f64 = 2.5e-4;

impl Walk<'_> {
    /// What `report` says of every frame of `press`; the first that fails is the last.
    pub(super) fn every<T>(
        mut self,
        press: &Press,
        report: impl Fn(&mut Self) -> Result<T>,
    ) -> Vec<Result<T>> {
        let mut frames = Vec::new();
        for frame in 0..count(press) {
            frames.push(self.enter(press, frame).and_then(|()| report(&mut self)));
            if frames.last().is_some_and(Result::is_err) {
                break;
            }
        }
        frames
    }

    /// The last frame of `press`.
    pub(super) fn last(mut self, press: &Press) -> Result<Deformation> {
        (0..count(press)).try_for_each(|frame| self.enter(press, frame))?;
        self.report()
    }

    /// Goes on to a frame.
    fn enter(&mut self, press: &Press, frame: usize) -> Result<()> {
        let start = Instant::now();
        match press.drive() {
            Drive::Translation { path } => self.follow(press.shapes(), &path[frame])?,
            Drive::Force { force, direction, .. } => {
                push(self, press.shapes(), *force, direction)?;
            }
        }
        self.seconds = start.elapsed().as_secs_f64();
        Ok(())
    }

    /// Leads the shapes to `poses`, by way of poses between where the whole way at once fails or
    /// would take an edge too far.
    fn follow(&mut self, shapes: &[Shape], poses: &[Isometry3<f64>]) -> Result<()> {
        let from = self.state.poses.clone();
        self.cover(shapes, poses);
        let motion = self.motion(shapes, &from, poses);
        let shortest = SHORTEST_STRIDE * f64::min(1.0, EDGE_STRIDE / motion);
        let (mut done, mut stride, mut iterations) = (0.0, 1.0, 0);
        while done < 1.0 {
            if stride * motion > EDGE_STRIDE {
                let gap = clearance(shapes, &self.state.poses, &self.zone_places()).max(0.0);
                stride = f64::min(stride, (gap + EDGE_STRIDE) / motion);
            }
            let next = f64::min(done + stride, 1.0);
            match self.attempt(shapes, &between(&from, poses, next)) {
                Ok(state) => {
                    iterations += state.iterations;
                    self.state = state;
                    done = next;
                    stride *= 2.0;
                }
                Err(error) => {
                    stride *= 0.5;
                    if stride < shortest {
                        return Err(error);
                    }
                }
            }
        }
        self.state.iterations = iterations;
        Ok(())
    }

    /// How far shapes with edges move, as seen in the middle of the zone (m).
    fn motion(&self, shapes: &[Shape], from: &[Isometry3<f64>], to: &[Isometry3<f64>]) -> f64 {
        let count = self.zone.places.len().max(1) as f64;
        let middle =
            self.zone.places.iter().map(|place| place.coords).sum::<Vector3<f64>>() / count;
        let middle = Point3::from(middle);
        let poses = shapes.iter().zip(from.iter().zip(to)).filter(|(shape, _)| has_edges(shape));
        let moved = poses
            .map(|(_, (from, to))| (to * from.inverse_transform_point(&middle) - middle).norm());
        moved.fold(0.0, f64::max)
    }

    /// The current state, seen from outside.
    pub(super) fn report(&mut self) -> Result<Deformation> {
        let start = Instant::now();
        let (rest, state) = (&self.condensed.rest, &mut self.state);
        if self.settings.sweeps == 0 {
            state.field.complete(rest, &mut self.workspace);
        }
        let displacement = &state.field.displacement;
        let elastic = rest.elastic_force(displacement, &mut self.workspace);
        let mut left = elastic.ok_or(Error::Inverted)?;
        left.iter_mut().zip(&state.contact_force).for_each(|(left, force)| *left -= force);
        rest.release(&mut left);
        let residual = norm(&left);
        Ok(Deformation {
            von_mises: rest.von_mises(displacement),
            displacement: displacement.clone(),
            contact_force: state.contact_force.clone(),
            wrench: state.wrench,
            poses: state.poses.clone(),
            history: History {
                displacement: displacement.clone(),
                poses: state.poses.clone(),
                anchors: state.anchors.clone(),
            },
            iterations: state.iterations,
            residual,
            seconds: self.seconds + start.elapsed().as_secs_f64(),
        })
    }
}

fn count(press: &Press) -> usize {
    match press.drive() {
        Drive::Translation { path } => path.len(),
        Drive::Force { .. } => 1,
    }
}

fn has_edges(shape: &Shape) -> bool {
    use Shape::{Capsule, Ellipsoid, HalfSpace, Sphere, StarShaped};
    !matches!(shape, Sphere { .. } | Ellipsoid { .. } | Capsule { .. } | StarShaped(_) | HalfSpace)
}
