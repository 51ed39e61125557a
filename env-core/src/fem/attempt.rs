//! One load step of a press: its contact region, its initial guess, its solution and its checks.

use nalgebra::{Isometry3, Point3, Vector3};

use super::{
    direct::DirectSolver,
    drive::{ConvergedStep, PressSolver},
    newton::equilibrium,
    push::ForceControl,
    region::Region,
    system::{Configuration, Stiffness},
};
use crate::{
    Error, Result,
    contact::{ContactStep, Touch, engulfs_unfelt},
    deformation::Anchor,
    error::StepDefect,
    geometry::Shape,
    interrupt,
};

/// A solved load step that has not been accepted yet.
pub(super) struct LoadStep {
    pub(super) state: Configuration,
    anchors: Vec<Anchor>,
    pub(super) solved: ConvergedStep,
}

impl PressSolver<'_> {
    /// Attempts one load step to `poses`, or from there on under `push`, and returns the state it
    /// ends in. The search starts from the displacements `guess`; without them from a prediction,
    /// or under a push from the present ones.
    pub(super) fn attempt(
        &mut self,
        shapes: &[Shape],
        poses: Vec<Isometry3<f64>>,
        push: Option<&ForceControl>,
        guess: Option<Vec<Vector3<f64>>>,
    ) -> Result<LoadStep> {
        interrupt::check()?;
        let system = self.system;
        let start = system.surface_places(&self.state.displacement);
        let from = self.state.poses.clone();
        let places = start.clone();
        let mut contact = ContactStep::new(shapes, &system.surface, from, start, &self.anchors)
            .with_seen(self.state.displacement.clone(), std::mem::take(&mut self.seen));
        contact.one_sided = self.one_sided;
        if contact.runs_over(&poses, system.law.deep()) {
            return Err(Error::StepTooLong { defect: StepDefect::PassedSurface });
        }
        self.attend(&mut contact, shapes, &poses, push.is_some(), &places);
        let mut state = Configuration { displacement: self.state.displacement.clone(), poses };
        match guess {
            Some(guess) => state.displacement = guess,
            None if push.is_none() => self.predict(shapes, &mut state, &mut contact),
            None => {}
        }
        let solver = self.solver.as_mut().expect("the run attends to a region");
        let (balance, forces) =
            equilibrium(system, solver, &mut state, &mut contact, push, &self.limits)?;
        let places = system.surface_places(&state.displacement);
        if contact.goes_through(&state.poses, &places, system.law.deep()) {
            return Err(Error::StepTooLong { defect: StepDefect::PassedSurface });
        }
        let felt = |s| forces.touches.iter().any(|touch| touch.shape == s);
        if engulfs_unfelt(shapes, &state.poses, felt, self.mesh, &state.displacement) {
            return Err(Error::StepTooLong { defect: StepDefect::Engulfed });
        }
        system.backing.check(shapes, [&self.state.poses, &state.poses], system.law.deep())?;
        let depth = forces.touches.iter().map(|touch| touch.depth).fold(0.0, f64::max);
        let most = system.refused();
        if depth > most {
            return Err(Error::Penetrated { depth, most });
        }
        let back =
            |touch: &Touch| system.law.stuck_at(&system.surface[touch.point as usize], touch);
        let anchors = contact.anchors(&state.poses, &forces.touches, back);
        self.seen = contact.into_seen();
        Ok(LoadStep { state, anchors, solved: ConvergedStep { balance, forces } })
    }

    /// Chooses the region in which contact is evaluated during the motion to `poses`, with the
    /// surface at `places` (C): the whole surface if `pushed`, as the travel is not known.
    fn attend(
        &mut self,
        contact: &mut ContactStep,
        shapes: &[Shape],
        poses: &[Isometry3<f64>],
        pushed: bool,
        places: &[Point3<f64>],
    ) {
        let everywhere = match &self.solver {
            Some(solver) => match solver.region() {
                Some(region) if !pushed && region.suits(contact, poses, places) => return,
                region => region.is_none(),
            },
            None => false,
        };
        let path = || [&[poses.to_vec()], &self.ahead[..]].concat();
        let along = |path: Vec<_>| Region::along(self.system, shapes, &path, places);
        let region = if pushed || self.limits.plain { None } else { along(path()) };
        if !everywhere || region.is_some() {
            self.solver = Some(DirectSolver::new(self.system, region));
        }
    }

    /// Makes an attempt the current state.
    pub(super) fn accept(&mut self, attempt: LoadStep) -> ConvergedStep {
        let LoadStep { state, anchors, solved } = attempt;
        self.anchors = anchors;
        let moved = state.displacement.iter().zip(&self.state.displacement);
        self.increment = moved.map(|(after, before)| after - before).collect();
        self.before.clone_from(&self.state.poses);
        self.held = self.wrench(&solved.forces).force;
        self.state = state;
        solved
    }

    /// Predicts `state`: by the increment of the last load step if the shapes continue their
    /// motion, else along the path's tangent at the beginning.
    fn predict(&mut self, shapes: &[Shape], state: &mut Configuration, contact: &mut ContactStep) {
        let step = if self.goes_on(&state.poses) {
            Some(self.increment.clone())
        } else {
            self.tangent(shapes, &state.poses)
        };
        let Some(step) = step else { return };
        let ahead = self.state.displacement.iter().zip(&step).map(|(u, du)| u + du).collect();
        let ahead = Configuration { displacement: ahead, poses: state.poses.clone() };
        if self.system.forces(&ahead, contact).is_some() {
            *state = ahead;
        }
    }

    /// Returns whether the motion to `poses` is about the same as that of the last load step.
    fn goes_on(&self, poses: &[Isometry3<f64>]) -> bool {
        let motions = poses.iter().zip(&self.state.poses).zip(&self.before);
        self.before.len() == poses.len()
            && motions.into_iter().all(|((next, now), before)| {
                let motion = |to: &Isometry3<f64>, from: &Isometry3<f64>| {
                    (to.translation.vector - from.translation.vector, to.rotation / from.rotation)
                };
                let (next, last) = (motion(next, now), motion(now, before));
                let turn = (next.1 / last.1).angle();
                (next.0 - last.0).norm() <= 0.5 * next.0.norm() && turn <= 0.5 * next.1.angle()
            })
    }

    /// Change of displacement for small motions of the shapes towards `poses`, with all touching
    /// points taken along; `None` if nothing touches.
    fn tangent(&mut self, shapes: &[Shape], poses: &[Isometry3<f64>]) -> Option<Vec<Vector3<f64>>> {
        let (system, now) = (self.system, &self.state);
        let start = system.surface_places(&now.displacement);
        let from = now.poses.clone();
        let mut rest = ContactStep::new(shapes, &system.surface, from, start, &self.anchors);
        let mut forces = system.forces(now, &mut rest)?;
        if forces.touches.is_empty() {
            return None;
        }
        let mut pull = vec![Vector3::zeros(); forces.gradient.len()];
        for touch in &mut forces.touches {
            touch.slip = Vector3::zeros();
            let shape = touch.shape as usize;
            let moved = poses[shape] * now.poses[shape].inverse_transform_point(&touch.place);
            let force = system.contact_stiffness(touch) * (moved - touch.place);
            system.surface[touch.point as usize].spread(&force, &mut pull);
        }
        let solver = self.solver.as_mut()?;
        solver.make_hold(system, &forces.touches);
        if !solver.factorise(system, &forces, Stiffness::Exact) {
            return None;
        }
        let mut step = solver.gather(&pull);
        solver.solve(&mut step);
        Some(solver.scatter(&step))
    }
}
