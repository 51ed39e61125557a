//! A free rigid object between two soft pads: its six degrees of freedom belong to the equilibrium.
//!
//! The pads are solved for a given pose of the object; what they do to it, and the load, must cancel.
//! That is Newton's method in six unknowns, whose matrix is the pads' stiffness at the object:
//! K = Σ (C − Bᵀ A⁻¹ B), A a pad's stiffness, C the contact's, B their coupling. It holds the limits
//! of friction fixed; what it misses is learnt from step to step (Broyden 1965).

use std::time::Instant;

use nalgebra::{
    Isometry3, Matrix3x6, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6,
};

use super::{
    Fem,
    drive::{Attempt, Run, SHORTEST_STRIDE},
    sparse::Matrix,
    system::{Forces, Stiffness, System},
};
use crate::{
    Error, Result,
    deformation::{Deformation, Wrench},
    geometry::Shape,
};

/// A rigid object that two pads grasp. Everything here is in the world's frame.
#[derive(Clone, Debug)]
pub struct Grasp {
    /// The object.
    pub object: Shape,
    /// Pose of the object where the grasp begins.
    pub start: Isometry3<f64>,
    /// Poses of the two pads' frames, frame by frame. What touches in the first sticks where it is.
    pub path: Vec<[Isometry3<f64>; 2]>,
    /// What else acts on the object, such as its weight; the torque is about its origin.
    pub load: Wrench,
}

/// One frame of a [`Grasp`].
#[derive(Clone, Debug)]
pub struct Grasped {
    /// The pads' answers, each in its own frame.
    pub pads: [Deformation; 2],
    /// Pose of the object in the world.
    pub object: Isometry3<f64>,
    /// Force left unbalanced on the object, torque counted over its size (N).
    pub residual: f64,
    /// Wall time (s).
    pub seconds: f64,
}

/// Most changes of the object's pose in one frame.
const ITERATIONS: usize = 40;
/// Unbalanced force on the object at which a frame is done, in tolerances of a pad.
const SLACK: f64 = 10.0;
/// Stiffnesses below this share of the largest are free motions, such as the spin of a ball.
const FREE: f64 = 1e-9;

impl Grasp {
    /// Every frame, in order; the first that is not solved is an error and the last.
    pub fn solve(&self, pads: [&Fem; 2]) -> Vec<Result<Grasped>> {
        let Some(first) = self.path.first() else {
            return vec![Err(Error::invalid("path", "no frames", "at least one"))];
        };
        let mut hold = match Hold::new(&self.object, self.start, pads, first, self.load) {
            Ok(hold) => hold,
            Err(error) => return vec![Err(error)],
        };
        let mut frames = Vec::with_capacity(self.path.len());
        for poses in &self.path {
            frames.push(hold.frame(poses));
            if frames.last().is_some_and(Result::is_err) {
                break;
            }
        }
        frames
    }
}

/// A grasp being solved frame by frame, for whoever chooses the next frame by the last.
pub struct Hold<'a> {
    object: [Shape; 1],
    runs: [Run<'a>; 2],
    /// Poses of the pads' frames, and of the object, at the end of the last step.
    pads: [Isometry3<f64>; 2],
    pose: Isometry3<f64>,
    /// Size of the object (m): what a radian is compared with.
    size: f64,
    load: Wrench,
    tolerance: f64,
}

/// The pads solved for one pose of the object.
struct Trial {
    pose: Isometry3<f64>,
    attempts: [Attempt; 2],
    /// Minus the force and the torque over size on the object (N).
    unbalanced: Vector6<f64>,
}

