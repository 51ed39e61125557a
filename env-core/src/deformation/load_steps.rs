//! Load stepping: the frames of a press, and their subdivision into load steps.
//!
//! Shapes: S rigid shapes.

use nalgebra::{Isometry3, Unit, Vector3};
use rayon::prelude::*;

use super::{Drive, Press};
use crate::{
    Error, Result,
    interrupt::{self, Interrupt},
};

/// Drive of the shapes in one frame of a press.
#[derive(Clone, Copy, Debug)]
pub(crate) enum FrameDrive<'a> {
    /// Motion to these poses (S).
    Poses(&'a [Isometry3<f64>]),
    /// Motion along `direction` until the shapes press with `force` (N).
    Force { force: f64, direction: &'a Unit<Vector3<f64>> },
}

/// The load step that is tried next.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NextStep {
    /// Part of the motion that is already solved, 0 to 1.
    pub(crate) done: f64,
    /// Step size: 1 at first, halved by a failure and doubled by a success.
    pub(crate) size: f64,
}

impl Press {
    /// Frames of the press, in order.
    pub(crate) fn frames(&self) -> Vec<FrameDrive<'_>> {
        match self.drive() {
            Drive::Translation { path } => {
                path.iter().map(|poses| FrameDrive::Poses(poses)).collect()
            }
            Drive::Force { force, direction, .. } => {
                vec![FrameDrive::Force { force: *force, direction }]
            }
        }
    }
}

/// Results of `solve` for `presses`, solved in parallel, each on one thread that obeys the caller's
/// interrupt.
pub(crate) fn solve_in_parallel<T: Send>(
    presses: &[Press],
    solve: impl Fn(&Press) -> T + Sync,
) -> Vec<T> {
    let interrupt = Interrupt::current();
    presses.par_iter().map(|press| interrupt.during(|| solve(press))).collect()
}

/// Results of `solve` for `frames`; the first that fails, or before which the end is requested, is
/// the last.
pub(crate) fn solve_frames<F, T>(
    frames: impl IntoIterator<Item = F>,
    mut solve: impl FnMut(F) -> Result<T>,
) -> Vec<Result<T>> {
    let mut results = Vec::new();
    for frame in frames {
        results.push(interrupt::check().and_then(|()| solve(frame)));
        if results.last().is_some_and(Result::is_err) {
            break;
        }
    }
    results
}

/// Moves a `solver` from 0 to 1 by load steps of adaptive size. `length` returns the part of the
/// motion that the next step covers, and may lower its size; `solve` is given the part to reach. A
/// step that fails is tried again with half the size if `retry` allows it, given the error and that
/// size. Returns the result of the last step, or the error that ends the motion: a request to end
/// it is obeyed before every step.
pub(crate) fn solve_in_steps<S, T>(
    solver: &mut S,
    length: impl Fn(&S, &mut NextStep) -> f64,
    retry: impl Fn(&S, &Error, NextStep) -> bool,
    mut solve: impl FnMut(&mut S, f64) -> Result<T>,
) -> Result<T> {
    let mut step = NextStep { done: 0.0, size: 1.0 };
    loop {
        interrupt::check()?;
        let next = f64::min(step.done + length(solver, &mut step), 1.0);
        match solve(solver, next) {
            Ok(result) if next == 1.0 => return Ok(result),
            Ok(_) => step = NextStep { done: next, size: 2.0 * step.size },
            Err(error) => {
                step.size *= 0.5;
                if !retry(solver, &error, step) {
                    return Err(error);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHORTEST: f64 = 1.0 / 256.0;
    const REFUSED: Error = Error::Penetrated { depth: 1.0, most: 0.5 };

    /// Parts reached by steps that fail if they are longer than `longest` or lead beyond `end`.
    fn reached(longest: f64, end: f64) -> (Vec<f64>, Result<()>) {
        let mut reached = vec![0.0];
        let result = solve_in_steps(
            &mut reached,
            |_, step| step.size,
            |_, _, step| step.size >= SHORTEST,
            |reached, t| {
                if t - reached.last().unwrap() > longest || t > end {
                    return Err(REFUSED);
                }
                reached.push(t);
                Ok(())
            },
        );
        (reached, result)
    }

    /// Parts tried by steps with this `length` of which the first `failures` fail.
    fn tried(failures: usize, length: impl Fn(&mut NextStep) -> f64) -> Vec<f64> {
        let mut tried = Vec::new();
        let result = solve_in_steps(
            &mut tried,
            |_, step| length(step),
            |_, _, _| true,
            |tried, t| {
                tried.push(t);
                if tried.len() > failures { Ok(()) } else { Err(REFUSED) }
            },
        );
        assert!(result.is_ok());
        tried
    }

    #[test]
    fn a_motion_is_solved_in_steps_that_are_short_enough() {
        for longest in [1.0, 0.6, 0.3, 0.005] {
            let (reached, result) = reached(longest, 1.0);
            assert!(result.is_ok() && reached.last() == Some(&1.0), "{longest}: {reached:?}");
        }
    }

    #[test]
    fn a_motion_that_ends_is_followed_to_within_the_shortest_step() {
        let (reached, result) = reached(0.3, 0.7);
        let left = 0.7 - reached.last().unwrap();
        assert!(result.is_err() && (0.0..SHORTEST).contains(&left), "{left} left of 0.7");
    }

    #[test]
    fn a_size_that_was_lowered_is_doubled_from_there() {
        let lowered = |step: &mut NextStep| {
            step.size = step.size.min(if step.done < 0.5 { 0.125 } else { 1.0 });
            step.size
        };
        assert_eq!(tried(0, lowered), [0.125, 0.25, 0.375, 0.5, 0.75, 1.0]);
        assert_eq!(tried(1, lowered), [0.125, 0.0625, 0.1875, 0.3125, 0.4375, 0.5625, 0.8125, 1.0]);
    }

    #[test]
    fn a_length_can_be_a_multiple_of_the_size() {
        let at_most_quarter = |step: &mut NextStep| {
            step.size = step.size.min(1.0);
            0.25 * step.size
        };
        assert_eq!(tried(0, at_most_quarter), [0.25, 0.5, 0.75, 1.0]);
        assert_eq!(tried(1, at_most_quarter), [0.25, 0.125, 0.375, 0.625, 0.875, 1.0]);
    }

    #[test]
    fn frames_end_with_the_first_that_fails() {
        let results = solve_frames(1..5, |i| if i < 3 { Ok(i) } else { Err(REFUSED) });
        assert_eq!(results, [Ok(1), Ok(2), Err(REFUSED)]);
    }

    #[test]
    fn frames_and_load_steps_end_when_it_is_requested() {
        let interrupt = Interrupt::default();
        let requested_at_two = |i| {
            if i == 2 {
                interrupt.request();
            }
            Ok(i)
        };
        let results = interrupt.during(|| solve_frames(1..5, requested_at_two));
        assert_eq!(results, [Ok(1), Ok(2), Err(Error::Interrupted)]);
        let mut tried = 0;
        let result = interrupt.during(|| {
            solve_in_steps(
                &mut tried,
                |_, step| step.size,
                |_, _, _| true,
                |tried, _| {
                    *tried += 1;
                    Ok(())
                },
            )
        });
        assert_eq!((result, tried), (Err(Error::Interrupted), 0));
    }
}
