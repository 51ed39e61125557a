//! Solution of one grasp, frame by frame with growing force.
//!
//! A grasp has four phases: the object is placed in its frame, the pads are placed on either side
//! of it, each closes until it touches, and then both close together until the force is reached.
//! The closing of the next frame is extrapolated from the last: force grows with about the 1.9th
//! power of depth (measured on a `GelSight` Mini). Frames in which the object is not held yet are
//! discarded.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::{plan::Plan, weight::Weight};
use crate::{
    Error, Result,
    deformation::Wrench,
    fem::{Fem, Grasped, Hold},
    geometry::Shape,
    objects::Hand,
};

/// Limits of a grasp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ramp {
    /// Greatest number of frames.
    pub(super) frames: usize,
    /// Closing of each pad at which the grasp ends, whatever its force (m).
    pub(super) depth: f64,
}

/// Solved frame of a grasp.
#[derive(Clone, Debug)]
pub(super) struct GraspFrame {
    /// Closing of each pad since first touch (m).
    pub(super) closing: f64,
    /// Force with which the pads are pressed together, the mean of both (N).
    pub(super) force: f64,
    /// Poses of the pads in the object's initial frame.
    pub(super) pads: [Isometry3<f64>; 2],
    /// Weight of the object that the pads bear (N, N m about its origin), in the object's initial
    /// frame.
    pub(super) load: Wrench,
    /// Equilibrium of pads and object.
    pub(super) grasped: Grasped,
}

/// Exponent of force over depth by which steps are chosen.
const EXPONENT: f64 = 1.9;
/// Force above which an object counts as held (N): a free one may lie against a pad without force.
const HELD: f64 = 1e-4;
/// Closing of the first frame and shortest step, over the depth.
const STEPS: [f64; 2] = [0.03, 0.001];
/// Longest step, over the depth, for a grasp of many frames. With few frames it is longer, see
/// [`COVER`].
const LONGEST_STEP: f64 = 0.1;
/// Smallest number of times that the longest steps of all frames together cover the depth.
const COVER: f64 = 1.5;
/// Initial distance of each pad from its contact (m).
const OPEN: f64 = 0.005;
/// Distance at which a pad counts as touching (m).
const TOUCH: f64 = 1e-7;

impl Ramp {
    /// Solves the frames of `plan`; returns them with the error that ended the grasp before its
    /// force, depth or last frame.
    pub(super) fn solve(
        &self,
        plan: &Plan,
        object: &Shape,
        weight: &Weight,
        pad: &Fem,
    ) -> (Vec<GraspFrame>, Option<Error>) {
        let mesh = pad.body().mesh();
        let gap = |pose: &Isometry3<f64>| {
            let distance = |p: &Point3<f64>| object.distance(&(*pose * p)).value;
            mesh.vertices.iter().map(distance).fold(f64::INFINITY, f64::min)
        };
        let start = Isometry3::identity();
        let hold = touching(plan, gap).and_then(|touching| {
            let hold = Hold::new(object, start, [pad; 2], &touching, Wrench::default())?;
            Ok((touching, hold))
        });
        let (touching, mut hold) = match hold {
            Ok(hold) => hold,
            Err(error) => return (Vec::new(), Some(error)),
        };
        let mut load = Wrench::default();
        self.climb(plan.force, |closing| {
            let pads = plan.closed(&touching, closing);
            hold.bear(load);
            let frame = GraspFrame::new(closing, pads, load, hold.frame(&pads)?);
            load = weight.borne(frame.force, &frame.grasped.object);
            Ok((frame.force, frame))
        })
    }

