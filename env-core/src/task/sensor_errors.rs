//! Errors of sensors: noise, gain, offset, dead points and delay of observed channels.
//!
//! They change what is observed and nothing else: rewards and endings are those of the true values.
//! A value x of a channel is observed as g x + b + n, with a gain g and an offset b that are drawn
//! at the reset and noise n that is drawn in each step, cut to the channel's bounds as a sensor
//! saturates.

use std::collections::{BTreeMap, VecDeque};

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde::{Deserialize, Deserializer, Serialize, de::Error as _};
use serde_json::Value;

use super::{
    ObservationLayout, Range,
    setting::{RANGE, range_of, rising},
};
use crate::{Error, Result};

/// Errors of one channel; by default it has none.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SensorError {
    /// Standard deviation of white noise, in the unit of each entry.
    pub noise: f64,
    /// Factor on the values, drawn at each reset for each pad.
    #[serde(deserialize_with = "range")]
    pub gain: Range,
    /// Standard deviation of what is added to an entry throughout an episode.
    pub offset: f64,
    /// Probability that a point, such as a marker, reads zero throughout an episode.
    pub dead: f64,
    /// Control steps by which the values are late.
    pub delay: usize,
}

impl Default for SensorError {
    fn default() -> Self {
        Self { noise: 0.0, gain: [1.0; 2], offset: 0.0, dead: 0.0, delay: 0 }
    }
}

/// Errors by the name of the channel.
pub type SensorErrors = BTreeMap<String, SensorError>;

/// Largest delay (control steps).
const LATEST: usize = 25;
/// Largest standard deviation, in the unit of the channel.
const LARGEST: f64 = 1e9;

/// Reads a number or the two ends of a range.
fn range<'de, D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Range, D::Error> {
    let value = Value::deserialize(deserializer)?;
    range_of(&value).ok_or_else(|| D::Error::custom(format!("found {value}, expected {RANGE}")))
}

/// Returns an error that names the first value out of its range, or a channel that is not among the
/// `observed` ones.
pub(super) fn validate(errors: &SensorErrors, observed: &[&str]) -> Result<()> {
    for (channel, error) in errors {
        if !observed.contains(&channel.as_str()) {
            let expected = format!("one of the observed channels {}", observed.join(", "));
            return Err(Error::invalid("sensor_errors", channel, expected));
        }
        let SensorError { noise, gain, offset, dead, delay } = *error;
        for (what, range, bounds) in [
            ("noise", [noise; 2], [0.0, LARGEST]),
            ("gain", gain, [0.0, 100.0]),
            ("offset", [offset; 2], [0.0, LARGEST]),
            ("dead", [dead; 2], [0.0, 1.0]),
            ("delay", [delay as f64; 2], [0.0, LATEST as f64]),
        ] {
            rising(&format!("sensor_errors.{channel}.{what}"), range, bounds)?;
        }
    }
    Ok(())
}

/// Sensors of one episode, with the errors that were drawn for them.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FaultySensors {
    random: ChaCha8Rng,
    channels: Vec<FaultyChannel>,
}

/// One channel with errors.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct FaultyChannel {
    /// Place of its first entry in an observation.
    first: usize,
    noise: f64,
    /// Factor and offset of each entry; `None` where its point is dead.
    entries: Vec<Option<[f32; 2]>>,
    delay: usize,
    /// True values of the latest steps, the oldest first.
    past: VecDeque<Vec<f32>>,
}

impl FaultySensors {
    /// Draws the errors of an episode from `random`, which goes on to draw the noise; `None` if no
    /// channel has any.
    pub fn draw(
        errors: &SensorErrors,
        layout: &ObservationLayout,
        mut random: ChaCha8Rng,
    ) -> Option<Self> {
        if errors.is_empty() {
            return None;
        }
        let channels = layout.spans().filter_map(|span| {
            let SensorError { noise, gain: [low, high], offset, dead, delay } =
                *errors.get(span.name)?;
            let side = span.size.div_ceil(span.sides);
            let (mut gain, mut is_dead) = (1.0, false);
            let entries = (0..span.size).map(|entry| {
                if entry % side == 0 {
                    gain = low + (high - low) * random.random::<f64>();
                }
                if entry % span.point == 0 {
                    is_dead = random.random::<f64>() < dead;
                }
                let offset = offset * random.sample::<f64, _>(StandardNormal);
                (!is_dead).then_some([gain as f32, offset as f32])
            });
            let entries = entries.collect();
            Some(FaultyChannel { first: span.first, noise, entries, delay, past: VecDeque::new() })
        });
        let channels = channels.collect();
        Some(Self { random, channels })
    }

