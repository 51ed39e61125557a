//! Solution of a press, frame by frame.

use std::time::Instant;

use nalgebra::{Isometry3, Point3, Vector3};

use super::{
    balance::norm,
    load_stepping::{EDGE_STEP, LoadStepping},
    push::push,
};
use crate::{
    Error, Result,
    contact::{between, clearance},
    deformation::{
        Deformation, FrameDrive, History, NextStep, Press, solve_frames, solve_in_steps,
    },
};

/// Smallest part of a frame, or of an [`EDGE_STEP`], that is tried as a load step.
const SHORTEST: f64 = 1.0 / 64.0;

impl LoadStepping<'_> {
    /// Solves every frame of `press` and returns the results of `report`; the first that fails is
    /// the last.
    pub(super) fn every<T>(
        mut self,
        press: &Press,
        report: impl Fn(&mut Self) -> Result<T>,
    ) -> Vec<Result<T>> {
        solve_frames(press.frames(), |frame| {
            self.solve(press, frame)?;
            report(&mut self)
        })
    }

    /// Solves all frames of `press` and returns the result of `report` for the last.
    pub(super) fn last<T>(
        mut self,
        press: &Press,
        report: impl Fn(&mut Self) -> Result<T>,
    ) -> Result<T> {
        solve_frames(press.frames(), |frame| self.solve(press, frame))
            .pop()
            .expect("a press has a frame")?;
        report(&mut self)
    }

    /// Solves the next `frame` of `press`.
    fn solve(&mut self, press: &Press, frame: FrameDrive) -> Result<()> {
        let start = Instant::now();
        match frame {
            FrameDrive::Poses(poses) => self.follow(poses)?,
            FrameDrive::Force { force, direction } => push(self, force, direction)?,
        }
        self.check_skin(press)?;
        self.seconds = start.elapsed().as_secs_f64();
        Ok(())
    }

    /// Moves the shapes to `poses`, through intermediate poses where a single step fails or would
    /// move an edge too far.
    fn follow(&mut self, poses: &[Isometry3<f64>]) -> Result<()> {
        let from = self.state.poses.clone();
        self.cover(poses);
        let motion = self.motion(&from, poses);
        let length = |stepping: &Self, step: &mut NextStep| {
            if step.size * motion > EDGE_STEP {
                let (shapes, poses) = (stepping.shapes, &stepping.state.poses);
                let gap = clearance(shapes, poses, &stepping.zone_places()).max(0.0);
                step.size = f64::min(step.size, (gap + EDGE_STEP) / motion);
            }
            step.size
        };
        let shortest = SHORTEST * f64::min(1.0, EDGE_STEP / motion);
        let retry = |_: &Self, _: &Error, step: NextStep| step.size >= shortest;
        let mut iterations = 0;
        solve_in_steps(self, length, retry, |stepping, t| {
            stepping.state = stepping.attempt(&between(&from, poses, t))?;
            iterations += stepping.state.iterations;
            Ok(())
        })?;
        self.state.iterations = iterations;
        Ok(())
    }

    /// Greatest motion of a shape with edges, measured at the middle of the zone (m).
    fn motion(&self, from: &[Isometry3<f64>], to: &[Isometry3<f64>]) -> f64 {
        let count = self.zone.places.len().max(1) as f64;
        let middle =
            self.zone.places.iter().map(|place| place.coords).sum::<Vector3<f64>>() / count;
        let middle = Point3::from(middle);
        let poses = self.shapes.iter().zip(from.iter().zip(to));
        let poses = poses.filter(|(shape, _)| shape.has_edges());
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
            model: self.condensed.identity,
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