    /// Calls `close` with growing closings until the force it returns reaches `target` (N). Returns
    /// the frames that it gave, and the error that ended the grasp early.
    pub(super) fn climb<F>(
        &self,
        target: f64,
        mut close: impl FnMut(f64) -> Result<(f64, F)>,
    ) -> (Vec<F>, Option<Error>) {
        let mut frames = Vec::with_capacity(self.frames);
        let (mut closing, mut force) = (0.0, 0.0);
        while frames.len() < self.frames && force < target && closing < self.depth {
            let wanted = target * (frames.len() + 1) as f64 / self.frames as f64;
            closing += self.step(closing, force, wanted);
            match close(closing) {
                Ok((reached, frame)) => {
                    force = reached;
                    if force > HELD {
                        frames.push(frame);
                    }
                }
                Err(error) => return (frames, Some(error)),
            }
        }
        let loose = Error::Unreachable { force: target, reached: force, travel: closing };
        let error = frames.is_empty().then_some(loose);
        (frames, error)
    }

    /// Further closing (m) from `closing` at `force` to reach a force of `wanted` (N).
    fn step(&self, closing: f64, force: f64, wanted: f64) -> f64 {
        let longest = LONGEST_STEP.max(COVER / self.frames as f64);
        let [first, shortest, longest] =
            [STEPS[0], STEPS[1], longest].map(|share| share * self.depth);
        let predicted = if force > HELD {
            closing * ((wanted / force).powf(1.0 / EXPONENT) - 1.0)
        } else {
            first
        };
        predicted.clamp(shortest, longest).min((self.depth - closing).max(shortest))
    }
}

impl GraspFrame {
    fn new(closing: f64, pads: [Isometry3<f64>; 2], load: Wrench, grasped: Grasped) -> Self {
        let pressure = |i: usize| -> f64 { -grasped.pads[i].wrench.force.z };
        Self { closing, force: 0.5 * (pressure(0) + pressure(1)), pads, load, grasped }
    }
}

impl Plan {
    /// Poses of the pads after each has closed by `closing` (m) from its pose in `touching`: the
    /// first moves straight, the second also shears and twists.
    pub(super) fn closed(
        &self,
        touching: &[Isometry3<f64>; 2],
        closing: f64,
    ) -> [Isometry3<f64>; 2] {
        let ahead = Isometry3::translation(0.0, 0.0, closing);
        let [x, y] = self.shear.map(|share| share * closing);
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.twist * closing);
        let astray = Isometry3::from_parts(Translation3::new(x, y, closing), turn);
        [touching[0] * ahead, touching[1] * astray]
    }
}

/// Poses of the pads or fingers in the object's frame at first touch. `gap` gives the distance (m)
/// to the object at a pose.
pub(super) fn touching(
    plan: &Plan,
    gap: impl Fn(&Isometry3<f64>) -> f64,
) -> Result<[Isometry3<f64>; 2]> {
    let mut pads = Hand::pads(&plan.tool, plan.width + 2.0 * OPEN);
    for pose in &mut pads {
        let mut travel = 0.0;
        loop {
            let free = gap(pose);
            if free < TOUCH {
                break;
            }
            travel += free;
            if travel > plan.width + 2.0 * OPEN {
                let found = format!("no touch within {travel:.4} m of {}", plan.name);
                return Err(Error::invalid("grasp", found, "an object between the pads"));
            }
            *pose *= Isometry3::translation(0.0, 0.0, free);
        }
    }
    Ok(pads)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Closings and forces of a grasp whose force grows to 40 N at 2 mm, half of a thickness of 4
    /// mm.
    fn climbed(frames: usize, target: f64) -> Vec<(f64, f64)> {
        let close = |closing: f64| {
            let force = 40.0 * (closing / 0.002).powf(EXPONENT);
            Ok((force, (closing, force)))
        };
        let (frames, error) = Ramp { frames, depth: 0.002 }.climb(target, close);
        assert!(error.is_none(), "{error:?}");
        frames
    }

    #[test]
    fn few_frames_and_many_reach_the_depth_or_the_force() {
        for frames in [3, 5, 10, 50] {
            let &(closing, _) = climbed(frames, 1000.0).last().unwrap();
            assert!(closing > 0.002 - 1e-12, "{frames} frames close by {closing} m of 0.002 m");
            for target in [2.0, 10.0, 30.0] {
                let &(_, force) = climbed(frames, target).last().unwrap();
                assert!(force > 0.99 * target, "{frames} frames reach {force} N of {target} N");
            }
        }
    }
}
