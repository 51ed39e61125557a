//! Force control: how far the shapes must travel to press with a given force.

use nalgebra::{Isometry3, Unit, Vector3};

use super::{
    path::EDGE_STRIDE,
    walk::{State, Walk},
};
use crate::{Error, Result, contact::clearance, geometry::Shape};

/// Shapes pushed this far without a touch will not meet the body (m).
const FARTHEST: f64 = 1.0;
/// Least travel that is tried (m).
const SHORTEST_STRIDE: f64 = 1e-9;
/// Error of the force that is accepted, relative.
const RELATIVE: f64 = 1e-6;
/// Most load steps.
const MOST: usize = 200;

/// Moves the shapes along `direction` until they press with `force` (N): by strides to where
/// they press harder, then by the Illinois form of false position within the last stride.
pub(super) fn push(
    walk: &mut Walk,
    shapes: &[Shape],
    force: f64,
    direction: &Unit<Vector3<f64>>,
) -> Result<()> {
    let mut push = Push { shapes, force, direction: *direction, iterations: 0 };
    let begin = walk.state.poses[0].translation.vector;
    let pushed = walk.meet(shapes, direction, FARTHEST) && push.reach(walk).is_some();
    if !pushed {
        let travel = (walk.state.poses[0].translation.vector - begin).norm();
        return Err(Error::Unreachable { force, reached: push.along(&walk.state), travel });
    }
    walk.state.iterations = push.iterations;
    Ok(())
}

impl Walk<'_> {
    /// Moves the shapes along `direction` until the first of them touches, at most by `farthest` (m);
    /// whether one does. A step as long as the least distance cannot pass the body.
    fn meet(&mut self, shapes: &[Shape], direction: &Vector3<f64>, farthest: f64) -> bool {
        let surface = self.condensed.rest.surface();
        let (rest, displacement) = (self.condensed.rest.places(), &self.state.field.displacement);
        let places: Vec<_> = surface.iter().map(|point| point.place(rest, displacement)).collect();
        let mut travel = 0.0;
        while travel < farthest {
            let gap = clearance(shapes, &self.state.poses, &places);
            if gap < 0.0 {
                return true;
            }
            let stride = gap.max(self.settings.law.softness);
            travel += stride;
            for pose in &mut self.state.poses {
                pose.translation.vector += direction * stride;
            }
        }
        false
    }
}

struct Push<'a> {
    shapes: &'a [Shape],
    /// Force asked for (N).
    force: f64,
    direction: Unit<Vector3<f64>>,
    iterations: usize,
}

impl Push<'_> {
    /// Force of a state along the direction (N).
    fn along(&self, state: &State) -> f64 {
        state.wrench.force.dot(&self.direction)
    }

    fn is_met(&self, state: &State) -> bool {
        (self.along(state) - self.force).abs() <= RELATIVE * self.force
    }

    /// Where the shapes press after `travel` from the walk's state.
    fn attempt(&mut self, walk: &mut Walk, travel: f64) -> Result<State> {
        let ahead = |pose: &Isometry3<f64>| {
            let mut pose = *pose;
            pose.translation.vector += *self.direction * travel;
            pose
        };
        let poses: Vec<_> = walk.state.poses.iter().map(ahead).collect();
        let state = walk.attempt(self.shapes, &poses)?;
        self.iterations += state.iterations;
        Ok(state)
    }

    /// Strides until the force is met; `None` if it never is.
    fn reach(&mut self, walk: &mut Walk) -> Option<()> {
        let mut stride = EDGE_STRIDE;
        for _ in 0..MOST {
            // A history may begin with a force that is too great: then the way is back.
            let back = self.along(&walk.state) > self.force;
            let signed = if back { -stride } else { stride };
            match self.attempt(walk, signed) {
                Ok(state) if self.is_met(&state) => {
                    walk.state = state;
                    return Some(());
                }
                Ok(state) if (self.along(&state) > self.force) != back => {
                    return self.narrow(walk, signed, self.along(&state));
                }
                Ok(state) => {
                    walk.state = state;
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

    /// Finds the force between the walk's state and a `far` travel at which it is `there`.
    fn narrow(&mut self, walk: &mut Walk, far: f64, there: f64) -> Option<()> {
        let (mut low, mut high) =
            ((0.0, self.along(&walk.state) - self.force), (far, there - self.force));
        for _ in 0..MOST {
            let travel = low.0 - low.1 * (high.0 - low.0) / (high.1 - low.1);
            let state = self.attempt(walk, travel).ok()?;
            if self.is_met(&state) {
                walk.state = state;
                return Some(());
            }
            let rest = self.along(&state) - self.force;
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
