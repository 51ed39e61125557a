//! Settings of the errors of sensors: noise, gain, offset, drift, hysteresis, dead points and delay
//! of observed channels; [`super::FaultySensors`] draws and applies them.
//!
//! An error is given for all entries of a channel, or for each of its quantities: a wrench has
//! forces in N and torques in N m.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer, Serialize, de::Error as _};
use serde_json::Value;

use super::{
    Range, StateChannel,
    setting::{RANGE, range_of, rising, whole_within, within},
};
use crate::{Error, Result, tactile::Channel};

/// Errors of one channel; by default it has none. Ranges are drawn from at each reset for each pad.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SensorError {
    /// Standard deviation of white noise, in the unit of each entry.
    pub noise: ErrorRange,
    /// Factor on the values.
    pub gain: ErrorRange,
    /// Standard deviation of what is added to an entry throughout an episode.
    pub offset: ErrorRange,
    /// Standard deviation of the drift of an entry after one second, in its unit; it grows with the
    /// square root of time, whatever the control period.
    pub drift: ErrorRange,
    /// Half of the width of the loop between loading and unloading, in the unit of each entry.
    pub hysteresis: ErrorRange,
    /// Probability that a point, such as a marker, reads zero throughout an episode.
    pub dead: f64,
    /// Control steps by which the values are late.
    pub delay: usize,
}

impl Default for SensorError {
    fn default() -> Self {
        let none = || ErrorRange::All([0.0; 2]);
        Self {
            noise: none(),
            gain: ErrorRange::All([1.0; 2]),
            offset: none(),
            drift: none(),
            hysteresis: none(),
            dead: 0.0,
            delay: 0,
        }
    }
}

/// Range of an error, in the unit of each entry.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum ErrorRange {
    /// One range for all entries of a channel.
    All(Range),
    /// By the name of the quantity; those without a name here have no such error.
    ByQuantity(BTreeMap<String, Range>),
}

impl ErrorRange {
    /// Each range, with the name of its quantity if it is of one.
    fn ranges(&self) -> Vec<(Option<&str>, Range)> {
        match self {
            Self::All(range) => vec![(None, *range)],
            Self::ByQuantity(ranges) => {
                ranges.iter().map(|(name, range)| (Some(name.as_str()), *range)).collect()
            }
        }
    }

    /// Value at `share` (0 to 1) of the way through the range of `quantity`; `none` without one.
    pub(super) fn at(&self, quantity: &str, share: f64, none: f64) -> f64 {
        let [low, high] = match self {
            Self::All(range) => *range,
            Self::ByQuantity(ranges) => ranges.get(quantity).copied().unwrap_or([none; 2]),
        };
        low + (high - low) * share
    }
}

impl<'de> Deserialize<'de> for ErrorRange {
    /// Reads a number or the two ends of a range, or a mapping of such.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        let wrong = |found: String| D::Error::custom(format!("found {found}, expected {RANGE}"));
        let value = Value::deserialize(deserializer)?;
        let Value::Object(entries) = &value else {
            return range_of(&value).map(Self::All).ok_or_else(|| wrong(value.to_string()));
        };
        let entry = |(name, value): (&String, &Value)| {
            let range = range_of(value).ok_or_else(|| wrong(format!("{value} for {name}")))?;
            Ok((name.clone(), range))
        };
        entries.iter().map(entry).collect::<std::result::Result<_, _>>().map(Self::ByQuantity)
    }
}

/// [`StateChannel::quantities`] or [`Channel::quantities`] of the channel of this name.
pub(super) fn quantities(channel: &str) -> &'static [(&'static str, usize)] {
    let state = StateChannel::ALL.into_iter().find(|state| state.name() == channel);
    let tactile = || Channel::named(channel).map_or(&[][..], Channel::quantities);
    state.map_or_else(tactile, StateChannel::quantities)
}

/// Errors by the name of the channel.
pub type SensorErrors = BTreeMap<String, SensorError>;

/// Largest delay (control steps).
const LATEST: f64 = 25.0;
/// Largest noise, offset, drift and hysteresis, in the unit of the channel.
const LARGEST: f64 = 1e9;

