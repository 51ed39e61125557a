//! Random lengths and directions.

use nalgebra::{Unit, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Random numbers for member `index` of a family of `count`.
pub(super) struct Draw {
    random: ChaCha8Rng,
    index: u32,
    count: u32,
}

impl Draw {
    pub(super) fn new(seed: u64, index: u32, count: u32) -> Self {
        Self { random: ChaCha8Rng::seed_from_u64(seed), index, count }
    }

    /// Uniform number from `low` to `high`.
    pub(super) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.random.random::<f64>()
    }

    /// Uniform number from this member's part of the range; the parts of all members cover the
    /// range.
    pub(super) fn spread(&mut self, low: f64, high: f64) -> f64 {
        let share = (f64::from(self.index) + self.random.random::<f64>()) / f64::from(self.count);
        low + (high - low) * share
    }

    /// Returns `true` with probability one half.
    pub(super) fn coin(&mut self) -> bool {
        self.random.random()
    }

    /// Random direction by rejection from the cube. The square root is the only function used, so
    /// the result is the same on every platform.
    pub(super) fn direction(&mut self) -> Unit<Vector3<f64>> {
        loop {
            let v = Vector3::from_fn(|_, _| self.uniform(-1.0, 1.0));
            if (0.01..1.0).contains(&v.norm_squared()) {
                return Unit::new_normalize(v);
            }
        }
    }
}
