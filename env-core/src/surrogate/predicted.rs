//! Prediction of an answer's own errors, and trust in the network by them.
//!
//! The logarithm of each relative error is modelled as linear in a few quantities of the answer, by
//! quantile regression (Koenker and Bassett 1978) on presses that the network was not trained on:
//! of a hundred presses like those, 95 are nearer to finite elements than predicted. The errors of
//! the linear solution are predicted likewise; where those of the network are predicted to be
//! larger, the correction is reduced, down to the linear solution.

use serde::{Deserialize, Serialize};

use super::features::{Fields, PadInput};
use crate::deformation::PredictedError;

/// Number of quantities of an answer.
const TERMS: usize = 9;
/// Number of predicted errors: of displacement, stress and force.
const PARTS: usize = 3;
/// Part of presses whose errors are at most those predicted.
const QUANTILE: f64 = 0.95;
/// Steps of descent, and the length of the first.
const STEPS: usize = 4000;
const RATE: f64 = 0.05;
/// Least and greatest predicted error.
const RANGE: [f64; 2] = [1e-3, PredictedError::MOST];
/// Ratio of the network's predicted error to the linear solution's from which nothing is corrected.
const TRUSTED: f64 = 1.5;

/// Coefficients of the regressions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorModel {
    /// Mean and standard deviation of each quantity.
    scales: [[f64; 2]; TERMS],
    /// Coefficients of the network's errors.
    coefficients: Coefficients,
    /// Coefficients of the linear solution's errors; without them corrections are never reduced.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    linear: Option<Coefficients>,
    /// Number of presses that it was fitted to.
    presses: usize,
}

/// Constant and factors of the scaled quantities, for displacement, stress and force.
type Coefficients = [TermRow; PARTS];
/// The number 1 and the scaled quantities.
type TermRow = [f64; TERMS + 1];
/// Quantities of an answer.
pub(super) type Terms = [f64; TERMS];

/// A press to which an [`ErrorModel`] is fitted: quantities of its answer, and the relative errors
/// of displacement, stress and force.
pub(super) struct JudgedAnswer {
    pub(super) terms: Terms,
    /// Errors of the network.
    pub(super) network: [f64; PARTS],
    /// Errors of the linear solution.
    pub(super) linear: [f64; PARTS],
}

impl ErrorModel {
    /// Fits the model to some answers; `None` without answers.
    pub(super) fn fit(answers: &[JudgedAnswer]) -> Option<Self> {
        if answers.is_empty() {
            return None;
        }
        let count = answers.len() as f64;
        let scales = std::array::from_fn(|i| {
            let mean = answers.iter().map(|answer| answer.terms[i]).sum::<f64>() / count;
            let square = answers.iter().map(|answer| (answer.terms[i] - mean).powi(2));
            [mean, (square.sum::<f64>() / count).sqrt().max(1e-6)]
        });
        let rows: Vec<_> = answers.iter().map(|answer| scaled(&answer.terms, &scales)).collect();
        let fit = |errors: fn(&JudgedAnswer) -> &[f64; PARTS]| {
            std::array::from_fn(|part| {
                let errors = answers.iter().map(|answer| errors(answer)[part]);
                let logarithms = errors.map(|error| error.clamp(RANGE[0], RANGE[1]).ln());
                quantile_fit(&rows, &logarithms.collect::<Vec<_>>())
            })
        };
        let (network, linear) = (fit(|answer| &answer.network), fit(|answer| &answer.linear));
        Some(Self { scales, coefficients: network, linear: Some(linear), presses: answers.len() })
    }

    /// Reduces the correction in `fields` of the linear solution in `input` where the linear
    /// solution's error is predicted to be smaller; returns the errors predicted for the result.
    pub(super) fn blended(&self, input: &PadInput, fields: &mut Fields) -> PredictedError {
        let row = scaled(&terms(input, fields), &self.scales);
        let mut errors = predicted(&self.coefficients, &row);
        if let Some(linear) = &self.linear {
            let linear = predicted(linear, &row);
            let weights = std::array::from_fn(|part| weight(errors[part] / linear[part]));
            blend(input, weights, fields);
            errors = std::array::from_fn(|i| linear[i] + weights[i] * (errors[i] - linear[i]));
        }
        let [displacement, stress, force] = errors;
        PredictedError { displacement, stress, force }
    }
}

