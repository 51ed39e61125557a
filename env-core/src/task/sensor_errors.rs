//! Errors of sensors: noise, gain, offset, drift, hysteresis, dead points and delay of observed
//! channels.
//!
//! They change what is observed and nothing else: rewards and endings are those of the true values.
//! A value x of a channel is observed as g y + b + n, cut to the channel's bounds as a sensor
//! saturates. The lagging value y follows x by the play operator of half-width h,
//! y ← max(x − h, min(x + h, y)) (Krasnosel'skii & Pokrovskii, Systems with Hysteresis, 1989), from
//! y = x at the reset. The gain g is drawn at the reset, the noise n in each step. The bias b starts
//! at an offset drawn at the reset and drifts as a random walk, whose standard deviation after a
//! time t is d √t.
//!
//! An error is given for all entries of a channel, or for each of its quantities: a wrench has
//! forces in N and torques in N m.

use std::{
    collections::{BTreeMap, VecDeque},
    iter::repeat_n,
};

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
    /// The same for all entries of a channel.
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
    fn at(&self, quantity: &str, share: f64, none: f64) -> f64 {
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

/// Quantities of a channel that has more than one, in the order of its entries, and the number of
/// entries of each: those of one pad, where each pad has its own.
fn quantities(channel: &str) -> &'static [(&'static str, usize)] {
    match channel {
        "proprio" => &[
            ("position", 3),
            ("yaw", 2),
            ("velocity", 3),
            ("yaw_rate", 1),
            ("opening", 1),
            ("opening_rate", 1),
            ("grip", 1),
            ("pad_force", 2),
        ],
        "object" => &[
            ("position", 3),
            ("rotation", 6),
            ("velocity", 3),
            ("angular_velocity", 3),
            ("rise", 1),
        ],
        "wrench" => &[("force", 3), ("torque", 3)],
        "properties" => &[("mass", 1), ("friction", 1), ("size", 3)],
        "squeeze" => &[("deformation", 1), ("stress", 2)],
        "insertion" => &[("position", 3), ("yaw", 1), ("force", 3)],
        "trust" => &[("residual", 1), ("residual_ratio", 1), ("is_large", 1)],
        _ => &[],
    }
}

/// Errors by the name of the channel.
pub type SensorErrors = BTreeMap<String, SensorError>;

/// Largest delay (control steps).
const LATEST: usize = 25;
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
        rising(&name("dead"), [*dead; 2], [0.0, 1.0])?;
        rising(&name("delay"), [*delay as f64; 2], [0.0, LATEST as f64])?;
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

/// Sensors of one episode, with the errors that were drawn for them.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FaultySensors {
    /// Stream of the noise.
    random: ChaCha8Rng,
    /// Stream of the drift.
    drifting: ChaCha8Rng,
    channels: Vec<FaultyChannel>,
}

/// One channel with errors.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct FaultyChannel {
    /// Place of its first entry in an observation.
    first: usize,
    quantities: Vec<FaultyQuantity>,
    /// Gain and present bias of each entry; `None` where its point is dead.
    entries: Vec<Option<[f32; 2]>>,
    delay: usize,
    /// True values of the latest steps, the oldest first.
    past: VecDeque<Vec<f32>>,
    /// Lagging value of each entry; empty before the first step and without hysteresis.
    lagging: Vec<f32>,
}

/// Errors that the entries of a quantity of a pad share.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct FaultyQuantity {
    /// Number of the entries.
    size: usize,
    /// Standard deviation of the noise.
    noise: f64,
    /// Standard deviation of the drift in one control step.
    drift: f64,
    /// Half-width of the play operator.
    hysteresis: f32,
}