impl<'a> Hold<'a> {
    /// `object` at `start` between undeformed pads at the poses `first`, under `load`, as in
    /// [`Grasp`]. What touches there sticks where it is. An error if the object is not a solid.
    pub fn new(
        object: &Shape,
        start: Isometry3<f64>,
        pads: [&'a Fem; 2],
        first: &[Isometry3<f64>; 2],
        load: Wrench,
    ) -> Result<Self> {
        let object = [object.clone().validated()?];
        let size = object[0].surface(16).map_or(0.01, |surface| surface.size());
        let runs = [0, 1].map(|i| {
            let fem = pads[i];
            let mut run = Run::new(&fem.system, fem.body.mesh().vertices.len(), fem.limits);
            run.state.poses = vec![first[i].inv_mul(&start)];
            run
        });
        let tolerance =
            SLACK * pads.map(|pad| pad.limits.tolerance).into_iter().fold(0.0, f64::max);
        Ok(Self { object, runs, pads: *first, pose: start, size, load, tolerance })
    }

    /// Leads the pads to `pads`, by way of shorter steps where the whole way at once fails. On
    /// failure they stand where the last step that was solved left them.
    pub fn frame(&mut self, pads: &[Isometry3<f64>; 2]) -> Result<Grasped> {
        let (clock, from) = (Instant::now(), self.pads);
        let shortest = if *pads == from { 1.0 } else { SHORTEST_STRIDE };
        let (mut done, mut stride, mut iterations) = (0.0, 1.0, [0; 2]);
        loop {
            let next = f64::min(done + stride, 1.0);
            let between = [0, 1].map(|i| from[i].lerp_slerp(&pads[i], next));
            match self.step(if next == 1.0 { pads } else { &between }) {
                Ok(mut grasped) => {
                    for (sum, pad) in iterations.iter_mut().zip(&mut grasped.pads) {
                        *sum += pad.iterations;
                        pad.iterations = *sum;
                    }
                    if next == 1.0 {
                        grasped.seconds = clock.elapsed().as_secs_f64();
                        return Ok(grasped);
                    }
                    (done, stride) = (next, 2.0 * stride);
                }
                Err(error @ Error::NotConverged { .. }) => {
                    stride *= 0.5;
                    if stride < shortest {
                        return Err(error);
                    }
                }
                Err(error) => return Err(error),
            }
        }
    }

    /// One step to `pads`. On failure nothing has changed.
    fn step(&mut self, pads: &[Isometry3<f64>; 2]) -> Result<Grasped> {
        let mut trial = self.trial(pads, self.pose)?;
        let balanced = trial.unbalanced.norm() <= self.tolerance;
        let mut stiffness = if balanced { Matrix6::zeros() } else { self.stiffness(pads, &trial) };
        for _ in 0..ITERATIONS {
            if trial.unbalanced.norm() <= self.tolerance {
                break;
            }
            let towards = |k: &Matrix6<f64>, g: &Vector6<f64>| -free_inverse(k) * g;
            let learnt = self.closer(pads, &trial, towards(&stiffness, &trial.unbalanced));
            let (next, step) = if let Ok(found) = learnt {
                found
            } else {
                stiffness = self.stiffness(pads, &trial);
                self.closer(pads, &trial, towards(&stiffness, &trial.unbalanced))?
            };
            let surprise = next.unbalanced - trial.unbalanced - stiffness * step;
            stiffness += surprise * step.transpose() / step.norm_squared();
            trial = next;
        }
        let residual = trial.unbalanced.norm();
        if residual > self.tolerance {
            let (iterations, tolerance) = (ITERATIONS, self.tolerance);
            return Err(Error::NotConverged { iterations, residual, tolerance });
        }
        (self.pads, self.pose) = (*pads, trial.pose);
        let [left, right] = trial.attempts;
        let [first, second] = &mut self.runs;
        let pads = [(first, left), (second, right)].map(|(run, attempt)| {
            let solved = run.accept(attempt);
            run.report(&solved)
        });
        Ok(Grasped { pads, object: self.pose, residual, seconds: 0.0 })
    }

    /// The pads solved with the object at `pose`.
    fn trial(&mut self, pads: &[Isometry3<f64>; 2], pose: Isometry3<f64>) -> Result<Trial> {
        let [first, second] = &mut self.runs;
        let attempts = [
            first.attempt(&self.object, vec![pads[0].inv_mul(&pose)], None)?,
            second.attempt(&self.object, vec![pads[1].inv_mul(&pose)], None)?,
        ];
        let mut unbalanced = stacked(&-self.load.force, &(-self.load.torque / self.size));
        for (i, attempt) in attempts.iter().enumerate() {
            let wrench = self.runs[i].wrench(&attempt.solved.forces);
            let force = pads[i].rotation * wrench.force;
            let arm = pads[i].translation.vector - pose.translation.vector;
            let torque = pads[i].rotation * wrench.torque + arm.cross(&force);
            unbalanced += stacked(&force, &(torque / self.size));
        }
        Ok(Trial { pose, attempts, unbalanced })
    }

    /// The trial along `step`, shortened until less is unbalanced than at `from`, and the step taken.
    fn closer(
        &mut self,
        pads: &[Isometry3<f64>; 2],
        from: &Trial,
        step: Vector6<f64>,
    ) -> Result<(Trial, Vector6<f64>)> {
        let before = from.unbalanced.norm();
        let mut share = (0.05 * self.size / step.norm()).min(1.0);
        for _ in 0..12 {
            if let Ok(trial) = self.trial(pads, moved(&from.pose, &(step * share), self.size))
                && trial.unbalanced.norm() < before
            {
                return Ok((trial, step * share));
            }
            share *= 0.5;
        }
        let (iterations, tolerance) = (ITERATIONS, self.tolerance);
        Err(Error::NotConverged { iterations, residual: before, tolerance })
    }

    /// Stiffness of both pads at the object (N/m).
    fn stiffness(&mut self, pads: &[Isometry3<f64>; 2], trial: &Trial) -> Matrix6<f64> {
        let mut stiffness = Matrix6::zeros();
        for (i, run) in self.runs.iter_mut().enumerate() {
            let object = pads[i].inv_mul(&trial.pose);
            let motion = |place: &Point3<f64>| {
                let arm = (place.coords - object.translation.vector) / self.size;
                let turn = pads[i].rotation.inverse().to_rotation_matrix().into_inner();
                let mut motion = Matrix3x6::zeros();
                motion.fixed_columns_mut::<3>(0).copy_from(&turn);
                motion.fixed_columns_mut::<3>(3).copy_from(&(-arm.cross_matrix() * turn));
                motion
            };
            stiffness +=
                condensed(run.system, &mut run.matrix, &trial.attempts[i].solved.forces, motion);
        }
        stiffness
    }
}

/// Stiffness of a pad at the object whose contact points move by `motion`.
fn condensed(
    system: &System,
    matrix: &mut Matrix,
    forces: &Forces,
    motion: impl Fn(&Point3<f64>) -> Matrix3x6<f64>,
) -> Matrix6<f64> {
    let mut corner = Matrix6::zeros();
    let mut coupling = vec![vec![Vector3::zeros(); forces.gradient.len()]; 6];
    for touch in &forces.touches {
        let motion = motion(&touch.place);
        let pull = system.contact_stiffness(touch) * motion;
        corner += motion.transpose() * pull;
        for &(node, share) in &system.surface[touch.point as usize].shares {
            for (column, pull) in coupling.iter_mut().zip(pull.column_iter()) {
                column[node as usize] -= pull * share;
            }
        }
    }
    system.assemble(forces, matrix, Stiffness::Exact);
    if !matrix.factorise(&system.pattern) {
        system.assemble(forces, matrix, Stiffness::Filtered);
        matrix.factorise(&system.pattern);
    }
    let columns: Vec<f64> = coupling.iter().flat_map(|c| system.pattern.gather(c)).collect();
    let mut lifted = columns.clone();
    matrix.solve(&system.pattern, &mut lifted);
    let column = |all: &'_ [f64], k: usize| {
        nalgebra::DVector::from_column_slice(
            &all[k * system.pattern.size()..][..system.pattern.size()],
        )
    };
    corner - Matrix6::from_fn(|i, j| column(&columns, i).dot(&column(&lifted, j)))
}

fn stacked(force: &Vector3<f64>, torque: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z)
}

/// `pose` shifted by the first half of `step` and turned, about its origin, by the second over `size`.
fn moved(pose: &Isometry3<f64>, step: &Vector6<f64>, size: f64) -> Isometry3<f64> {
    let shift = Vector3::new(step[0], step[1], step[2]);
    let turn = Vector3::new(step[3], step[4], step[5]) / size;
    let translation = Translation3::from(pose.translation.vector + shift);
    Isometry3::from_parts(translation, UnitQuaternion::from_scaled_axis(turn) * pose.rotation)
}

/// Inverse of a matrix, zero where it has no stiffness.
fn free_inverse(stiffness: &Matrix6<f64>) -> Matrix6<f64> {
    let svd = stiffness.svd(true, true);
    let least = FREE * svd.singular_values.max();
    svd.pseudo_inverse(least).expect("both factors were asked for, and the bound is not negative")
}
