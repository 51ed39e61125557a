//! Defect correction: the bed made to press as a better model of the gel does.
//!
//! The model's wrench at a pose of the object is compared with the bed's at the same pose. The
//! normal force is corrected by a factor, which keeps the bed's steep law and vanishes with the
//! touch; what is left, friction and torque, by a constant wrench. Where the pose stays, bed and
//! correction converge to the model: the factor as (1 − 0.6 μ/β)ᵏ with the exponents μ of the
//! model's and β of the bed's force law, the rest as (1 − 0.4 K_model/K_bed)ᵏ, which is stable up to a
//! model five times as stiff as the bed.

use serde::{Deserialize, Serialize};

use super::touch::cut;
use crate::scene::Wrench;

/// Share of a difference that one correction takes up: of the normal force, and of the rest.
const PRESSING: f64 = 0.6;
const REST: f64 = 0.4;
/// Least and greatest factor on the normal force.
const GAIN: std::ops::RangeInclusive<f64> = 0.25..=4.0;
/// Largest sideways force of a correction, of the normal force.
const SIDEWAYS: f64 = 0.5;
/// Largest torque of a correction over the normal force (m).
const LEVER: f64 = 3e-3;
/// Normal force below which there is nothing to correct (N).
const FAINTEST: f64 = 1e-3;

/// Correction of one finger.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Correction {
    /// Factor on the normal force.
    pub(super) gain: f64,
    /// On the pad, in its frame about its origin, where the bed presses with `force`.
    extra: Wrench,
    /// Normal force at which `extra` was found (N).
    force: f64,
}

impl Default for Correction {
    fn default() -> Self {
        Self { gain: 1.0, extra: Wrench::default(), force: 0.0 }
    }
}

impl Correction {
    /// Takes up the difference between the `model`'s wrench and that of the bed, which `bed` gives at
    /// any gain. Without a touch of both there is no correction.
    pub(super) fn toward(&mut self, model: &Wrench, bed: impl Fn(f64) -> Wrench) {
        if !self.press(-model.force.z, &bed) {
            return;
        }
        let bed = bed(self.gain);
        let now = self.at(-bed.force.z);
        self.force = -bed.force.z;
        let mut extra = Wrench {
            force: now.force + REST * (model.force - bed.force - now.force),
            torque: now.torque + REST * (model.torque - bed.torque - now.torque),
        };
        // The factor alone answers for the normal force.
        extra.force.z = 0.0;
        extra.force = cut(&extra.force, SIDEWAYS * self.force);
        extra.torque = cut(&extra.torque, LEVER * self.force);
        self.extra = extra;
    }

    /// As [`Correction::toward`], of the normal force alone: the model wants it to be `wanted` (N).
    /// Whether both touch.
    pub(super) fn press(&mut self, wanted: f64, bed: impl Fn(f64) -> Wrench) -> bool {
        let found = -bed(self.gain).force.z;
        if !(wanted > FAINTEST && found > FAINTEST) {
            *self = Self::default();
            return false;
        }
        let gain = self.gain * (wanted / found).powf(PRESSING);
        self.gain = gain.clamp(*GAIN.start(), *GAIN.end());
        true
    }

    /// The constant part where the bed presses with `force` (N): it fades with the touch.
    pub(super) fn at(&self, force: f64) -> Wrench {
        if self.force <= 0.0 {
            return Wrench::default();
        }
        let share = (force / self.force).clamp(0.0, 1.0);
        Wrench { force: share * self.extra.force, torque: share * self.extra.torque }
    }
}
