//! Presses frame by frame: load steps, their subdivision, and force control.

use std::{cell::Cell, time::Instant};

use nalgebra::{Isometry3, Vector3};

use super::{
    direct::DirectSolver,
    newton::{NewtonOutcome, StoppingCriteria},
    push::ForceControl,
    stride::{SHORTEST, in_steps},
    system::{Configuration, Forces, System},
};
use crate::{
    Error, Result,
    contact::{DistanceCache, backed_off, between, clearance},
    deformation::{Anchor, Deformation, Drive, History, Press, Wrench},
    geometry::TetMesh,
};

/// Least increase of a push in one step, as a share of the force already reached, and its lower
/// bound as a share of the force asked for.
const LEAST_GAIN: f64 = 1.0 / 16.0;
const LEAST_PUSH: f64 = 1e-6;
/// Travel after which pushed shapes that have not touched the body are taken to miss it (m).
const FARTHEST: f64 = 1.0;

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
        let (anchors, before) = (Vec::new(), Vec::new());
        let one_sided = false;
        Self {
            system,
            mesh,
            limits,
            seen: DistanceCache::default(),
            solver: None,
            ahead: Vec::new(),
            state,
            anchors,
            held,
            increment,
            before,
            one_sided,
        }
    }

    /// Solves every frame of `press`; the first that fails is the last.
    pub(super) fn frames(mut self, press: &Press) -> Vec<Result<Deformation>> {
        if let Err(error) = self.start(press) {
            return vec![Err(error)];
        }
        self.one_sided = true;
        match press.drive() {
            Drive::Translation { path } => {
                let mut frames = Vec::with_capacity(path.len());
                self.ahead.clone_from(path);
                for poses in path {
                    frames.push(self.frame(|run| run.follow(press, poses)));
                    if frames.last().is_some_and(Result::is_err) {
                        break;
                    }
                }
                frames
            }
            Drive::Force { force, direction, .. } => {
                let push = ForceControl { direction: **direction, force: *force };
                vec![self.frame(|run| run.push(press, &push))]
            }
        }
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
        history.check(self.state.displacement.len(), surface.len())?;
        self.state.displacement.clone_from(&history.displacement);
        self.state.poses.clone_from(&history.poses);
        self.anchors.clone_from(&history.anchors);
        Ok(())
    }

    /// Solves one frame and reports it.
    fn frame(
        &mut self,
        solve: impl FnOnce(&mut Self) -> Result<ConvergedStep>,
    ) -> Result<Deformation> {
        let start = Instant::now();
        let solved = solve(self)?;
        let mut deformation = self.report(&solved);
        deformation.seconds = start.elapsed().as_secs_f64();
        Ok(deformation)
    }

    /// Moves the shapes to `poses`.
    fn follow(&mut self, press: &Press, poses: &[Isometry3<f64>]) -> Result<ConvergedStep> {
        let (from, iterations) = (self.state.poses.clone(), Cell::new(0));
        let patience = self.limits.patience;
        let step = |t| {
            let mut taken = iterations.get();
            let solved = self.load_step(press, between(&from, poses, t), None, &mut taken);
            iterations.set(taken);
            solved
        };
        let shortest = |_| if iterations.get() < patience { SHORTEST } else { 1.0 };
        let mut solved = in_steps(shortest, step)?;
        solved.balance.iterations = iterations.get();
        Ok(solved)
    }

    /// Pushes the shapes until they press with the force of `push`.
    fn push(&mut self, press: &Press, push: &ForceControl) -> Result<ConvergedStep> {
        let begin = self.state.poses[0].translation.vector;
        let reached = if self.anchors.is_empty() { self.meet(press, push) } else { Ok(()) };
        let mut iterations = 0;
        let solved = reached.and_then(|()| {
            // The force that can be reached may be a small part of the force asked for.
            let shortest = |done: f64| SHORTEST.min(LEAST_GAIN * done).max(LEAST_PUSH);
            in_steps(shortest, |t| {
                let push = ForceControl { force: t * push.force, ..*push };
                self.load_step(press, self.state.poses.clone(), Some(&push), &mut iterations)
            })
        });
        let counted = |mut solved: ConvergedStep| {
            solved.balance.iterations = iterations;
            solved
        };
        solved.map(counted).map_err(|error| match error {
            Error::Interrupted => error,
            _ => Error::Unreachable {
                force: push.force,
                reached: self.held.dot(&push.direction),
                travel: (self.state.poses[0].translation.vector - begin).norm(),
            },
        })
    }

    /// Moves the shapes along the push until the first of them touches. A step as long as the
    /// smallest distance cannot pass the body.
    fn meet(&mut self, press: &Press, push: &ForceControl) -> Result<()> {
        let places = self.system.surface_places(&self.state.displacement);
        let mut travel = 0.0;
        while travel < FARTHEST {
            let gap = clearance(press.shapes(), &self.state.poses, &places);
            if gap < 0.0 {
                return Ok(());
            }
            let step = gap.max(self.system.law.softness);
            travel += step;
            for pose in &mut self.state.poses {
                pose.translation.vector += push.direction * step;
            }
        }
        Err(Error::Unreachable { force: push.force, reached: 0.0, travel })
    }

    /// Solves one load step to `poses`, or from there on under `push`, and adds its Newton steps to
    /// `iterations`. On failure nothing else has changed.
    fn load_step(
        &mut self,
        press: &Press,
        poses: Vec<Isometry3<f64>>,
        push: Option<&ForceControl>,
        iterations: &mut usize,
    ) -> Result<ConvergedStep> {
        let attempt = self.attempt(press.shapes(), poses, push, None);
        *iterations += match &attempt {
            Ok(attempt) => attempt.solved.balance.iterations,
            Err(Error::NotConverged { iterations, .. }) => *iterations,
            Err(_) => 0,
        };
        Ok(self.accept(attempt?))
    }

    /// Resultant of all contact on the body.
    pub(super) fn wrench(&self, forces: &Forces) -> Wrench {
        let mut wrench = Wrench::default();
        for touch in &forces.touches {
            let force = self.system.contact_force(touch);
            wrench.force += force;
            wrench.torque += touch.place.coords.cross(&force);
        }
        wrench
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
