//! Force control: motion of the shapes until they press with a given force.

use nalgebra::{Isometry3, Unit, Vector3};

use super::load_stepping::{EDGE_STEP, Equilibrium, LoadStepping};
use crate::{
    Error, Result,
    contact::{advance_to_contact, clearance},
    deformation::Wrench,
    interrupt,
};

/// Shortest load step that is tried (m).
const SHORTEST_STEP: f64 = 1e-9;
/// Distance to the body that counts as touching (m).
const NEAR: f64 = 2e-6;
/// Relative error of the force that is looked for, unless the tolerance of the residual force is
/// larger.
const RELATIVE: f64 = 1e-6;
/// Relative error of the force that is accepted after [`SOON`] attempts to find it within a load
/// step, and of a history: contact is not settled more exactly than to about that.
const SETTLED: f64 = 1e-4;
const SOON: usize = 8;
/// Relative error of the force that is accepted where it jumps.
const AT_JUMP: f64 = 1e-3;
/// Greatest number of load steps to bracket the force, and again to narrow the bracket.
const MOST: usize = 200;

/// Body whose shapes can be moved by load steps.
pub(super) trait ForceControlled {
    /// State of body and shapes in balance.
    type State;

    /// Poses of the shapes (S).
    fn poses(&mut self) -> &mut [Isometry3<f64>];
    /// Smallest distance of the shapes at `poses` (S) to the body (m).
    fn clearance(&self, poses: &[Isometry3<f64>]) -> f64;
    /// Attempts one load step to `poses` and returns the state it ends in.
    fn attempt(&mut self, poses: &[Isometry3<f64>]) -> Result<Self::State>;
    /// Present state.
    fn state(&mut self) -> &mut Self::State;
    /// Norm of the residual force allowed in a state (N).
    fn tolerance(&self) -> f64;
    /// Wrench of the shapes on the body in a state.
    fn wrench(state: &Self::State) -> &Wrench;
    /// Number of iterations taken to reach a state.
    fn iterations(state: &mut Self::State) -> &mut usize;
}

/// Moves the shapes along `direction` until they press with `force` (N): in load steps until they
/// press harder, then by the Illinois variant of false position within the last step.
pub(super) fn push<D: ForceControlled>(
    body: &mut D,
    force: f64,
    direction: &Unit<Vector3<f64>>,
) -> Result<()> {
    let tolerance = body.tolerance();
    let mut push = Push { force, tolerance, direction: *direction, iterations: 0 };
    let begin = body.poses()[0].translation.vector;
    // Without contact, the force remains that of the state: zero.
    let mut poses = body.poses().to_vec();
    let met = advance_to_contact(&mut poses, direction, [NEAR; 2], |poses| body.clearance(poses));
    body.poses().copy_from_slice(&poses);
    let reached = met && push.reach(body).is_some();
    interrupt::check()?;
    if !reached {
        let travel = (body.poses()[0].translation.vector - begin).norm();
        return Err(Error::Unreachable { force, reached: push.along::<D>(body.state()), travel });
    }
    *D::iterations(body.state()) = push.iterations;
    Ok(())
}

impl ForceControlled for LoadStepping<'_> {
    type State = Equilibrium;

    fn poses(&mut self) -> &mut [Isometry3<f64>] {
        &mut self.state.poses
    }

    fn clearance(&self, poses: &[Isometry3<f64>]) -> f64 {
        let Self { condensed, state, .. } = self;
        let (rest, displacement) = (condensed.rest.places(), &state.field.displacement);
        let places = condensed.surface.iter().map(|point| point.place(rest, displacement));
        clearance(self.shapes, poses, &places.collect::<Vec<_>>())
    }

    fn attempt(&mut self, poses: &[Isometry3<f64>]) -> Result<Equilibrium> {
        self.attempt(poses)
    }

    fn state(&mut self) -> &mut Equilibrium {
        &mut self.state
    }

    fn tolerance(&self) -> f64 {
        self.settings.tolerance
    }

    fn wrench(state: &Equilibrium) -> &Wrench {
        &state.wrench
    }

    fn iterations(state: &mut Equilibrium) -> &mut usize {
        &mut state.iterations
    }
}

