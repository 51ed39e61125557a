//! HoldStill: the disturbance of a held object, and the limits of slip and grip force.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::Range;

/// Settings of a held object and its disturbance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Holding {
    /// Downward force in addition to the object's weight (N).
    pub load: Range,
    /// Amplitude of the shaking force (N).
    pub shaking: Range,
    /// Frequency of the shaking force (Hz).
    pub frequency: Range,
    /// Largest slip of an object that counts as held still (m).
    pub slip_limit: f64,
    /// Largest mean grip force of a success, relative to the least that holds against the largest
    /// force ([`Shaking::largest`]).
    pub thrift: f64,
}

impl Default for Holding {
    fn default() -> Self {
        Self {
            load: [0.0, 1.5],
            shaking: [0.3, 1.5],
            frequency: [0.5, 2.0],
            slip_limit: 3e-3,
            thrift: 3.0,
        }
    }
}

/// Time over which load and shaking grow to their full size (s).
const ONSET: f64 = 0.5;

/// Disturbing force of an episode on its object: a load, and a sine along one direction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shaking {
    /// Downward force (N).
    pub load: f64,
    /// Amplitude along x, y, z of the world (N).
    pub amplitude: [f64; 3],
    /// Frequency (Hz).
    pub frequency: f64,
}

impl Shaking {
    /// Force at `time` since the start of the episode (N), in the world.
    pub fn force(&self, time: f64) -> Vector3<f64> {
        let swing = (TAU * self.frequency * time).sin();
        let force = swing * Vector3::from(self.amplitude) - self.load * Vector3::z();
        (time / ONSET).clamp(0.0, 1.0) * force
    }

    /// Largest magnitude of this force together with a `weight` (N), after its onset, in N.
    pub fn largest(&self, weight: f64) -> f64 {
        let (mean, swing) = (-(self.load + weight) * Vector3::z(), Vector3::from(self.amplitude));
        (mean + swing).norm().max((mean - swing).norm())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_force_comes_on_from_zero_and_has_the_load_as_its_mean() {
        let shaking = Shaking { load: 1.2, amplitude: [0.3, 0.0, -0.4], frequency: 2.0 };
        assert_eq!(shaking.force(0.0), Vector3::zeros());
        let period = (0..100).map(|i| shaking.force(1.0 + 0.005 * f64::from(i)));
        let mean: Vector3<f64> = period.sum::<Vector3<f64>>() / 100.0;
        assert!((mean - Vector3::new(0.0, 0.0, -1.2)).norm() < 1e-9, "{mean:?} N");
        let peak = shaking.force(1.125);
        assert!((peak - Vector3::new(0.3, 0.0, -1.6)).norm() < 1e-9, "{peak:?} N");
        let largest = shaking.largest(0.9);
        assert!((largest - 0.3f64.hypot(2.5)).abs() < 1e-12, "{largest} N");
    }
}