impl FaultySensors {
    /// Draws the errors of an episode with control steps of `period` (s); `None` if no channel has
    /// any. Of the two random streams, one draws gains, offsets, dead points and the noise, the
    /// other the ranges of the remaining errors and the drift. Quantities of a pad are equally far
    /// through their ranges.
    pub fn draw(
        errors: &SensorErrors,
        layout: &ObservationLayout,
        [mut random, mut drifting]: [ChaCha8Rng; 2],
        period: f64,
    ) -> Option<Self> {
        if errors.is_empty() {
            return None;
        }
        let channels = layout.spans().filter_map(|span| {
            let error = errors.get(span.name)?;
            let whole = [("", span.size / span.sides)];
            let named = quantities(span.name);
            let named = if named.is_empty() { &whole } else { named };
            let (mut quantities, mut entries) = (Vec::new(), Vec::new());
            let mut is_dead = false;
            for _ in 0..span.sides {
                let [offset, noise, drift, hysteresis] =
                    [&error.offset, &error.noise, &error.drift, &error.hysteresis]
                        .map(|range| (range, drifting.random::<f64>()));
                let gain = random.random::<f64>();
                for &(name, size) in named {
                    let of = |(range, share): (&ErrorRange, f64)| range.at(name, share, 0.0);
                    quantities.push(FaultyQuantity {
                        size,
                        noise: of(noise),
                        drift: of(drift) * period.sqrt(),
                        hysteresis: of(hysteresis) as f32,
                    });
                    let (gain, deviation) = (error.gain.at(name, gain, 1.0), of(offset));
                    for _ in 0..size {
                        if entries.len() % span.point == 0 {
                            is_dead = random.random::<f64>() < error.dead;
                        }
                        let offset = deviation * random.sample::<f64, _>(StandardNormal);
                        entries.push((!is_dead).then_some([gain as f32, offset as f32]));
                    }
                }
            }
            debug_assert_eq!(entries.len(), span.size, "quantities of {}", span.name);
            let (past, lagging) = (VecDeque::new(), Vec::new());
            let (first, delay) = (span.first, error.delay);
            Some(FaultyChannel { first, quantities, entries, delay, past, lagging })
        });
        let channels = channels.collect();
        Some(Self { random, drifting, channels })
    }

