//! A free rigid object between two soft pads: its six degrees of freedom are part of the
//! equilibrium.
//!
//! The pads are solved for a given pose of the object; their wrenches on it and the load must
//! cancel. This is solved by Newton's method in six unknowns, whose matrix is the sum of the pads'
//! stiffnesses at the object ([`super::follower`]).

use std::time::Instant;

use nalgebra::{
    Isometry3, Matrix3x6, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6,
};

use super::{
    Fem,
    attempt::LoadStep,
    drive::{PressSolver, SHORTEST, is_too_long},
    follower::PadResponse,
};
use crate::{
    Error, Result,
    deformation::{Deformation, NextStep, Wrench, solve_frames, solve_in_steps},
    geometry::Shape,
};

/// A rigid object that two pads grasp. All quantities are in the world's frame.
#[derive(Clone, Debug)]
pub struct Grasp {
    /// The object.
    pub object: Shape,
    /// Pose of the object at the beginning of the grasp.
    pub start: Isometry3<f64>,
    /// Poses of the two pads' frames, frame by frame. Points that touch in the first frame stick
    /// where they are.
    pub path: Vec<[Isometry3<f64>; 2]>,
    /// External load on the object, such as its weight; the torque is about its origin.
    pub load: Wrench,
}

/// One frame of a [`Grasp`].
#[derive(Clone, Debug)]
pub struct Grasped {
    /// Deformations of the pads, each in its own frame.
    pub pads: [Deformation; 2],
    /// Pose of the object in the world.
    pub object: Isometry3<f64>,
    /// Norm of the residual force on the object, with the torque divided by its size (N).
    pub residual: f64,
    /// Wall time (s).
    pub seconds: f64,
}

/// Most Newton steps of the object's pose in one load step.
const ITERATIONS: usize = 40;
/// Most halvings of such a Newton step.
const CUTS: usize = 12;
/// Residual force on the object at which a frame has converged, in tolerances of a pad.
const SLACK: f64 = 10.0;
/// Share of the largest stiffness below which a motion is free, such as the spin of a ball.
const FREE: f64 = 1e-9;

impl Grasp {
    /// Solves every frame, in order; the first that fails is an error and the last.
    pub fn solve(&self, pads: [&Fem; 2]) -> Vec<Result<Grasped>> {
        let Some(first) = self.path.first() else {
            return vec![Err(Error::invalid("path", "no frames", "at least one"))];
        };
        let mut hold = match Hold::new(&self.object, self.start, pads, first, self.load) {
            Ok(hold) => hold,
            Err(error) => return vec![Err(error)],
        };
        solve_frames(&self.path, |poses| hold.frame(poses))
    }
}

/// A grasp being solved frame by frame, for callers that choose each frame after the last.
pub struct Hold<'a> {
    object: [Shape; 1],
    runs: [PressSolver<'a>; 2],
    /// Poses of the pads' frames, and of the object, at the end of the last step.
    pads: [Isometry3<f64>; 2],
    pose: Isometry3<f64>,
    /// Size of the object (m), by which torques are divided and rotations multiplied.
    size: f64,
    load: Wrench,
    tolerance: f64,
}

/// The pads solved for one pose of the object.
struct PadsAtPose {
    pose: Isometry3<f64>,
    attempts: [LoadStep; 2],
    /// Minus the force and the torque over size on the object (N).
    unbalanced: Vector6<f64>,
}

