//! Adaptive subdivision of load steps.

use crate::{Error, Result};

/// Smallest part of a load step that is tried on its own.
pub(super) const SHORTEST: f64 = 1.0 / 256.0;

/// Advances from 0 to 1 by calls of `step`, each given the part to reach. The stride is halved
/// after a call that does not converge or ends too deep, and doubled after one that succeeds.
/// Returns the result of the last call, or the error of a failed call once the stride is below
/// `shortest` of the part done.
pub(super) fn in_steps<T>(
    shortest: impl Fn(f64) -> f64,
    mut step: impl FnMut(f64) -> Result<T>,
) -> Result<T> {
    let (mut done, mut stride) = (0.0, 1.0);
    loop {
        let next = f64::min(done + stride, 1.0);
        match step(next) {
            Ok(found) if next == 1.0 => return Ok(found),
            Ok(_) => (done, stride) = (next, 2.0 * stride),
            Err(error @ (Error::NotConverged { .. } | Error::Penetrated { .. })) => {
                stride *= 0.5;
                if stride < shortest(done) {
                    return Err(error);
                }
            }
            Err(error) => return Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parts reached by steps of at most `longest` that fail beyond `end`.
    fn taken(longest: f64, end: f64) -> (Vec<f64>, Result<()>) {
        let mut taken = vec![0.0];
        let refused = Error::Penetrated { depth: 1.0, most: 0.5 };
        let gone = in_steps(
            |_| SHORTEST,
            |t| {
                if t - taken.last().unwrap() > longest || t > end {
                    return Err(refused.clone());
                }
                taken.push(t);
                Ok(())
            },
        );
        (taken, gone)
    }

    #[test]
    fn a_way_is_taken_in_steps_that_are_short_enough() {
        for longest in [1.0, 0.6, 0.3, 0.005] {
            let (taken, gone) = taken(longest, 1.0);
            assert!(gone.is_ok() && taken.last() == Some(&1.0), "{longest}: {taken:?}");
        }
    }

    #[test]
    fn a_way_that_ends_is_followed_to_within_the_shortest_step() {
        let (taken, gone) = taken(0.3, 0.7);
        let left = 0.7 - taken.last().unwrap();
        assert!(gone.is_err() && (0.0..SHORTEST).contains(&left), "{left} left of 0.7");
    }
}