/// Weight of a correction, by the `ratio` of the network's predicted error to the linear
/// solution's: 1 where it is not larger, 0 from [`TRUSTED`] on.
fn weight(ratio: f64) -> f64 {
    ((TRUSTED - ratio) / (TRUSTED - 1.0)).clamp(0.0, 1.0)
}

/// Multiplies the corrections of displacement, stress and force in `fields` of the linear solution
/// in `input` by `weights`.
pub(super) fn blend(input: &PadInput, weights: [f64; PARTS], fields: &mut Fields) {
    let mix = |part: usize, linear: &[f32], corrected: &mut [f32]| {
        let weight = weights[part] as f32;
        if weight < 1.0 {
            let pairs = corrected.iter_mut().zip(linear);
            pairs.for_each(|(x, linear)| *x = linear + weight * (*x - linear));
        }
    };
    mix(0, &input.displacement, &mut fields.displacement);
    mix(1, &input.stress, &mut fields.stress);
    mix(2, &input.forces, &mut fields.forces);
    mix(2, &input.force(), &mut fields.force);
}

/// The number 1 and the quantities in units of their deviation, at most three of them from the
/// mean.
fn scaled(terms: &Terms, scales: &[[f64; 2]; TERMS]) -> TermRow {
    let mut row = [1.0; TERMS + 1];
    for ((to, term), [mean, deviation]) in row[1..].iter_mut().zip(terms).zip(scales) {
        *to = ((term - mean) / deviation).clamp(-3.0, 3.0);
    }
    row
}

/// Predicted errors of an answer with these quantities.
fn predicted(coefficients: &Coefficients, row: &TermRow) -> [f64; PARTS] {
    coefficients.map(|of_part| product(&of_part, row).exp().clamp(RANGE[0], RANGE[1]))
}

/// Quantities of the answer `corrected` to a press: features of the press, and size of the
/// network's correction.
pub(super) fn terms(input: &PadInput, corrected: &Fields) -> Terms {
    let changed = |found: &[f32], before: &[f32]| {
        let apart: f64 = found.iter().zip(before).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        let size: f64 = before.iter().map(|b| f64::from(*b).powi(2)).sum();
        (apart / size.max(f64::MIN_POSITIVE)).sqrt().max(1e-4).ln()
    };
    let [pressure, slope, spread, size, count] = input.of_press();
    [
        f64::from(input.amplitude.max(1e-6)).ln(),
        pressure,
        slope,
        spread,
        size,
        count,
        input.friction(),
        changed(&corrected.displacement, &input.displacement),
        changed(&corrected.forces, &input.forces),
    ]
}

