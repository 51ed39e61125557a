//! Solution of a press, frame by frame.

use std::time::Instant;

use nalgebra::{Isometry3, Point3, Vector3};

use super::{
    balance::norm,
    load_stepping::LoadStepping,
    push::{DrivenPress, push},
};
use crate::{
    Error, Result,
    contact::{between, clearance},
    deformation::{Deformation, Drive, History, Press},
    geometry::Shape,
};

/// Smallest part of a frame, or of an [`EDGE_STRIDE`], that is tried as a load step.
const SHORTEST_STRIDE: f64 = 1.0 / 64.0;
/// Greatest depth by which a shape with edges sinks in within one load step (m). In longer steps a
/// surface point may come nearer to the wrong face of an edge and be pushed out there.
pub(super) const EDGE_STRIDE: f64 = 2.5e-4;

impl LoadStepping<'_> {
    /// Solves every frame of `press` and returns the results of `report`; the first that fails is
    /// the last.
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

    /// Solves all frames of `press` and returns the result of `report` for the last.
    pub(super) fn last<T>(
        mut self,
        press: &Press,
        report: impl Fn(&mut Self) -> Result<T>,
    ) -> Result<T> {
        (0..count(press)).try_for_each(|frame| self.enter(press, frame))?;
        report(&mut self)
    }

    /// Solves the next `frame`.
    fn enter(&mut self, press: &Press, frame: usize) -> Result<()> {
        let start = Instant::now();
        match press.drive() {
            Drive::Translation { path } => self.follow(press.shapes(), &path[frame])?,
            Drive::Force { force, direction, .. } => {
                let mut led = DrivenPress { walk: self, shapes: press.shapes() };
                push(&mut led, *force, direction)?;
            }
        }
        self.seconds = start.elapsed().as_secs_f64();
        Ok(())
    }

    /// Moves the shapes to `poses`, through intermediate poses where a single step fails or would
    /// move an edge too far.
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

    /// Greatest motion of a shape with edges, measured at the middle of the zone (m).
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

    /// Current state as a [`Deformation`] without stress and residual, which cost more than the
    /// rest.
    pub(super) fn unstressed(&mut self) -> Deformation {
        let state = &self.state;
        let displacement = state.field.complete(&self.condensed.rest, &mut self.scratch.workspace);
        let history = History {
            displacement,
            poses: state.poses.clone(),
            anchors: state.anchors.clone(),
            forces: Vec::new(),
            folded: false,
        };
        Deformation {
            displacement: history.displacement.clone(),
            von_mises: Vec::new(),
            contact_force: state.contact_force.clone(),
            wrench: state.wrench,
            sliding: state.sliding,
            poses: history.poses.clone(),
            history,
            iterations: state.iterations,
            residual: 0.0,
            seconds: self.seconds,
            predicted_error: None,
        }
    }

    /// Current state as a [`Deformation`] without residual.
    pub(super) fn stressed(&mut self) -> Result<Deformation> {
        let start = Instant::now();
        let answer = self.unstressed();
        let von_mises = self.condensed.rest.von_mises(&answer.displacement);
        if !von_mises.iter().all(|stress| stress.is_finite()) {
            return Err(Error::Inverted);
        }
        let seconds = self.seconds + start.elapsed().as_secs_f64();
        Ok(Deformation { von_mises, seconds, ..answer })
    }

    /// Current state as a [`Deformation`].
    pub(super) fn report(&mut self) -> Result<Deformation> {
        let start = Instant::now();
        let answer = self.unstressed();
        let rest = &self.condensed.rest;
        let elastic = rest.elastic_force(&answer.displacement, &mut self.scratch.workspace);
        let mut left = elastic.ok_or(Error::Inverted)?;
        left.iter_mut().zip(&answer.contact_force).for_each(|(left, force)| *left -= force);
        rest.release(&mut left);
        Ok(Deformation {
            von_mises: rest.von_mises(&answer.displacement),
            residual: norm(&left),
            seconds: self.seconds + start.elapsed().as_secs_f64(),
            ..answer
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
    match shape {
        Shape::Sampled(sampled) => has_edges(sampled.exact()),
        Sphere { .. } | Ellipsoid { .. } | Capsule { .. } | StarShaped(_) | HalfSpace => false,
        _ => true,
    }
}
