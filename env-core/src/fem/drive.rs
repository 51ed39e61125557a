//! Presses frame by frame: load steps, their subdivision, and force control.

use std::time::Instant;

use nalgebra::{Isometry3, Vector3};

use super::{
    newton::{Balance, Limits, Push, equilibrium},
    sparse::Matrix,
    system::{Forces, State, Stiffness, System},
};
use crate::{
    Error, Result,
    contact::{ContactStep, Touch, backed_off, between, clearance},
    deformation::{Anchor, Deformation, Drive, History, Press, Wrench},
    geometry::Shape,
};

/// Smallest part of a frame that is tried as a load step of its own.
pub(super) const SHORTEST_STRIDE: f64 = 1.0 / 256.0;
/// Depth of a touching point past which an answer is refused, in softnesses: what holds a shape there
/// is a pressure of as many Young's moduli.
const DEEPEST: f64 = 250.0;
/// Thickness of a shape under which points are watched that they do not change its sides (m); round
/// the edges of thicker ones they may slide.
const THIN: f64 = 1.2e-3;
/// Shapes pushed this far without a touch will not meet the body (m).
const FARTHEST: f64 = 1.0;

/// One press being solved: workspace and current state.
pub(super) struct Run<'a> {
    pub(super) system: &'a System,
    /// Number of the mesh's nodes, V.
    vertices: usize,
    limits: Limits,
    pub(super) matrix: Matrix,
    pub(super) state: State,
    anchors: Vec<Anchor>,
    /// Force on the body in the last load step (N).
    held: Vector3<f64>,
    /// Change of displacement in the last load step (N) in m.
    increment: Vec<Vector3<f64>>,
    /// Poses of the shapes before it (S).
    before: Vec<Isometry3<f64>>,
    /// Whether load steps must be short enough to tell the sides of a shape apart.
    one_sided: bool,
}

/// A converged load step.
pub(super) struct Solved {
    pub(super) balance: Balance,
    pub(super) forces: Forces,
}

/// A load step and where it leads.
pub(super) struct Attempt {
    pub(super) state: State,
    anchors: Vec<Anchor>,
    pub(super) solved: Solved,
}

impl<'a> Run<'a> {
    pub(super) fn new(system: &'a System, vertices: usize, limits: Limits) -> Self {
        let displacement = vec![Vector3::zeros(); system.nodes.places.len()];
        let matrix = system.pattern.matrix();
        let held = Vector3::zeros();
        let increment = displacement.clone();
        let state = State { displacement, poses: Vec::new() };
        let (anchors, before) = (Vec::new(), Vec::new());
        let one_sided = false;
        Self {
            system,
            vertices,
            limits,
            matrix,
            state,
            anchors,
            held,
            increment,
            before,
            one_sided,
        }
    }

    /// Every frame of `press`; the first that fails is the last.
    pub(super) fn frames(mut self, press: &Press) -> Vec<Result<Deformation>> {
        if let Err(error) = self.start(press) {
            return vec![Err(error)];
        }
        self.one_sided = true;
        match press.drive() {
            Drive::Translation { path } => {
                let mut frames = Vec::with_capacity(path.len());
                for poses in path {
                    frames.push(self.frame(|run| run.follow(press, poses)));
                    if frames.last().is_some_and(Result::is_err) {
                        break;
                    }
                }
                frames
            }
            Drive::Force { force, direction, .. } => {
                let push = Push { direction: **direction, force: *force };
                vec![self.frame(|run| run.push(press, &push))]
            }
        }
    }

    /// Puts body and shapes where the press begins.
    fn start(&mut self, press: &Press) -> Result<()> {
        let surface = &self.system.surface;
        let Some(history) = press.history() else {
            let places = self.system.surface_places(&self.state.displacement);
            let first = press.drive().first();
            self.state.poses = backed_off(press.shapes(), first, surface, &places);
            return Ok(());
        };
        history.check(self.state.displacement.len(), surface.len())?;
        self.state.displacement.clone_from(&history.displacement);
        self.state.poses.clone_from(&history.poses);
        self.anchors.clone_from(&history.anchors);
        Ok(())
    }

    /// Solves one frame and reports it.
    fn frame(&mut self, solve: impl FnOnce(&mut Self) -> Result<Solved>) -> Result<Deformation> {
        let start = Instant::now();
        let solved = solve(self)?;
        let mut deformation = self.report(&solved);
        deformation.seconds = start.elapsed().as_secs_f64();
        Ok(deformation)
    }

