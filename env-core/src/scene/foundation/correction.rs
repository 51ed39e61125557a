//! Defect correction of the elastic foundation towards a more accurate model of the gel.
//!
//! The wrench of the model at a pose of the object is compared with that of the foundation at the
//! same pose. The normal force is corrected by a factor, which keeps the foundation's steep force
//! law and vanishes with the contact; the remainder, friction and torque, by a constant wrench. At
//! a constant load, foundation and correction converge to the model: the factor as (1 − 0.8 μ/β)ᵏ
//! in k corrections, with the exponents μ of the model's and β of the foundation's force law; the
//! remainder at once where both are as stiff. Where the model is stiffer, a correction of the whole
//! remainder goes too far, which shows in the next as a remainder of the other sign; of such a
//! component 0.6 is removed, and it vanishes as (1 − 0.6 K_model/K_foundation)ᵏ, which is stable up
//! to a model three times as stiff as the foundation.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::touch::cut;
use crate::deformation::Wrench;

/// Exponent of one correction of the factor on the normal force, after the first.
const PRESSING: f64 = 0.8;
/// Fraction of the remaining difference that one correction removes where the last went too far.
const REST: f64 = 0.6;
/// Range of the factor on the normal force.
const GAIN: std::ops::RangeInclusive<f64> = 0.25..=4.0;
/// Largest sideways force of a correction over the normal force.
const SIDEWAYS: f64 = 0.5;
/// Largest torque of a correction over the normal force (m).
const LEVER: f64 = 3e-3;
/// Normal force below which no correction is made (N).
const FAINTEST: f64 = 1e-3;

/// Correction of one finger.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Correction {
    /// Factor on the normal force.
    pub(super) gain: f64,
    /// Wrench on the pad, in its frame about its origin, at a normal force of `force`.
    extra: Wrench,
    /// Normal force at which `extra` was found (N).
    force: f64,
    /// Wrench that was missing from `extra` at the last correction.
    missing: Wrench,
}

impl Default for Correction {
    fn default() -> Self {
        Self { gain: 1.0, extra: Wrench::default(), force: 0.0, missing: Wrench::default() }
    }
}

impl Correction {
    /// Corrects towards the wrench of `model`; `foundation` returns the foundation's wrench for any
    /// gain.
    /// Resets the correction unless both have contact.
    pub(super) fn toward(&mut self, model: &Wrench, foundation: impl Fn(f64) -> Wrench) {
        if !self.press(-model.force.z, &foundation) {
            return;
        }
        let foundation = foundation(self.gain);
        let now = self.at(-foundation.force.z);
        self.force = -foundation.force.z;
        let missing = Wrench {
            force: model.force - foundation.force - now.force,
            torque: model.torque - foundation.torque - now.torque,
        };
        let mut extra = Wrench {
            force: now.force + removed(&missing.force, &self.missing.force),
            torque: now.torque + removed(&missing.torque, &self.missing.torque),
        };
        self.missing = missing;
        // The normal force is corrected by the factor alone.
        extra.force.z = 0.0;
        extra.force = cut(&extra.force, SIDEWAYS * self.force);
        extra.torque = cut(&extra.torque, LEVER * self.force);
        self.extra = extra;
    }

    /// Corrects only the normal force, towards `wanted` (N); see [`Correction::toward`]. Returns
    /// whether both have contact.
    pub(super) fn press(&mut self, wanted: f64, foundation: impl Fn(f64) -> Wrench) -> bool {
        let found = -foundation(self.gain).force.z;
        if !(wanted > FAINTEST && found > FAINTEST) {
            *self = Self::default();
            return false;
        }
        let is_first = self.gain == 1.0;
        let gain = self.gain * (wanted / found).powf(if is_first { 1.0 } else { PRESSING });
        self.gain = gain.clamp(*GAIN.start(), *GAIN.end());
        true
    }

    /// Constant part of the correction, reduced in proportion where the normal force `force` (N) is
    /// below that at which it was found.
    pub(super) fn at(&self, force: f64) -> Wrench {
        if self.force <= 0.0 {
            return Wrench::default();
        }
        let share = (force / self.force).clamp(0.0, 1.0);
        Wrench { force: share * self.extra.force, torque: share * self.extra.torque }
    }
}

/// Part of `missing` that one correction removes, if `before` was missing at the last one.
fn removed(missing: &Vector3<f64>, before: &Vector3<f64>) -> Vector3<f64> {
    missing.zip_map(
        before,
        |missing, before| {
            if missing * before < 0.0 { REST * missing } else { missing }
        },
    )
}
