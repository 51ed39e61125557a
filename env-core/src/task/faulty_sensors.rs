//! Sensors with errors: what is drawn for an episode, and what they report in each step.
//!
//! Errors change what is observed and nothing else: rewards and endings are those of the true
//! values. A value x of a channel is observed as g y + b + n, cut to the channel's bounds as a
//! sensor saturates. The lagging value y follows x by the play operator of half-width h, y ← max(x
//! − h, min(x + h, y)) (Krasnosel'skii & Pokrovskii, Systems with Hysteresis, 1989), from y = x at
//! the reset. The gain g is drawn at the reset, the noise n in each step. The bias b starts at an
//! offset drawn at the reset and drifts as a random walk, whose standard deviation after a time t
//! is d √t.

use std::{collections::VecDeque, iter::repeat_n};

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

use super::{ErrorRange, ObservationLayout, SensorErrors, sensor_errors::quantities};

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
    /// other the ranges of the remaining errors and the drift. For each pad and
    /// kind of error, one uniform draw places all quantities within their ranges.
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
    use crate::task::{SensorError, TaskConfig};

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

    /// Reported values in each of `steps` steps in which `row` is true.
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
}