/// Coefficients whose products with the rows are above a share [`QUANTILE`] of the targets, by
/// subgradient descent with falling steps; the mean of the later ones.
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
        // Shrinkage, as few presses do not determine the coefficients of all quantities.
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

    use super::{
        super::features::{DIRECTIONS, FEATURES},
        *,
    };

    /// Answers whose errors depend on two quantities, those of the linear solution otherwise.
    fn answers(random: &mut ChaCha8Rng, count: usize) -> Vec<JudgedAnswer> {
        let mut one = || {
            let terms: Terms = std::array::from_fn(|_| random.random_range(-1.0..1.0));
            let mut error = |mean: f64| {
                let noise: f64 = (0..6).map(|_| random.random_range(-0.2..0.2)).sum();
                (mean + noise).exp()
            };
            let network = error(-3.0 + terms[1] - 0.5 * terms[4]);
            let linear = error(-2.5 - terms[1] + 0.8 * terms[6]);
            let parts = |error: f64| [error, 2.0 * error, 0.5 * error];
            JudgedAnswer { terms, network: parts(network), linear: parts(linear) }
        };
        (0..count).map(|_| one()).collect()
    }

    /// Asserts that the errors of 19 of 20 answers are at most those predicted, and that the latter
    /// differ.
    fn fits(model: &ErrorModel, coefficients: &Coefficients, others: &[(Terms, [f64; PARTS])]) {
        let predicted: Vec<_> = others
            .iter()
            .map(|(terms, _)| predicted(coefficients, &scaled(terms, &model.scales)))
            .collect();
        for part in 0..PARTS {
            let pairs = predicted.iter().zip(others);
            let below = pairs.filter(|(found, (_, errors))| errors[part] <= found[part]).count();
            let share = below as f64 / others.len() as f64;
            assert!((0.92..0.98).contains(&share), "{share} of the errors");
        }
        let sizes = predicted.iter().map(|errors| errors[0]);
        let [low, high] = [sizes.clone().fold(f64::INFINITY, f64::min), sizes.fold(0.0, f64::max)];
        assert!(high > 4.0 * low, "{low} to {high}");
    }

    #[test]
    fn nineteen_of_twenty_errors_are_below_what_is_predicted() {
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let model = ErrorModel::fit(&answers(&mut random, 2000)).unwrap();
        let others = answers(&mut random, 2000);
        let network: Vec<_> = others.iter().map(|other| (other.terms, other.network)).collect();
        let linear: Vec<_> = others.iter().map(|other| (other.terms, other.linear)).collect();
        fits(&model, &model.coefficients, &network);
        fits(&model, &model.linear.unwrap(), &linear);
    }

    #[test]
    fn corrections_are_reduced_where_the_linear_answer_is_predicted_to_be_better() {
        let weights = [0.9, 1.0, 1.25, 1.5, 1.6].map(weight);
        assert_eq!(weights, [1.0, 1.0, 0.5, 0.0, 0.0]);
    }

    /// A press of two nodes and a tetrahedron, and a correction of it.
    fn corrected() -> (PadInput, Fields) {
        let input = PadInput {
            features: vec![0.5; 2 * FEATURES],
            displacement: vec![0.1, 0.2, -0.3, 0.4, 0.7, 1.1],
            stress: vec![0.3],
            forces: vec![0.0, 0.1, 0.7, 0.3, 0.2, 0.9],
            other_force: [0.1, 0.0, 0.3],
            gates: vec![1.0; 2],
            normals: vec![0.0; 6],
            directions: vec![0.0; 6 * DIRECTIONS],
            amplitude: 0.1,
            strongest: 0.1,
        };
        let fields = Fields {
            displacement: vec![0.5; 6],
            stress: vec![0.7],
            forces: vec![0.3; 6],
            force: [0.7, 0.6, 0.9],
        };
        (input, fields)
    }

    #[test]
    fn without_trust_the_answer_is_the_linear_one_to_the_bit() {
        let (input, mut fields) = corrected();
        blend(&input, [0.0; PARTS], &mut fields);
        assert_eq!(fields.displacement, input.displacement);
        assert_eq!(fields.stress, input.stress);
        assert_eq!(fields.forces, input.forces);
        assert_eq!(fields.force, input.force());
    }

    #[test]
    fn each_part_is_blended_by_the_weight_that_its_errors_give() {
        // The logarithms of the predicted errors are the constants alone.
        let constant = |errors: [f64; PARTS]| {
            errors.map(|error| {
                std::array::from_fn(|i| if i == 0 { error.ln() } else { 0.0 }) as TermRow
            })
        };
        let model = ErrorModel {
            scales: [[0.0, 1.0]; TERMS],
            coefficients: constant([0.1, 0.125, 0.3]),
            linear: Some(constant([0.2, 0.1, 0.1])),
            presses: 1,
        };
        let (input, mut fields) = corrected();
        let before = corrected().1;
        let found = model.blended(&input, &mut fields);
        let near = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-6, "{a} for {b}");
        assert_eq!(fields.displacement, before.displacement);
        near(f64::from(fields.stress[0]), 0.5);
        assert_eq!((&fields.forces, fields.force), (&input.forces, input.force()));
        near(found.displacement, 0.1);
        near(found.stress, 0.1125);
        near(found.force, 0.1);
        let (_, mut fields) = corrected();
        let old = ErrorModel { linear: None, ..model };
        near(old.blended(&input, &mut fields).force, 0.3);
        assert_eq!(fields.forces, before.forces);
    }
}