/// Returns an error that names the first value out of its range, a quantity that its channel does
/// not have, or a channel that is not among the `observed` ones.
pub(super) fn validate(errors: &SensorErrors, observed: &[&str]) -> Result<()> {
    for (channel, error) in errors {
        if !observed.contains(&channel.as_str()) {
            let expected = format!("one of the observed channels {}", observed.join(", "));
            return Err(Error::invalid("sensor_errors", channel, expected));
        }
        let SensorError { noise, gain, offset, drift, hysteresis, dead, delay } = error;
        let name = |what: &str| format!("sensor_errors.{channel}.{what}");
        for (what, error, bounds) in [
            ("noise", noise, [0.0, LARGEST]),
            ("gain", gain, [0.0, 100.0]),
            ("offset", offset, [0.0, LARGEST]),
            ("drift", drift, [0.0, LARGEST]),
            ("hysteresis", hysteresis, [0.0, LARGEST]),
        ] {
            for (quantity, range) in error.ranges() {
                let Some(quantity) = quantity else {
                    rising(&name(what), range, bounds)?;
                    continue;
                };
                known(&name(what), channel, quantity)?;
                rising(&format!("{}.{quantity}", name(what)), range, bounds)?;
            }
        }
        within(&name("dead"), *dead, [0.0, 1.0])?;
        whole_within(&name("delay"), *delay as f64, [0.0, LATEST])?;
    }
    Ok(())
}

/// Returns an error unless `channel` has `quantity` beside others.
fn known(name: &str, channel: &str, quantity: &str) -> Result<()> {
    let known: Vec<_> = quantities(channel).iter().map(|(name, _)| *name).collect();
    if known.contains(&quantity) {
        return Ok(());
    }
    let expected = match known.as_slice() {
        [] => RANGE.to_owned(),
        _ => format!("one of {}", known.join(", ")),
    };
    Err(Error::invalid(name, quantity, expected))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::{TaskConfig, observation::components};

    #[test]
    fn quantities_are_the_parts_of_a_channel_with_a_unit_each() {
        for task in ["GraspLift", "GraspSoft", "InsertPeg"] {
            let config = TaskConfig::from_json(&format!(r#"{{"task": "{task}"}}"#)).unwrap();
            for &channel in StateChannel::SHARED.iter().chain(config.task.channels()) {
                // Of distractors there are as many as asked for; they have no table.
                if channel == StateChannel::Distractors {
                    continue;
                }
                let parts = components(channel, &config);
                let parts: Vec<usize> = parts.iter().map(|part| part.low.len()).collect();
                let count = if channel == StateChannel::Wrench { 2 } else { parts.len() };
                let expected = if count == 1 { &[] } else { &parts[..count] };
                let name = channel.name();
                let found: Vec<usize> = quantities(name).iter().map(|(_, size)| *size).collect();
                assert_eq!(found, expected, "{name}");
            }
        }
    }

    #[test]
    fn bad_settings_are_named() {
        for (errors, expected) in [
            (r#"{"smell": {}}"#, "sensor_errors: found smell, expected one of the observed"),
            (
                r#"{"wrench": {"noise": -1}}"#,
                "wrench.noise: found -1, expected one number or a rising range [low, high] within",
            ),
            (r#"{"wrench": {"gain": [2, 1]}}"#, "sensor_errors.wrench.gain: found [2.0, 1.0]"),
            (r#"{"wrench": {"gain": "big"}}"#, "sensor_errors.wrench.gain"),
            (
                r#"{"wrench": {"dead": 1.5}}"#,
                "sensor_errors.wrench.dead: found 1.5, expected one number from 0 to 1",
            ),
            (
                r#"{"wrench": {"delay": 26}}"#,
                "sensor_errors.wrench.delay: found 26, expected a whole number from 0 to 25",
            ),
            (r#"{"wrench": {"drift": -1}}"#, "sensor_errors.wrench.drift: found -1"),
            (r#"{"wrench": {"noise": [2, 1]}}"#, "sensor_errors.wrench.noise: found [2.0, 1.0]"),
            (r#"{"wrench": {"hysteresis": [0, 2e9]}}"#, "sensor_errors.wrench.hysteresis: found"),
            (r#"{"wrench": {"offset": [1]}}"#, "sensor_errors.wrench.offset"),
            (r#"{"wrench": {"fade": 1}}"#, "unknown field `fade`"),
            (
                r#"{"wrench": {"noise": {"forse": 1}}}"#,
                "sensor_errors.wrench.noise: found forse, expected one of force, torque",
            ),
            (
                r#"{"wrench": {"drift": {"torque": -1}}}"#,
                "sensor_errors.wrench.drift.torque: found -1",
            ),
            (
                r#"{"wrench": {"gain": {"torque": [1]}}}"#,
                "sensor_errors.wrench.gain: found [1] for torque, expected one number or a rising",
            ),
            (r#"{"wrench": {"dead": {"force": 1}}}"#, "sensor_errors.wrench.dead"),
            (
                r#"{"time": {"offset": {"time": 1}}}"#,
                "sensor_errors.time.offset: found time, expected one number or a rising range",
            ),
        ] {
            let json = format!(
                r#"{{"observation": ["wrench", "time"], "tactile": "none", "sensor_errors": {errors}}}"#
            );
            let message = TaskConfig::from_json(&json).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
