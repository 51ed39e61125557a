//! Presses frame by frame: load steps, their subdivision, and force control.

use std::time::Instant;

use nalgebra::{Isometry3, Vector3};

use super::{
    direct::DirectSolver,
    newton::{NewtonOutcome, StoppingCriteria},
    push::ForceControl,
    system::{Configuration, Forces, System},
};
use crate::{
    Error, Result,
    contact::{
        DeformedSkin, DistanceCache, Touch, advance_to_contact, backed_off, between, clearance,
    },
    deformation::{
        Anchor, Deformation, Drive, FrameDrive, History, NextStep, Press, Wrench, solve_frames,
        solve_in_steps,
    },
    geometry::TetMesh,
};

/// Smallest part of a motion that is tried as a load step.
pub(super) const SHORTEST: f64 = 1.0 / 256.0;
/// Least increase of a push in one step, as a share of the force already reached, and its lower
/// bound as a share of the force asked for.
const LEAST_GAIN: f64 = 1.0 / 16.0;
const LEAST_PUSH: f64 = 1e-6;

/// One press being solved: workspace and current state.
pub(super) struct PressSolver<'a> {
    pub(super) system: &'a System,
    pub(super) mesh: &'a TetMesh,
    pub(super) limits: StoppingCriteria,
    /// Distances measured in the last load step.
    pub(super) seen: DistanceCache,
    /// Solver, `None` before the first load step.
    pub(super) solver: Option<DirectSolver>,
    /// Poses of the shapes along the whole path (frames of S).
    pub(super) ahead: Vec<Vec<Isometry3<f64>>>,
    pub(super) state: Configuration,
    pub(super) anchors: Vec<Anchor>,
    /// Force on the body in the last load step (N).
    pub(super) held: Vector3<f64>,
    /// Change of displacement in the last load step (N) in m.
    pub(super) increment: Vec<Vector3<f64>>,
    /// Poses of the shapes before the last load step (S).
    pub(super) before: Vec<Isometry3<f64>>,
    /// `true` if load steps must be short enough that points stay on the side of a shape that they
    /// meet.
    pub(super) one_sided: bool,
    /// Newton steps taken in this frame.
    iterations: usize,
}

/// A converged load step.
pub(super) struct ConvergedStep {
    pub(super) balance: NewtonOutcome,
    pub(super) forces: Forces,
}

impl<'a> PressSolver<'a> {
    pub(super) fn new(system: &'a System, mesh: &'a TetMesh, limits: StoppingCriteria) -> Self {
        let displacement = vec![Vector3::zeros(); system.nodes.places.len()];
        let held = Vector3::zeros();
        let increment = displacement.clone();
        let state = Configuration { displacement, poses: Vec::new() };
        Self {
            system,
            mesh,
            limits,
            seen: DistanceCache::default(),
            solver: None,
            ahead: Vec::new(),
            state,
            anchors: Vec::new(),
            held,
            increment,
            before: Vec::new(),
            one_sided: false,
            iterations: 0,
        }
    }

    /// Solves every frame of `press`; the first that fails is the last.
    pub(super) fn frames(mut self, press: &Press) -> Vec<Result<Deformation>> {
        if let Err(error) = self.start(press) {
            return vec![Err(error)];
        }
        self.one_sided = true;
        if let Drive::Translation { path } = press.drive() {
            self.ahead.clone_from(path);
        }
        solve_frames(press.frames(), |frame| self.frame(press, frame))
    }

    /// Sets the state of body and shapes in which the press begins.
    fn start(&mut self, press: &Press) -> Result<()> {
        let surface = &self.system.surface;
        let Some(history) = press.history() else {
            let places = self.system.surface_places(&self.state.displacement);
            let first = press.drive().first();
            self.state.poses = backed_off(press.shapes(), first, surface, &places, self.mesh);
            return Ok(());
        };
        let nodes = self.state.displacement.len();
        history.check(&self.system.identity, nodes, surface.len())?;
        self.state.displacement.clone_from(&history.displacement);
        self.state.poses.clone_from(&history.poses);
        self.anchors.clone_from(&history.anchors);
        Ok(())
    }

    /// Solves one frame and reports it.
    fn frame(&mut self, press: &Press, frame: FrameDrive) -> Result<Deformation> {
        let start = Instant::now();
        self.iterations = 0;
        let mut solved = match frame {
            FrameDrive::Poses(poses) => self.follow(press, poses)?,
            FrameDrive::Force { force, direction } => {
                self.push(press, &ForceControl { direction: **direction, force })?
            }
        };
        self.check_skin(press, &solved.forces)?;
        solved.balance.iterations = self.iterations;
        let mut deformation = self.report(&solved);
        deformation.seconds = start.elapsed().as_secs_f64();
        Ok(deformation)
    }

    /// Returns an error if a shape pierces the skin.
    fn check_skin(&self, press: &Press, forces: &Forces) -> Result<()> {
        let (system, poses) = (self.system, &self.state.poses);
        let mut pushes = vec![Vector3::zeros(); poses.len()];
        for touch in &forces.touches {
            pushes[touch.shape as usize] += system.contact_force(touch);
        }
        let (places, displacement) = (&system.nodes.places, &self.state.displacement);
        let skin = DeformedSkin::new(self.mesh, &system.surface, places, displacement);
        skin.check(press.shapes(), poses, &pushes, press.begins_at(poses))
    }