    /// Leads the shapes to `poses`.
    fn follow(&mut self, press: &Press, poses: &[Isometry3<f64>]) -> Result<Solved> {
        let from = self.state.poses.clone();
        self.in_steps(press, |_, t| (between(&from, poses, t), None))
    }

    /// Pushes the shapes until they press with the force of `push`.
    fn push(&mut self, press: &Press, push: &Push) -> Result<Solved> {
        let begin = self.state.poses[0].translation.vector;
        let reached = if self.anchors.is_empty() { self.meet(press, push) } else { Ok(()) };
        let solved = reached.and_then(|()| {
            self.in_steps(press, |run, t| {
                let force = t * push.force;
                (run.state.poses.clone(), Some(Push { force, ..*push }))
            })
        });
        solved.map_err(|_| {
            let travel = (self.state.poses[0].translation.vector - begin).norm();
            Error::Unreachable {
                force: push.force,
                reached: self.held.dot(&push.direction),
                travel,
            }
        })
    }

    /// Moves the shapes along the push until the first of them touches. A step as long as the least
    /// distance cannot pass the body.
    fn meet(&mut self, press: &Press, push: &Push) -> Result<()> {
        let places = self.system.surface_places(&self.state.displacement);
        let mut travel = 0.0;
        while travel < FARTHEST {
            let gap = clearance(press.shapes(), &self.state.poses, &places);
            if gap < 0.0 {
                return Ok(());
            }
            let stride = gap.max(self.system.law.softness);
            travel += stride;
            for pose in &mut self.state.poses {
                pose.translation.vector += push.direction * stride;
            }
        }
        Err(Error::Unreachable { force: push.force, reached: 0.0, travel })
    }

    /// Solves for the poses and push that `target` gives at t = 1, by way of smaller t where the
    /// whole way at once fails.
    fn in_steps(
        &mut self,
        press: &Press,
        target: impl Fn(&Self, f64) -> (Vec<Isometry3<f64>>, Option<Push>),
    ) -> Result<Solved> {
        let (mut done, mut stride, mut iterations) = (0.0, 1.0, 0);
        loop {
            let next = f64::min(done + stride, 1.0);
            let (poses, push) = target(self, next);
            match self.load_step(press, poses, push.as_ref()) {
                Ok(mut solved) => {
                    iterations += solved.balance.iterations;
                    if next == 1.0 {
                        solved.balance.iterations = iterations;
                        return Ok(solved);
                    }
                    done = next;
                    stride *= 2.0;
                }
                Err(Error::NotConverged { iterations: more, residual, tolerance }) => {
                    iterations += more;
                    stride *= 0.5;
                    if stride < SHORTEST_STRIDE {
                        return Err(Error::NotConverged { iterations, residual, tolerance });
                    }
                }
                Err(Error::Penetrated { .. }) if stride > SHORTEST_STRIDE => stride *= 0.5,
                Err(error) => return Err(error),
            }
        }
    }

    /// One load step to `poses`, or from there on under `push`. On failure nothing has changed.
    fn load_step(
        &mut self,
        press: &Press,
        poses: Vec<Isometry3<f64>>,
        push: Option<&Push>,
    ) -> Result<Solved> {
        let attempt = self.attempt(press.shapes(), poses, push, None)?;
        Ok(self.accept(attempt))
    }

    /// Where a load step to `poses`, or from there on under `push`, would lead; searched from the
    /// displacements guessed, or else predicted.
    pub(super) fn attempt(
        &mut self,
        shapes: &[Shape],
        poses: Vec<Isometry3<f64>>,
        push: Option<&Push>,
        guess: Option<Vec<Vector3<f64>>>,
    ) -> Result<Attempt> {
        let system = self.system;
        let start = system.surface_places(&self.state.displacement);
        let from = self.state.poses.clone();
        let mut contact = ContactStep::new(shapes, &system.surface, from, start, &self.anchors);
        contact.one_sided = self.one_sided;
        if contact.runs_over(&poses, system.deepest()) {
            return Err(self.missed());
        }
        let mut state = State { displacement: self.state.displacement.clone(), poses };
        match guess {
            Some(guess) => state.displacement = guess,
            None if push.is_none() => self.predict(shapes, &mut state, &mut contact),
            None => {}
        }
        let (balance, forces) =
            equilibrium(system, &mut self.matrix, &mut state, &mut contact, push, &self.limits)?;
        if shapes.iter().any(|shape| shape.thickness() < THIN) {
            let places = system.surface_places(&state.displacement);
            if contact.leaps(&state.poses, &places, system.deepest()) {
                return Err(self.missed());
            }
        }
        let depth = forces.touches.iter().map(|touch| touch.depth).fold(0.0, f64::max);
        let most = DEEPEST * system.law.softness;
        if depth > most {
            return Err(Error::Penetrated { depth, most });
        }
        let back =
            |touch: &Touch| system.law.stuck_at(&system.surface[touch.point as usize], touch);
        let anchors = contact.anchors(&state.poses, &forces.touches, back);
        Ok(Attempt { state, anchors, solved: Solved { balance, forces } })
    }