struct Push {
    /// Force asked for (N).
    force: f64,
    /// Error of the force that is always accepted (N).
    tolerance: f64,
    direction: Unit<Vector3<f64>>,
    iterations: usize,
}

impl Push {
    /// Force of a state along the direction (N).
    fn along<D: ForceControlled>(&self, state: &D::State) -> f64 {
        D::wrench(state).force.dot(&self.direction)
    }

    /// Returns whether a force is the one asked for, but for a `relative` error.
    fn is_met(&self, along: f64, relative: f64) -> bool {
        (along - self.force).abs() <= f64::max(relative * self.force, self.tolerance)
    }

    /// Attempts a load step by `travel` (m) and returns the state it ends in.
    fn attempt<D: ForceControlled>(&mut self, body: &mut D, travel: f64) -> Result<D::State> {
        interrupt::check()?;
        let ahead = |pose: &Isometry3<f64>| {
            let mut pose = *pose;
            pose.translation.vector += *self.direction * travel;
            pose
        };
        let poses: Vec<_> = body.poses().iter().map(ahead).collect();
        let mut state = body.attempt(&poses)?;
        self.iterations += *D::iterations(&mut state);
        Ok(state)
    }

    /// Moves the shapes in load steps until the force is met or passed, and then finds it within
    /// the last step; `None` if it is never met.
    fn reach<D: ForceControlled>(&mut self, body: &mut D) -> Option<()> {
        if self.is_met(self.along::<D>(body.state()), SETTLED) {
            // A history does not hold all of its state: it is settled once more.
            if let Ok(state) = self.attempt(body, 0.0)
                && self.is_met(self.along::<D>(&state), SETTLED)
            {
                *body.state() = state;
                return Some(());
            }
        }
        let mut size = EDGE_STEP;
        for _ in 0..MOST {
            // A history may begin with too large a force: then the shapes move back.
            let back = self.along::<D>(body.state()) > self.force;
            let signed = if back { -size } else { size };
            match self.attempt(body, signed) {
                Ok(state) => {
                    let along = self.along::<D>(&state);
                    let is_met = self.is_met(along, RELATIVE);
                    if !is_met && (along > self.force) != back {
                        return self.narrow(body, signed, along);
                    }
                    *body.state() = state;
                    if is_met {
                        return Some(());
                    }
                    size = f64::min(2.0 * size, EDGE_STEP);
                }
                Err(_) => size *= 0.5,
            }
            if size < SHORTEST_STEP {
                break;
            }
        }
        None
    }

    /// Finds the force between the present state and a travel of `far` (m), where it is `there`
    /// (N); `None` if that fails.
    fn narrow<D: ForceControlled>(&mut self, body: &mut D, far: f64, there: f64) -> Option<()> {
        let here = self.along::<D>(body.state());
        let (mut low, mut high) = ((0.0, here - self.force), (far, there - self.force));
        for attempts in 0..MOST {
            let travel = low.0 - low.1 * (high.0 - low.0) / (high.1 - low.1);
            let state = self.attempt(body, travel).ok()?;
            let along = self.along::<D>(&state);
            let relative = match attempts {
                _ if (high.0 - low.0).abs() < SHORTEST_STEP => AT_JUMP,
                0..SOON => RELATIVE,
                _ => SETTLED,
            };
            if self.is_met(along, relative) {
                *body.state() = state;
                return Some(());
            }
            let rest = along - self.force;
            // Illinois variant: the value at an end that stays is halved, so that both ends move.
            if (rest > 0.0) == (high.1 > 0.0) {
                high = (travel, rest);
                low.1 *= 0.5;
            } else {
                low = high;
                high = (travel, rest);
            }
        }
        None
    }
}