    /// Replaces the true values of a step in `row` by what the sensors report.
    pub fn report(&mut self, layout: &ObservationLayout, row: &mut [f32]) {
        for channel in &mut self.channels {
            let FaultyChannel { first, quantities, entries, delay, past, lagging } = channel;
            let here = *first..*first + entries.len();
            let of_entries = || quantities.iter().flat_map(|of| repeat_n(of, of.size));
            let values = &mut row[here.clone()];
            if *delay > 0 {
                past.push_back(values.to_vec());
                values.copy_from_slice(&past[0]);
                if past.len() > *delay {
                    past.pop_front();
                }
            }
            if lagging.is_empty() && quantities.iter().any(|of| of.hysteresis > 0.0) {
                lagging.extend_from_slice(values);
            }
            for ((y, x), of) in lagging.iter_mut().zip(&mut *values).zip(of_entries()) {
                *y = y.max(*x - of.hysteresis).min(*x + of.hysteresis);
                *x = *y;
            }
            let [low, high] = layout.bounds().map(|bounds| &bounds[here.clone()]);
            for (i, ((x, entry), of)) in
                values.iter_mut().zip(entries).zip(of_entries()).enumerate()
            {
                let noise = of.noise * self.random.sample::<f64, _>(StandardNormal);
                let mut reported = 0.0;
                if let Some([gain, bias]) = entry {
                    reported = *x * *gain + *bias + noise as f32;
                    if of.drift > 0.0 {
                        let step = of.drift * self.drifting.sample::<f64, _>(StandardNormal);
                        *bias += step as f32;
                    }
                }
                *x = reported.clamp(low[i], high[i]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;
    use crate::task::{StateChannel, TaskConfig, observation::components};

    /// Sensors of the channels that `json` names, on rigid fingers, and a row of true values.
    fn sensors(json: &str) -> (FaultySensors, ObservationLayout, Vec<f32>) {
        let observation = r#""observation": ["proprio", "wrench", "time"], "tactile": "none""#;
        let json = format!(r#"{{{observation}, "sensor_errors": {json}}}"#);
        let config = TaskConfig::from_json(&json).unwrap();
        let layout = ObservationLayout::new(&config, None).unwrap();
        let period = config.scene.physics.control_period;
        let sensors = FaultySensors::draw(&config.sensor_errors, &layout, streams(), period);
        let row = (0..layout.size()).map(|i| 0.01 * i as f32).collect();
        (sensors.unwrap(), layout, row)
    }

    fn streams() -> [ChaCha8Rng; 2] {
        [3, 4].map(ChaCha8Rng::seed_from_u64)
    }

    /// What is reported in each of `steps` steps in which `row` is true.
    fn reports(
        sensors: &mut FaultySensors,
        layout: &ObservationLayout,
        row: &[f32],
        steps: usize,
    ) -> Vec<Vec<f32>> {
        let mut report = || {
            let mut seen = row.to_vec();
            sensors.report(layout, &mut seen);
            seen
        };
        (0..steps).map(|_| report()).collect()
    }

    /// Standard deviation of numbers whose mean is 0.
    fn deviation(numbers: &[f64]) -> f64 {
        (numbers.iter().map(|x| x * x).sum::<f64>() / numbers.len() as f64).sqrt()
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
        let steps = reports(&mut sensors, &layout, &row, 2000);
        let (mut squares, mut offsets) = (0.0, Vec::new());
        for i in WRENCH {
            let mean = steps.iter().map(|s| f64::from(s[i] - row[i])).sum::<f64>() / 2000.0;
            squares += steps.iter().map(|s| (f64::from(s[i] - row[i]) - mean).powi(2)).sum::<f64>();
            offsets.push(mean);
        }
        let noise = (squares / (12.0 * 2000.0)).sqrt();
        assert!((noise / 0.1 - 1.0).abs() < 0.03, "{noise}");
        let spread = deviation(&offsets);
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

    /// Errors that were drawn before others existed are drawn as ever.
    #[test]
    fn gains_offsets_and_noise_come_from_the_first_stream_alone() {
        let old = r#""gain": [0.5, 2], "offset": 5, "noise": 0.1"#;
        let (mut sensors_of_old, layout, row) = sensors(&format!(r#"{{"wrench": {{{old}}}}}"#));
        let [mut random, _] = streams();
        let mut gain = 1.0;
        let drawn: Vec<_> = WRENCH
            .map(|i| {
                if [WRENCH.start, WRENCH.start + 6].contains(&i) {
                    gain = 0.5 + 1.5 * random.random::<f64>();
                }
                let _dead: f64 = random.random();
                [gain as f32, (5.0 * random.sample::<f64, _>(StandardNormal)) as f32]
            })
            .collect();
        let seen = reports(&mut sensors_of_old, &layout, &row, 40);
        for seen in &seen {
            for (i, [gain, offset]) in WRENCH.zip(&drawn) {
                let noise = 0.1 * random.sample::<f64, _>(StandardNormal);
                assert_eq!(seen[i], row[i] * gain + offset + noise as f32, "entry {i}");
            }
        }
        let more = format!(r#"{{"wrench": {{{old}, "drift": 1e-9, "hysteresis": [0, 1e-9]}}}}"#);
        let (mut sensors, ..) = sensors(&more);
        for (seen, old) in reports(&mut sensors, &layout, &row, 40).iter().zip(&seen) {
            for i in WRENCH {
                assert!((seen[i] - old[i]).abs() < 1e-5, "{} against {}", seen[i], old[i]);
            }
        }
    }

    #[test]
    fn drift_starts_at_zero_and_grows_with_the_root_of_time() {
        let (_, layout, row) = sensors(r#"{"time": {}}"#);
        let error = SensorError { drift: ErrorRange::All([0.5; 2]), ..SensorError::default() };
        let errors = SensorErrors::from([("wrench".to_owned(), error)]);
        for (period, second) in [(0.04, 25), (0.01, 100)] {
            let mut sensors = FaultySensors::draw(&errors, &layout, streams(), period).unwrap();
            let steps = reports(&mut sensors, &layout, &row, 200 * second + 1);
            assert_eq!(steps[0], row);
            for (apart, exact) in [(1, 0.5 * period.sqrt()), (second, 0.5), (4 * second, 1.0)] {
                let changes: Vec<_> = (0..steps.len() - apart)
                    .step_by(apart)
                    .flat_map(|at| WRENCH.map(move |i| (at, i)))
                    .map(|(at, i)| f64::from(steps[at + apart][i] - steps[at][i]))
                    .collect();
                let found = deviation(&changes);
                let standard_error = 1.0 / (2.0 * changes.len() as f64).sqrt();
                let off = (found / exact - 1.0).abs();
                assert!(off < 4.0 * standard_error, "{found} for {exact} after {apart} steps");
            }
        }
    }

    #[test]
    fn a_triangle_is_seen_as_a_loop_that_is_twice_the_hysteresis_wide() {
        let (mut sensors, layout, row) = sensors(r#"{"wrench": {"hysteresis": 0.25, "gain": 2}}"#);
        let mut seen = |x: f32| {
            let mut row = row.clone();
            row[WRENCH].fill(x);
            sensors.report(&layout, &mut row);
            assert!(wrench(&row).iter().all(|y| *y == row[WRENCH.start]));
            row[WRENCH.start] / 2.0
        };
        // Steps of 1/8 are exact.
        let ramp = |from: i32, to: i32| {
            let step = (to - from).signum();
            (0..=(to - from).abs()).map(move |i| (from + step * i) as f32 / 8.0)
        };
        for x in ramp(0, 8) {
            assert_eq!(seen(x), (x - 0.25).max(0.0), "first loading, at {x}");
        }
        for _ in 0..3 {
            for x in ramp(8, -8) {
                assert_eq!(seen(x), (x + 0.25).min(0.75), "unloading, at {x}");
            }
            for x in ramp(-8, 8) {
                assert_eq!(seen(x), (x - 0.25).max(-0.75), "loading, at {x}");
            }
        }
    }

    #[test]
    fn hysteresis_starts_from_what_is_first_true() {
        let (mut sensors, layout, row) = sensors(r#"{"wrench": {"hysteresis": 10, "delay": 1}}"#);
        for seen in reports(&mut sensors, &layout, &row, 3) {
            assert_eq!(seen, row);
        }
    }

    #[test]
    fn a_range_of_hysteresis_is_drawn_for_each_pad_once_an_episode() {
        let (mut sensors, layout, row) = sensors(r#"{"wrench": {"hysteresis": [1, 3]}}"#);
        reports(&mut sensors, &layout, &row, 1);
        let mut lags = Vec::new();
        for x in [10.0, 20.0] {
            let loaded = vec![x; row.len()];
            let seen = reports(&mut sensors, &layout, &loaded, 1).remove(0);
            lags.push(wrench(&seen).iter().map(|y| x - y).collect::<Vec<_>>());
        }
        let [left, right] = [lags[0][0], lags[0][6]];
        assert!([left, right].iter().all(|h| (1.0..=3.0).contains(h)), "{left}, {right}");
        assert!((left - right).abs() > 0.01, "{left} on both pads");
        for lags in lags {
            for (i, lag) in lags.iter().enumerate() {
                assert!((lag - if i < 6 { left } else { right }).abs() < 1e-5, "{lag}");
            }
        }
    }

    #[test]
    fn a_range_of_noise_is_drawn_for_each_pad_once_an_episode() {
        let (mut sensors, layout, row) = sensors(r#"{"wrench": {"noise": [1, 3]}}"#);
        let mut found = Vec::new();
        for _ in 0..2 {
            let steps = reports(&mut sensors, &layout, &row, 1000);
            let of_pad = |pad: usize| {
                let entries = WRENCH.skip(6 * pad).take(6);
                let errors = entries.flat_map(|i| steps.iter().map(move |s| (s, i)));
                let errors: Vec<_> = errors.map(|(s, i)| f64::from(s[i] - row[i])).collect();
                deviation(&errors)
            };
            found.push([0, 1].map(of_pad));
        }
        // 6,000 errors: 0.04 is four standard errors.
        for (first, later) in found[0].iter().zip(&found[1]) {
            assert!((0.96..3.12).contains(first), "{first} is not drawn from 1 to 3");
            assert!((first / later - 1.0).abs() < 0.06, "{first}, later {later}");
        }
        assert!((found[0][0] / found[0][1] - 1.0).abs() > 0.08, "{} on both pads", found[0][0]);
    }

    /// Reports of 30 steps, the true values growing by 1/8 in each, under errors of the wrench.
    fn of_loads(wrench: &str) -> Vec<Vec<f32>> {
        let (mut sensors, layout, row) = sensors(&format!(r#"{{"wrench": {wrench}}}"#));
        let mut report = |step: usize| {
            let mut seen: Vec<f32> = row.iter().map(|x| x + 0.125 * step as f32).collect();
            sensors.report(&layout, &mut seen);
            seen
        };
        (0..30).map(&mut report).collect()
    }

    #[test]
    fn equal_errors_by_quantity_are_those_of_the_channel_to_the_bit() {
        let numbers = ["[0.1, 0.3]", "[0.5, 2]", "[1, 2]", "[0.1, 0.2]", "[0.2, 0.9]"];
        let errors = |of: &dyn Fn(&str) -> String| {
            let names = ["noise", "gain", "offset", "drift", "hysteresis"];
            let each = names.iter().zip(numbers).map(|(name, n)| format!(r#""{name}": {}"#, of(n)));
            format!(r#"{{{}, "dead": 0.2, "delay": 2}}"#, each.collect::<Vec<_>>().join(", "))
        };
        let of_channel = of_loads(&errors(&|n| n.to_owned()));
        let by_quantity = errors(&|n| format!(r#"{{"force": {n}, "torque": {n}}}"#));
        assert_eq!(of_channel, of_loads(&by_quantity));
    }

    #[test]
    fn each_quantity_has_its_error_and_one_that_is_not_named_has_none() {
        let (mut sensors, layout, row) =
            sensors(r#"{"wrench": {"noise": {"force": 0.1, "torque": 1e-3}}}"#);
        let steps = reports(&mut sensors, &layout, &row, 2000);
        for (which, exact) in [(0..3, 0.1), (3..6, 1e-3)] {
            let entries = WRENCH.filter(|i| which.contains(&((i - WRENCH.start) % 6)));
            let errors = entries.flat_map(|i| steps.iter().map(move |s| (s, i)));
            let errors: Vec<_> = errors.map(|(s, i)| f64::from(s[i] - row[i])).collect();
            let found = deviation(&errors);
            assert!((found / exact - 1.0).abs() < 0.03, "{found} for {exact}");
        }
        let none = of_loads("{}");
        for error in ["noise", "gain", "offset", "drift", "hysteresis"] {
            let seen = of_loads(&format!(r#"{{"{error}": {{"torque": 0.5}}}}"#));
            let apart = |which: std::ops::Range<usize>| {
                let entries = WRENCH.filter(|i| which.contains(&((i - WRENCH.start) % 6)));
                entries.filter(|&i| (0..30).any(|step| seen[step][i] != none[step][i])).count()
            };
            assert_eq!((apart(0..3), apart(3..6)), (0, 6), "entries with an error of {error}");
        }
    }

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
            (r#"{"wrench": {"noise": -1}}"#, "sensor_errors.wrench.noise: found -1"),
            (r#"{"wrench": {"gain": [2, 1]}}"#, "sensor_errors.wrench.gain: found [2.0, 1.0]"),
            (r#"{"wrench": {"gain": "big"}}"#, "sensor_errors.wrench.gain"),
            (r#"{"wrench": {"dead": 1.5}}"#, "sensor_errors.wrench.dead: found 1.5"),
            (r#"{"wrench": {"delay": 26}}"#, "sensor_errors.wrench.delay: found 26"),
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
                "sensor_errors.wrench.gain: found [1] for torque, expected a number or a range",
            ),
            (r#"{"wrench": {"dead": {"force": 1}}}"#, "sensor_errors.wrench.dead"),
            (
                r#"{"time": {"offset": {"time": 1}}}"#,
                "sensor_errors.time.offset: found time, expected a number or a range",
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