    /// The error of a load step in which shape and surface miss each other.
    fn missed(&self) -> Error {
        let (residual, tolerance) = (f64::INFINITY, self.limits.tolerance);
        Error::NotConverged { iterations: 0, residual, tolerance }
    }

    /// Makes an attempt the current state.
    pub(super) fn accept(&mut self, attempt: Attempt) -> Solved {
        let Attempt { state, anchors, solved } = attempt;
        self.anchors = anchors;
        let moved = state.displacement.iter().zip(&self.state.displacement);
        self.increment = moved.map(|(after, before)| after - before).collect();
        self.before.clone_from(&self.state.poses);
        self.held = self.wrench(&solved.forces).force;
        self.state = state;
        solved
    }

    /// Starts `state` where the path leads: on as in the last load step if the shapes go on as they
    /// did, else along the path's tangent at the beginning.
    fn predict(&mut self, shapes: &[Shape], state: &mut State, contact: &mut ContactStep) {
        let step = if self.goes_on(&state.poses) {
            Some(self.increment.clone())
        } else {
            self.tangent(shapes, &state.poses)
        };
        let Some(step) = step else { return };
        let ahead = self.state.displacement.iter().zip(&step).map(|(u, du)| u + du).collect();
        let ahead = State { displacement: ahead, poses: state.poses.clone() };
        if self.system.forces(&ahead, contact).is_some() {
            *state = ahead;
        }
    }

    /// Whether the way to `poses` is about the same as that of the last load step.
    fn goes_on(&self, poses: &[Isometry3<f64>]) -> bool {
        let ways = poses.iter().zip(&self.state.poses).zip(&self.before);
        self.before.len() == poses.len()
            && ways.into_iter().all(|((next, now), before)| {
                let way = |to: &Isometry3<f64>, from: &Isometry3<f64>| {
                    (to.translation.vector - from.translation.vector, to.rotation / from.rotation)
                };
                let (next, last) = (way(next, now), way(now, before));
                let turn = (next.1 / last.1).angle();
                (next.0 - last.0).norm() <= 0.5 * next.0.norm() && turn <= 0.5 * next.1.angle()
            })
    }

    /// Change of displacement for small motions of the shapes towards `poses`, with all that touches
    /// taken along; none if nothing touches.
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
            for &(node, share) in &system.surface[touch.point as usize].shares {
                pull[node as usize] += force * share;
            }
        }
        system.assemble(&forces, &mut self.matrix, Stiffness::Exact);
        if !self.matrix.factorise(&system.pattern) {
            return None;
        }
        let mut step = system.pattern.gather(&pull);
        self.matrix.solve(&system.pattern, &mut step);
        Some(system.pattern.scatter(&step))
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

    /// What the current state is, seen from outside.
    pub(super) fn report(&self, solved: &Solved) -> Deformation {
        let system = self.system;
        let mut contact_force = vec![Vector3::zeros(); self.state.displacement.len()];
        for touch in &solved.forces.touches {
            let force = system.contact_force(touch);
            for &(node, share) in &system.surface[touch.point as usize].shares {
                contact_force[node as usize] += force * share;
            }
        }
        // A quadratic element's force at the middle of an edge goes to its ends in equal parts.
        for (&[a, b], middle) in system.nodes.edges.iter().zip(self.vertices..) {
            let half = 0.5 * contact_force[middle];
            contact_force[a as usize] += half;
            contact_force[b as usize] += half;
        }
        contact_force.truncate(self.vertices);
        let displacement = &self.state.displacement;
        let history = History {
            displacement: displacement.clone(),
            poses: self.state.poses.clone(),
            anchors: self.anchors.clone(),
            forces: Vec::new(),
        };
        Deformation {
            displacement: displacement[..self.vertices].to_vec(),
            von_mises: system.solid.von_mises(displacement),
            contact_force,
            wrench: self.wrench(&solved.forces),
            poses: self.state.poses.clone(),
            history,
            iterations: solved.balance.iterations,
            residual: solved.balance.residual,
            seconds: 0.0,
        }
    }
}
