//! Errors of a model against finite elements, for each press and summarised.
//!
//! Relative errors are ‖x̂ − x‖ / ‖x‖ over all nodes or tetrahedra of a press; medians and 95th
//! percentiles are over presses. Presses whose true displacement is below 1 µm (root mean square)
//! are left out of them and counted apart, since their relative errors are meaningless; they count
//! in mean absolute errors. Nothing is clipped.

use std::borrow::Borrow;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    features::{Fields, Target},
    material::PadMaterial,
    samples::{Gels, Sample},
    train::Network,
};
use crate::Result;

/// Root mean square displacement below which a press is counted apart (m).
const STILL: f64 = 1e-6;
/// Share of the peak stress above which a tetrahedron belongs to the stressed set.
const STRESSED: f64 = 0.05;

/// Errors of one press.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PressErrors {
    /// Largest true displacement over the pad's thickness.
    pub amplitude: f64,
    /// True if the displacement is below 1 µm (root mean square).
    pub still: bool,
    /// Mean absolute error of displacement, by component (m).
    pub displacement_mae: f64,
    /// Relative error of displacement.
    pub displacement: f64,
    /// Mean absolute error of von Mises stress (Pa).
    pub stress_mae: f64,
    /// Relative error of stress.
    pub stress: f64,
    /// Relative error of stress in the tetrahedra above 5 % of the peak.
    pub stressed: f64,
    /// Signed relative error of stress in the tetrahedron with the largest true stress.
    pub peak: f64,
    /// Relative error of the contact forces on the nodes of the face.
    pub nodal_force: f64,
    /// Relative error of the net force vector.
    pub force: f64,
}

/// Errors of a network on a press, and of the linear solution that it corrects, if any.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluated {
    /// Name of the grasp.
    pub grasp: String,
    /// Errors of the network; NaN for fields that it does not output.
    pub network: PressErrors,
    /// Errors of the linear solution.
    pub linear: Option<PressErrors>,
}

/// Median and 95th percentile.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Median over presses.
    pub median: f64,
    /// 95th percentile over presses.
    pub p95: f64,
}

/// Errors summarised over presses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Number of presses with a displacement of 1 µm or more (root mean square).
    pub presses: usize,
    /// Number of other presses, which count only in mean absolute errors.
    pub still: usize,
    /// Mean absolute error of displacement (m).
    pub displacement_mae: f64,
    /// Relative error of displacement.
    pub displacement: Spread,
    /// Mean absolute error of stress (Pa).
    pub stress_mae: f64,
    /// Relative error of stress.
    pub stress: Spread,
    /// Relative error of stress in the stressed set.
    pub stressed: Spread,
    /// Absolute relative error of stress at the true peak.
    pub peak: Spread,
    /// Relative error of the nodal forces; `None` if the model outputs no forces.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nodal_force: Option<Spread>,
    /// Relative error of the net force; `None` if the model outputs no forces.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub force: Option<Spread>,
}

impl PressErrors {
    /// Computes the errors of `found` against `target`, with the units of length (m) and stress
    /// (Pa).
    pub(super) fn of(found: &Fields, target: &Target, length: f64, stress: f64) -> Self {
        let nodes = (target.displacement.len() / 3) as f64;
        let size = norm(&target.displacement) * length;
        let peak =
            (0..target.stress.len()).max_by(|&a, &b| target.stress[a].total_cmp(&target.stress[b]));
        let peak = peak.unwrap_or_default();
        let high = f64::from(target.stress[peak]);
        let stressed: Vec<usize> = (0..target.stress.len())
            .filter(|&t| f64::from(target.stress[t]) > STRESSED * high)
            .collect();
        let pick = |field: &[f32]| -> Vec<f32> { stressed.iter().map(|&t| field[t]).collect() };
        let amplitude = target.displacement.as_chunks::<3>().0.iter().map(|u| norm(u));
        Self {
            amplitude: amplitude.fold(0.0, f64::max),
            still: size < STILL * nodes.sqrt(),
            displacement_mae: length * mean_difference(&found.displacement, &target.displacement),
            displacement: relative(&found.displacement, &target.displacement),
            stress_mae: stress * mean_difference(&found.stress, &target.stress),
            stress: relative(&found.stress, &target.stress),
            stressed: relative(&pick(&found.stress), &pick(&target.stress)),
            peak: f64::from(found.stress[peak]) / high - 1.0,
            nodal_force: relative(&found.forces, &target.forces),
            force: relative(&found.force, &target.force),
        }
    }
}