impl<'a> Hold<'a> {
    /// Places `object` at `start` between undeformed pads at the poses `first`, under `load`, as in
    /// [`Grasp`]. Points that touch there stick where they are. Returns an error if the object is
    /// not a valid solid or is too thin for the contact points.
    pub fn new(
        object: &Shape,
        start: Isometry3<f64>,
        pads: [&'a Fem; 2],
        first: &[Isometry3<f64>; 2],
        load: Wrench,
    ) -> Result<Self> {
        let object = [object.clone().validated()?];
        for pad in pads {
            pad.system.check_felt(&object[0])?;
        }
        let size = object[0].surface(16).map_or(0.01, |surface| surface.size());
        let runs = [0, 1].map(|i| {
            let fem = pads[i];
            let mut run = PressSolver::new(&fem.system, fem.body.mesh(), fem.limits);
            run.state.poses = vec![first[i].inv_mul(&start)];
            run
        });
        let tolerance =
            SLACK * pads.map(|pad| pad.limits.tolerance).into_iter().fold(0.0, f64::max);
        Ok(Self { object, runs, pads: *first, pose: start, size, load, tolerance })
    }

    /// Sets the external load on the object, as in [`Grasp::load`], from the next frame on.
    pub fn bear(&mut self, load: Wrench) {
        self.load = load;
    }

    /// Moves the pads to `pads`, in shorter steps where a single one fails. On failure they stay
    /// where the last solved step ended.
    pub fn frame(&mut self, pads: &[Isometry3<f64>; 2]) -> Result<Grasped> {
        let (clock, from) = (Instant::now(), self.pads);
        let retry = |_: &Self, error: &Error, step: NextStep| {
            is_too_long(error) && *pads != from && step.size >= SHORTEST
        };
        let mut iterations = [0; 2];
        let solve = |hold: &mut Self, t: f64| {
            let between = [0, 1].map(|i| from[i].lerp_slerp(&pads[i], t));
            let grasped = hold.step(if t == 1.0 { pads } else { &between })?;
            iterations.iter_mut().zip(&grasped.pads).for_each(|(sum, pad)| *sum += pad.iterations);
            Ok(grasped)
        };
        let mut grasped = solve_in_steps(self, |_, step| step.size, retry, solve)?;
        grasped.pads.iter_mut().zip(iterations).for_each(|(pad, sum)| pad.iterations = sum);
        grasped.seconds = clock.elapsed().as_secs_f64();
        Ok(grasped)
    }

    /// Solves one step to `pads`. On failure nothing has changed.
    fn step(&mut self, pads: &[Isometry3<f64>; 2]) -> Result<Grasped> {
        let mut trial = self.trial(pads, self.pose, [None, None])?;
        let mut left = ITERATIONS;
        while trial.unbalanced.norm() > self.tolerance {
            if left == 0 {
                return Err(self.failed(&trial));
            }
            left -= 1;
            trial = self.closer(pads, &trial)?;
        }
        let residual = trial.unbalanced.norm();
        (self.pads, self.pose) = (*pads, trial.pose);
        let [left, right] = trial.attempts;
        let [first, second] = &mut self.runs;
        let pads = [(first, left), (second, right)].map(|(run, attempt)| {
            let solved = run.accept(attempt);
            run.report(&solved)
        });
        Ok(Grasped { pads, object: self.pose, residual, seconds: 0.0 })
    }

    fn failed(&self, trial: &PadsAtPose) -> Error {
        let (residual, tolerance) = (trial.unbalanced.norm(), self.tolerance);
        Error::NotConverged { iterations: ITERATIONS, residual, tolerance }
    }

    /// Solves the pads with the object at `pose`, from displacements guessed or predicted.
    fn trial(
        &mut self,
        pads: &[Isometry3<f64>; 2],
        pose: Isometry3<f64>,
        guesses: [Option<Vec<Vector3<f64>>>; 2],
    ) -> Result<PadsAtPose> {
        let [first, second] = &mut self.runs;
        let [left, right] = guesses;
        let attempts = [
            first.attempt(&self.object, vec![pads[0].inv_mul(&pose)], None, left)?,
            second.attempt(&self.object, vec![pads[1].inv_mul(&pose)], None, right)?,
        ];
        let mut unbalanced = stacked(&-self.load.force, &(-self.load.torque / self.size));
        for (i, attempt) in attempts.iter().enumerate() {
            let wrench = self.runs[i].wrench(&attempt.solved.forces);
            let force = pads[i].rotation * wrench.force;
            let arm = pads[i].translation.vector - pose.translation.vector;
            let torque = pads[i].rotation * wrench.torque + arm.cross(&force);
            unbalanced += stacked(&force, &(torque / self.size));
        }
        Ok(PadsAtPose { pose, attempts, unbalanced })
    }

    /// Returns the trial after Newton's step from `from`, shortened until the residual decreases.
    fn closer(&mut self, pads: &[Isometry3<f64>; 2], from: &PadsAtPose) -> Result<PadsAtPose> {
        let followers = [0, 1].map(|i| self.follower(i, &pads[i], from));
        let stiffness: Matrix6<f64> = followers.iter().map(|follower| follower.stiffness).sum();
        let step = -free_inverse(&stiffness) * from.unbalanced;
        let mut share = (0.05 * self.size / step.norm()).min(1.0);
        for _ in 0..CUTS {
            let step = step * share;
            let guesses = [0, 1].map(|i| {
                let ahead = followers[i].ahead(self.runs[i].solver.as_ref().unwrap(), &step);
                let now = &from.attempts[i].state.displacement;
                Some(now.iter().zip(&ahead).map(|(u, du)| u + du).collect())
            });
            match self.trial(pads, moved(&from.pose, &step, self.size), guesses) {
                Err(Error::Interrupted) => return Err(Error::Interrupted),
                Ok(trial) if trial.unbalanced.norm() < from.unbalanced.norm() => return Ok(trial),
                _ => {}
            }
            share *= 0.5;
        }
        Err(self.failed(from))
    }

    /// Returns the linear response of pad `i` at `pad` to small motions of the object at `trial`.
    fn follower(&mut self, i: usize, pad: &Isometry3<f64>, trial: &PadsAtPose) -> PadResponse {
        let object = pad.inv_mul(&trial.pose);
        let motion = |place: &Point3<f64>| {
            let arm = (place.coords - object.translation.vector) / self.size;
            let turn = pad.rotation.inverse().to_rotation_matrix().into_inner();
            let mut motion = Matrix3x6::zeros();
            motion.fixed_columns_mut::<3>(0).copy_from(&turn);
            motion.fixed_columns_mut::<3>(3).copy_from(&(-arm.cross_matrix() * turn));
            motion
        };
        let run = &mut self.runs[i];
        let solver = run.solver.as_mut().expect("the trial made it");
        PadResponse::new(run.system, solver, &trial.attempts[i].solved.forces, motion)
    }
}

fn stacked(force: &Vector3<f64>, torque: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z)
}

/// Returns `pose` shifted by the first half of `step` and turned, about its origin, by the second
/// half over `size`.
fn moved(pose: &Isometry3<f64>, step: &Vector6<f64>, size: f64) -> Isometry3<f64> {
    let shift = Vector3::new(step[0], step[1], step[2]);
    let turn = Vector3::new(step[3], step[4], step[5]) / size;
    let translation = Translation3::from(pose.translation.vector + shift);
    Isometry3::from_parts(translation, UnitQuaternion::from_scaled_axis(turn) * pose.rotation)
}

/// Pseudo-inverse of a stiffness matrix, zero along motions without stiffness.
fn free_inverse(stiffness: &Matrix6<f64>) -> Matrix6<f64> {
    let svd = stiffness.svd(true, true);
    let least = FREE * svd.singular_values.max();
    svd.pseudo_inverse(least).expect("both factors were asked for, and the bound is not negative")
}
