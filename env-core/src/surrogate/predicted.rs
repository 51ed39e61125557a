//! Prediction of an answer's own errors.
//!
//! The logarithm of each relative error is modelled as linear in a few quantities of the answer, by
//! quantile regression (Koenker and Bassett 1978) on presses that the network was not trained on: of
//! a hundred presses like those, 95 are nearer to finite elements than predicted.

use serde::{Deserialize, Serialize};

use super::{features::PadInput, metrics::Fields};
use crate::deformation::PredictedError;

/// Number of quantities of an answer.
const TERMS: usize = 9;
/// Part of presses whose errors are at most those predicted.
const QUANTILE: f64 = 0.95;
/// Steps of descent, and the length of the first.
const STEPS: usize = 4000;
const RATE: f64 = 0.05;
/// Errors are predicted from this on, and up to this.
const RANGE: [f64; 2] = [1e-3, 3.0];

/// Coefficients of the regression.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorModel {
    /// Mean and standard deviation of each quantity.
    scales: [[f64; 2]; TERMS],
    /// Constant and factors of the scaled quantities, for displacement, stress and force.
    coefficients: [[f64; TERMS + 1]; 3],
    /// Number of presses that it was fitted to.
    presses: usize,
}

/// Quantities of an answer.
pub(super) type Terms = [f64; TERMS];

impl ErrorModel {
    /// Fits the model to the relative errors of displacement, stress and force of some answers;
    /// `None` without answers.
    pub(super) fn fit(answers: &[(Terms, [f64; 3])]) -> Option<Self> {
        if answers.is_empty() {
            return None;
        }
        let count = answers.len() as f64;
        let scales = std::array::from_fn(|i| {
            let mean = answers.iter().map(|(terms, _)| terms[i]).sum::<f64>() / count;
            let square = answers.iter().map(|(terms, _)| (terms[i] - mean).powi(2));
            [mean, (square.sum::<f64>() / count).sqrt().max(1e-6)]
        });
        let mut model =
            Self { scales, coefficients: [[0.0; TERMS + 1]; 3], presses: answers.len() };
        let rows: Vec<_> = answers.iter().map(|(terms, _)| model.scaled(terms)).collect();
        for part in 0..3 {
            let targets: Vec<_> = answers
                .iter()
                .map(|(_, errors)| errors[part].clamp(RANGE[0], RANGE[1]).ln())
                .collect();
            model.coefficients[part] = quantile_fit(&rows, &targets);
        }
        Some(model)
    }

    /// Predicted errors of an answer with these quantities.
    pub(super) fn predict(&self, terms: &Terms) -> PredictedError {
        let row = self.scaled(terms);
        let [displacement, stress, force] = self
            .coefficients
            .map(|coefficients| product(&coefficients, &row).exp().clamp(RANGE[0], RANGE[1]));
        PredictedError { displacement, stress, force }
    }

    /// Constant and quantities in units of their deviation, at most three of them from the mean.
    fn scaled(&self, terms: &Terms) -> [f64; TERMS + 1] {
        let mut row = [1.0; TERMS + 1];
        for ((to, term), [mean, deviation]) in row[1..].iter_mut().zip(terms).zip(&self.scales) {
            *to = ((term - mean) / deviation).clamp(-3.0, 3.0);
        }
        row
    }
}

/// Quantities of the answer `corrected` to a press: what the press is like, and how much of the
/// answer is the network's.
pub(super) fn terms(question: &PadInput, corrected: &Fields) -> Terms {
    let changed = |found: &[f32], before: &[f32]| {
        let apart: f64 = found.iter().zip(before).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        let size: f64 = before.iter().map(|b| f64::from(*b).powi(2)).sum();
        (apart / size.max(f64::MIN_POSITIVE)).sqrt().max(1e-4).ln()
    };
    let [pressure, slope, spread, size, count] = question.of_press();
    [
        f64::from(question.amplitude.max(1e-6)).ln(),
        pressure,
        slope,
        spread,
        size,
        count,
        question.friction(),
        changed(&corrected.displacement, &question.displacement),
        changed(&corrected.forces, &question.forces),
    ]
}

/// Coefficients whose products with the rows are above as many of the targets as [`QUANTILE`] says,
/// by subgradient descent with falling steps; the mean of the later ones.
fn quantile_fit<const N: usize>(rows: &[[f64; N]], targets: &[f64]) -> [f64; N] {
    let mut coefficients = [0.0; N];
    let mut sorted = targets.to_vec();
    sorted.sort_by(f64::total_cmp);
    coefficients[0] = sorted[((sorted.len() - 1) as f64 * QUANTILE).round() as usize];
    let (mut sum, mut summed) = ([0.0; N], 0.0);
    for step in 0..STEPS {
        let mut slope = [0.0; N];
        for (row, target) in rows.iter().zip(targets) {
            let below = product(&coefficients, row) < *target;
            let by = if below { QUANTILE } else { QUANTILE - 1.0 };
            slope.iter_mut().zip(row).for_each(|(s, x)| *s += by * x / rows.len() as f64);
        }
        let rate = RATE / (1.0 + step as f64 / 500.0);
        coefficients.iter_mut().zip(slope).for_each(|(c, s)| *c += rate * s);
        // Few presses do not tell much of every quantity.
        coefficients[1..].iter_mut().for_each(|c| *c *= 1.0 - 0.02 * rate);
        if step >= STEPS / 2 {
            sum.iter_mut().zip(coefficients).for_each(|(s, c)| *s += c);
            summed += 1.0;
        }
    }
    sum.map(|s| s / summed)
}

fn product<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn nineteen_of_twenty_errors_are_below_what_is_predicted() {
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let mut answers = |count: usize| -> Vec<(Terms, [f64; 3])> {
            let mut one = || {
                let terms: Terms = std::array::from_fn(|_| random.random_range(-1.0..1.0));
                let noise: f64 = (0..6).map(|_| random.random_range(-0.2..0.2)).sum();
                let error = (-3.0 + terms[1] - 0.5 * terms[4] + noise).exp();
                (terms, [error, 2.0 * error, 0.5 * error])
            };
            (0..count).map(|_| one()).collect()
        };
        let model = ErrorModel::fit(&answers(2000)).unwrap();
        let others = answers(2000);
        let predicted: Vec<_> = others.iter().map(|(terms, _)| model.predict(terms)).collect();
        let below = |i: usize, of: fn(&PredictedError) -> f64| {
            let pairs = predicted.iter().zip(&others);
            pairs.filter(|(p, (_, errors))| errors[i] <= of(p)).count() as f64 / 2000.0
        };
        for share in [below(0, |p| p.displacement), below(1, |p| p.stress), below(2, |p| p.force)] {
            assert!((0.92..0.98).contains(&share), "{share} of the errors");
        }
        let sizes: Vec<f64> = predicted.iter().map(|p| p.displacement).collect();
        let [low, high] = [f64::INFINITY, 0.0];
        let low = sizes.iter().copied().fold(low, f64::min);
        let high = sizes.iter().copied().fold(high, f64::max);
        assert!(high > 4.0 * low, "{low} to {high}");
    }
}
