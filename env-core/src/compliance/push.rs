//! Force control: how far the shapes must travel to press with a given force.

use nalgebra::{Isometry3, Unit, Vector3};

use super::{
    path::EDGE_STRIDE,
    walk::{State, Walk},
};
use crate::{Error, Result, contact::clearance, deformation::Wrench, geometry::Shape};

/// Shapes pushed this far without a touch will not meet the body (m).
const FARTHEST: f64 = 1.0;
/// Least travel that is tried (m).
const SHORTEST_STRIDE: f64 = 1e-9;
/// Distance of a body that is as good as touched (m).
const NEAR: f64 = 2e-6;
/// Error of the force that is accepted, relative, where it is not below what balance is found to.
const RELATIVE: f64 = 1e-6;
/// Most load steps.
const MOST: usize = 200;

/// A body with shapes that can be tried at other poses.
pub(super) trait Driven {
    /// Body and shapes in balance.
    type State;

    /// Poses of the shapes (S).
    fn poses(&mut self) -> &mut [Isometry3<f64>];
    /// Least distance of the shapes to the body (m).
    fn clearance(&self) -> f64;
    /// Where one load step to `poses` leads.
    fn attempt(&mut self, poses: &[Isometry3<f64>]) -> Result<Self::State>;
    /// The present state.
    fn state(&mut self) -> &mut Self::State;
    /// Force that a state may leave out of balance (N).
    fn tolerance(&self) -> f64;
    /// What the shapes exert in a state.
    fn wrench(state: &Self::State) -> &Wrench;
    /// Steps that were taken to a state.
    fn iterations(state: &mut Self::State) -> &mut usize;
}

/// Moves the shapes along `direction` until they press with `force` (N): by strides to where
/// they press harder, then by the Illinois form of false position within the last stride.
pub(super) fn push<D: Driven>(
    body: &mut D,
    force: f64,
    direction: &Unit<Vector3<f64>>,
) -> Result<()> {
    let accepted = f64::max(RELATIVE * force, body.tolerance());
    let mut push = Push { force, accepted, direction: *direction, iterations: 0 };
    let begin = body.poses()[0].translation.vector;
    let pushed = meet(body, direction, FARTHEST) && push.reach(body).is_some();
    if !pushed {
        let travel = (body.poses()[0].translation.vector - begin).norm();
        return Err(Error::Unreachable { force, reached: push.along::<D>(body.state()), travel });
    }
    *D::iterations(body.state()) = push.iterations;
    Ok(())
}

/// Moves the shapes along `direction` until the first of them is near, at most by `farthest` (m);
/// whether one is. A step as long as the least distance cannot pass the body, nor touch it: the force
/// there is what the state says, nothing.
fn meet<D: Driven>(body: &mut D, direction: &Vector3<f64>, farthest: f64) -> bool {
    let mut travel = 0.0;
    while travel < farthest {
        let gap = body.clearance();
        if gap < NEAR {
            return true;
        }
        travel += gap;
        for pose in body.poses() {
            pose.translation.vector += direction * gap;
        }
    }
    false
}

/// A walk with the shapes that it leads.
pub(super) struct Led<'a, 'b> {
    pub(super) walk: &'a mut Walk<'b>,
    pub(super) shapes: &'a [Shape],
}

impl Driven for Led<'_, '_> {
    type State = State;

    fn poses(&mut self) -> &mut [Isometry3<f64>] {
        &mut self.walk.state.poses
    }

    fn clearance(&self) -> f64 {
        let Walk { condensed, state, .. } = &*self.walk;
        let (rest, displacement) = (condensed.rest.places(), &state.field.displacement);
        let places = condensed.surface.iter().map(|point| point.place(rest, displacement));
        clearance(self.shapes, &state.poses, &places.collect::<Vec<_>>())
    }

    fn attempt(&mut self, poses: &[Isometry3<f64>]) -> Result<State> {
        self.walk.attempt(self.shapes, poses)
    }

    fn state(&mut self) -> &mut State {
        &mut self.walk.state
    }

    fn tolerance(&self) -> f64 {
        self.walk.settings.tolerance
    }

    fn wrench(state: &State) -> &Wrench {
        &state.wrench
    }

    fn iterations(state: &mut State) -> &mut usize {
        &mut state.iterations
    }
}

struct Push {
    /// Force asked for, and its error that is accepted (N).
    force: f64,
    accepted: f64,
    direction: Unit<Vector3<f64>>,
    iterations: usize,
}

impl Push {
    /// Force of a state along the direction (N).
    fn along<D: Driven>(&self, state: &D::State) -> f64 {
        D::wrench(state).force.dot(&self.direction)
    }

    fn is_met(&self, along: f64) -> bool {
        (along - self.force).abs() <= self.accepted
    }

    /// Where the shapes press after `travel` from the present state.
    fn attempt<D: Driven>(&mut self, body: &mut D, travel: f64) -> Result<D::State> {
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

    /// Strides until the force is met; `None` if it never is.
    fn reach<D: Driven>(&mut self, body: &mut D) -> Option<()> {
        let mut stride = EDGE_STRIDE;
        for _ in 0..MOST {
            // A history may begin with a force that is too great: then the way is back.
            let back = self.along::<D>(body.state()) > self.force;
            let signed = if back { -stride } else { stride };
            match self.attempt(body, signed) {
                Ok(state) => {
                    let along = self.along::<D>(&state);
                    if !self.is_met(along) && (along > self.force) != back {
                        return self.narrow(body, signed, along);
                    }
                    *body.state() = state;
                    if self.is_met(along) {
                        return Some(());
                    }
                    stride = f64::min(2.0 * stride, EDGE_STRIDE);
                }
                Err(_) => stride *= 0.5,
            }
            if stride < SHORTEST_STRIDE {
                break;
            }
        }
        None
    }

    /// Finds the force between the present state and a `far` travel at which it is `there`.
    fn narrow<D: Driven>(&mut self, body: &mut D, far: f64, there: f64) -> Option<()> {
        let here = self.along::<D>(body.state());
        let (mut low, mut high) = ((0.0, here - self.force), (far, there - self.force));
        for _ in 0..MOST {
            let travel = low.0 - low.1 * (high.0 - low.0) / (high.1 - low.1);
            let state = self.attempt(body, travel).ok()?;
            let along = self.along::<D>(&state);
            if self.is_met(along) {
                *body.state() = state;
                return Some(());
            }
            let rest = along - self.force;
            // Illinois: an end that stays counts half, so that both ends close in.
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