impl Spread {
    /// Summarises single values.
    pub(super) fn of(values: Vec<f64>) -> Self {
        let [median, p95] = quantiles(values, [0.5, 0.95]);
        Self { median, p95 }
    }
}

impl Summary {
    /// Summarises single presses.
    pub fn of(presses: &[PressErrors]) -> Self {
        let moving: Vec<_> = presses.iter().filter(|errors| !errors.still).collect();
        let spread = |field: fn(&PressErrors) -> f64| {
            Spread::of(moving.iter().map(|errors| field(errors).abs()).collect())
        };
        let output = |field: fn(&PressErrors) -> f64| {
            moving.iter().all(|errors| field(errors).is_finite()).then(|| spread(field))
        };
        let mean = |field: fn(&PressErrors) -> f64| {
            presses.iter().map(field).sum::<f64>() / presses.len().max(1) as f64
        };
        Self {
            presses: moving.len(),
            still: presses.len() - moving.len(),
            displacement_mae: mean(|e| e.displacement_mae),
            displacement: spread(|e| e.displacement),
            stress_mae: mean(|e| e.stress_mae),
            stress: spread(|e| e.stress),
            stressed: spread(|e| e.stressed),
            peak: spread(|e| e.peak),
            nodal_force: output(|e| e.nodal_force),
            force: output(|e| e.force),
        }
    }
}

/// Quantiles of `values` at the given shares, 0 if there are no values.
pub(super) fn quantiles<const N: usize>(mut values: Vec<f64>, shares: [f64; N]) -> [f64; N] {
    values.sort_by(f64::total_cmp);
    let last = values.len().saturating_sub(1) as f64;
    shares.map(|share| values.get((share * last).round() as usize).copied().unwrap_or_default())
}

fn norm(field: &[f32]) -> f64 {
    field.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt()
}

pub(super) fn relative(found: &[f32], target: &[f32]) -> f64 {
    let difference: Vec<f32> = found.iter().zip(target).map(|(a, b)| a - b).collect();
    norm(&difference) / norm(target).max(f64::MIN_POSITIVE)
}

fn mean_difference(found: &[f32], target: &[f32]) -> f64 {
    let sum: f64 = found.iter().zip(target).map(|(a, b)| f64::from((a - b).abs())).sum();
    sum / target.len() as f64
}

/// Errors of the linear solutions to `samples`.
pub(super) fn judge_linear(gels: &Gels, samples: &[Sample]) -> Vec<PressErrors> {
    let one = |sample: &Sample| {
        errors(&Fields::linear(&sample.input), &sample.target, &gels.pads[sample.gel].gel)
    };
    samples.iter().map(one).collect()
}

/// Errors of the network on `samples`.
pub(super) fn judge<N: Network>(
    network: &N,
    ground: &N::Ground,
    samples: &[impl Borrow<N::Sample> + Sync],
) -> Result<Vec<PressErrors>> {
    let one = |sample: &N::Sample| {
        let (target, gel) = N::target(ground, sample);
        Ok(errors(&network.answer(ground, sample)?, target, gel))
    };
    samples.par_iter().map(|sample| one(sample.borrow())).collect()
}

/// Errors of `fields` against the true solution on a gel.
pub(super) fn errors(fields: &Fields, target: &Target, gel: &PadMaterial) -> PressErrors {
    PressErrors::of(fields, target, gel.thickness, gel.moduli.shear())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_the_ratios_of_norms() {
        let target = Target {
            displacement: vec![3e-3, 0.0, 4e-3],
            stress: vec![1.0, 0.5, 0.01],
            forces: vec![0.0, 0.0, 2.0],
            force: [0.0, 0.0, 2.0],
        };
        let found = Fields {
            displacement: vec![3e-3, 0.0, 3e-3],
            stress: vec![0.9, 0.5, 0.02],
            forces: vec![0.0, 1.0, 2.0],
            force: [0.0, 0.0, 1.0],
        };
        let errors = PressErrors::of(&found, &target, 2.0, 10.0);
        let near = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-5, "{a} for {b}");
        near(errors.displacement, 0.2);
        near(errors.displacement_mae, 2.0 * 1e-3 / 3.0);
        near(errors.peak, -0.1);
        near(errors.stressed, 0.1 / 1.25_f64.sqrt());
        near(errors.force, 0.5);
        near(errors.nodal_force, 0.5);
        assert!(!errors.still);
        let still = Target { displacement: vec![1e-9; 3], ..target };
        assert!(PressErrors::of(&found, &still, 2.0, 10.0).still);
    }
}