    /// Moves the shapes to `poses`.
    fn follow(&mut self, press: &Press, poses: &[Isometry3<f64>]) -> Result<ConvergedStep> {
        let from = self.state.poses.clone();
        let retry = |run: &Self, error: &Error, step: NextStep| {
            is_too_long(error) && run.iterations < run.limits.patience && step.size >= SHORTEST
        };
        let solve = |run: &mut Self, t| run.load_step(press, between(&from, poses, t), None);
        solve_in_steps(self, |_, step| step.size, retry, solve)
    }

    /// Pushes the shapes until they press with the force of `push`.
    fn push(&mut self, press: &Press, push: &ForceControl) -> Result<ConvergedStep> {
        let begin = self.state.poses[0].translation.vector;
        // The force that can be reached may be a small part of the force asked for.
        let retry = |_: &Self, error: &Error, step: NextStep| {
            is_too_long(error) && step.size >= SHORTEST.min(LEAST_GAIN * step.done).max(LEAST_PUSH)
        };
        let solve = |run: &mut Self, t: f64| {
            let push = ForceControl { force: t * push.force, ..*push };
            run.load_step(press, run.state.poses.clone(), Some(&push))
        };
        if !self.anchors.is_empty() || self.meet(press, push) {
            let solved = solve_in_steps(self, |_, step| step.size, retry, solve);
            if matches!(solved, Ok(_) | Err(Error::Interrupted)) {
                return solved;
            }
        }
        Err(Error::Unreachable {
            force: push.force,
            reached: self.held.dot(&push.direction),
            travel: (self.state.poses[0].translation.vector - begin).norm(),
        })
    }

    /// Moves the shapes along the push until the first of them touches, and returns whether one
    /// does.
    fn meet(&mut self, press: &Press, push: &ForceControl) -> bool {
        let places = self.system.surface_places(&self.state.displacement);
        let clearance = |poses: &[_]| clearance(press.shapes(), poses, &places);
        let limits = [0.0, self.system.law.softness];
        advance_to_contact(&mut self.state.poses, &push.direction, limits, clearance)
    }

    /// Solves one load step to `poses`, or from there on under `push`, and counts its Newton steps.
    /// On failure nothing else has changed.
    fn load_step(
        &mut self,
        press: &Press,
        poses: Vec<Isometry3<f64>>,
        push: Option<&ForceControl>,
    ) -> Result<ConvergedStep> {
        let attempt = self.attempt(press.shapes(), poses, push, None);
        self.iterations += match &attempt {
            Ok(attempt) => attempt.solved.balance.iterations,
            Err(Error::NotConverged { iterations, .. }) => *iterations,
            Err(_) => 0,
        };
        Ok(self.accept(attempt?))
    }

    /// Resultant of all contact on the body.
    pub(super) fn wrench(&self, forces: &Forces) -> Wrench {
        let force = |touch: &Touch| (self.system.contact_force(touch), touch.place.coords);
        Wrench::of_forces(forces.touches.iter().map(force))
    }

    /// Returns the current state as a [`Deformation`].
    pub(super) fn report(&self, solved: &ConvergedStep) -> Deformation {
        let system = self.system;
        let mut contact_force = vec![Vector3::zeros(); self.state.displacement.len()];
        for touch in &solved.forces.touches {
            let point = &system.surface[touch.point as usize];
            point.spread(&system.contact_force(touch), &mut contact_force);
        }
        // A quadratic element's force at the middle of an edge goes to its ends in equal parts.
        for (&[a, b], middle) in system.nodes.edges.iter().zip(self.mesh.vertices.len()..) {
            let half = 0.5 * contact_force[middle];
            contact_force[a as usize] += half;
            contact_force[b as usize] += half;
        }
        let vertices = self.mesh.vertices.len();
        contact_force.truncate(vertices);
        let displacement = &self.state.displacement;
        let history = History {
            model: system.identity,
            displacement: displacement.clone(),
            poses: self.state.poses.clone(),
            anchors: self.anchors.clone(),
            forces: Vec::new(),
            folded: false,
        };
        Deformation {
            displacement: displacement[..vertices].to_vec(),
            von_mises: system.solid.von_mises(displacement),
            contact_force,
            wrench: self.wrench(&solved.forces),
            sliding: system.law.sliding_share(
                solved.forces.touches.iter().map(|t| (system.contact_force(t), t.normal)),
            ),
            poses: self.state.poses.clone(),
            history,
            iterations: solved.balance.iterations,
            residual: solved.balance.residual,
            seconds: 0.0,
            predicted_error: None,
        }
    }
}

/// Returns whether a shorter load step may avoid `error`.
pub(super) fn is_too_long(error: &Error) -> bool {
    matches!(
        error,
        Error::NotConverged { .. } | Error::StepTooLong { .. } | Error::Penetrated { .. }
    )
}