    /// Replaces the true values of a step in `row` by what the sensors report.
    pub fn report(&mut self, layout: &ObservationLayout, row: &mut [f32]) {
        for channel in &mut self.channels {
            let FaultyChannel { first, noise, entries, delay, past } = channel;
            let here = *first..*first + entries.len();
            let values = &mut row[here.clone()];
            if *delay > 0 {
                past.push_back(values.to_vec());
                values.copy_from_slice(&past[0]);
                if past.len() > *delay {
                    past.pop_front();
                }
            }
            let [low, high] = layout.bounds().map(|bounds| &bounds[here.clone()]);
            for (i, x) in values.iter_mut().enumerate() {
                let noise = *noise * self.random.sample::<f64, _>(StandardNormal);
                let reported = entries[i].map(|[gain, offset]| *x * gain + offset + noise as f32);
                *x = reported.unwrap_or_default().clamp(low[i], high[i]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;
    use crate::task::TaskConfig;

    /// Sensors of the channels that `json` names, on rigid fingers, and a row of true values.
    fn sensors(json: &str) -> (FaultySensors, ObservationLayout, Vec<f32>) {
        let observation = r#""observation": ["proprio", "wrench", "time"], "tactile": "none""#;
        let json = format!(r#"{{{observation}, "sensor_errors": {json}}}"#);
        let config = TaskConfig::from_json(&json).unwrap();
        let layout = ObservationLayout::new(&config, None).unwrap();
        let random = ChaCha8Rng::seed_from_u64(3);
        let sensors = FaultySensors::draw(&config.sensor_errors, &layout, random).unwrap();
        let row = (0..layout.size()).map(|i| 0.01 * i as f32).collect();
        (sensors, layout, row)
    }

    /// Places of the wrenches of both pads, after the 14 numbers of the gripper, and of the time.
    const WRENCH: std::ops::Range<usize> = 14..26;
    const TIME: usize = 26;

    fn wrench(row: &[f32]) -> &[f32] {
        &row[WRENCH]
    }

    #[test]
    fn spans_are_where_channels_are_written() {
        let (_, layout, row) = sensors(r#"{"time": {}}"#);
        let spans: Vec<_> = layout.spans().map(|s| (s.name, s.first, s.size, s.sides)).collect();
        assert_eq!(spans, [("proprio", 0, 14, 1), ("wrench", 14, 12, 2), ("time", TIME, 1, 1)]);
        assert_eq!(row.len(), TIME + 1);
    }

    #[test]
    fn only_what_is_named_is_reported_wrong_and_each_pad_has_its_gain() {
        let (mut sensors, layout, row) = sensors(r#"{"wrench": {"gain": [0.5, 2]}}"#);
        let mut seen = row.clone();
        sensors.report(&layout, &mut seen);
        assert_eq!((&seen[..WRENCH.start], seen[TIME]), (&row[..WRENCH.start], row[TIME]));
        let ratios: Vec<f32> = wrench(&seen).iter().zip(wrench(&row)).map(|(a, b)| a / b).collect();
        assert!(ratios[..6].iter().all(|r| (r / ratios[0] - 1.0).abs() < 1e-5));
        assert!(ratios[6..].iter().all(|r| (r / ratios[6] - 1.0).abs() < 1e-5));
        assert!((ratios[0] / ratios[6] - 1.0).abs() > 0.01);
    }

    #[test]
    fn noise_has_its_deviation_and_an_offset_stays() {
        let (mut sensors, layout, row) =
            sensors(r#"{"wrench": {"noise": 0.1, "offset": 5}, "time": {"noise": 2.0}}"#);
        let steps: Vec<Vec<f32>> = (0..2000)
            .map(|_| {
                let mut seen = row.clone();
                sensors.report(&layout, &mut seen);
                seen
            })
            .collect();
        let (mut squares, mut offsets) = (0.0, Vec::new());
        for i in WRENCH {
            let mean = steps.iter().map(|s| f64::from(s[i] - row[i])).sum::<f64>() / 2000.0;
            squares += steps.iter().map(|s| (f64::from(s[i] - row[i]) - mean).powi(2)).sum::<f64>();
            offsets.push(mean);
        }
        let deviation = (squares / (12.0 * 2000.0)).sqrt();
        assert!((deviation / 0.1 - 1.0).abs() < 0.03, "{deviation}");
        let spread = (offsets.iter().map(|x| x * x).sum::<f64>() / 12.0).sqrt();
        assert!((2.0..9.0).contains(&spread), "{spread}");
        // Time is never negative: a sensor saturates.
        assert!(steps.iter().all(|step| step[TIME] >= 0.0));
    }

    #[test]
    fn what_is_late_was_true_before_and_what_is_dead_is_nothing() {
        let (mut sensors, layout, row) =
            sensors(r#"{"time": {"delay": 2}, "wrench": {"dead": 1}}"#);
        let seen: Vec<f32> = (0..6)
            .map(|step| {
                let mut row = row.clone();
                row[TIME] = step as f32;
                sensors.report(&layout, &mut row);
                assert!(wrench(&row).iter().all(|x| *x == 0.0));
                row[TIME]
            })
            .collect();
        assert_eq!(seen, [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]);
    }

    #[test]
    fn bad_settings_are_named() {
        for (errors, expected) in [
            (r#"{"smell": {}}"#, "sensor_errors: found smell, expected one of the observed"),
            (r#"{"wrench": {"noise": -1}}"#, "sensor_errors.wrench.noise: found -1"),
            (r#"{"wrench": {"gain": [2, 1]}}"#, "sensor_errors.wrench.gain: found [2.0, 1.0]"),
            (r#"{"wrench": {"gain": "big"}}"#, "sensor_errors.wrench.gain"),
            (r#"{"wrench": {"dead": 1.5}}"#, "sensor_errors.wrench.dead: found 1.5"),
            (r#"{"wrench": {"delay": 26}}"#, "sensor_errors.wrench.delay: found 26"),
            (r#"{"wrench": {"drift": 1}}"#, "unknown field `drift`"),
        ] {
            let json = format!(
                r#"{{"observation": ["wrench"], "tactile": "none", "sensor_errors": {errors}}}"#
            );
            let message = TaskConfig::from_json(&json).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
