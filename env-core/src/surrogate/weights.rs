//! Files of weights, each with a card that describes them.
//!
//! A file is a [`TensorFile`]; the card is JSON. Files are not trusted: only files up to a size
//! above that of any network here are read, and tensors must have the shapes that the card's
//! network requires.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

use nalgebra::Vector3;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use super::{
    corrector::CorrectorConfig,
    features::Target,
    material::PadMaterial,
    metrics::{Summary, quantiles},
    parameters::Vectors,
    predicted::ErrorModel,
    train::Training,
};
use crate::{
    Error, Result,
    dataset::{Dataset, DatasetConfig, GelConfig, Split, sha256},
    tensor_file::{Dtype, TensorFile},
};

/// Description of a network, its training data and its errors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Card {
    /// Kind of network.
    pub variant: String,
    /// Sizes of the network.
    pub network: CorrectorConfig,
    /// Largest number of nodes of the model mesh.
    pub model_nodes: usize,
    /// Largest number of nodes of the linear model's mesh.
    pub linear_nodes: usize,
    /// Training configuration.
    pub training: Training,
    /// Training data.
    pub data: Data,
    /// Bounds of most of the training data.
    pub usual: TrainingBounds,
    /// Prediction of the errors of network and linear solution, fitted to the split's validation
    /// part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub predicted: Option<ErrorModel>,
    /// Errors on the split's test part, of answers as [`super::Surrogate`] gives them.
    pub test: Summary,
    /// Errors of the linear solution on the same presses.
    pub linear: Summary,
}

/// Summary of the data that a network was trained on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Data {
    /// SHA-256 of the dataset's configuration and the split's grasps.
    pub fingerprint: String,
    /// Commit of the code that trained it.
    pub trained_by: String,
    /// Numbers of grasps and of frames of their pads in the training part.
    pub train: [usize; 2],
    /// Numbers of grasps and frames, among these, that were solved less accurately than the others.
    #[serde(default, skip_serializing_if = "is_none")]
    pub low_fidelity: [usize; 2],
    /// Numbers of grasps and of frames of their pads in the test part.
    pub test: [usize; 2],
    /// Names of the sensors.
    pub sensors: Vec<String>,
    /// Contents of the files of those that are not built in, by the name of the file.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub definitions: BTreeMap<String, String>,
    /// Largest displacement over the pad's thickness.
    pub amplitude: f64,
    /// Least and largest Poisson's ratio.
    pub poisson: [f64; 2],
    /// Least and largest coefficient of friction.
    pub friction: [f64; 2],
}

/// Bounds of most presses that a network was trained on: lower bounds are 5th percentiles, upper
/// bounds 99th percentiles.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingBounds {
    /// Least and largest displacement over the pad's thickness.
    pub amplitude: [f64; 2],
    /// Largest net force, in units of E L² with the thickness L.
    pub force: f64,
    /// Least effective number of nodes that bear the force, (Σ f)² / Σ f².
    pub bearing: f64,
}

#[allow(clippy::trivially_copy_pass_by_ref)] // As serde calls it.
fn is_none(counts: &[usize; 2]) -> bool {
    *counts == [0; 2]
}

impl TrainingBounds {
    /// Computes the bounds of the finite-element solutions to train on.
    pub(super) fn of<'a>(targets: impl Iterator<Item = &'a Target>) -> Self {
        let norms = |field: &[f32]| -> Vec<f64> {
            let norm = |v: &[f32; 3]| Vector3::from(*v).cast::<f64>().norm();
            field.as_chunks().0.iter().map(norm).collect()
        };
        let [mut amplitude, mut force, mut bearing] = [const { Vec::new() }; 3];
        for target in targets {
            amplitude.push(target.amplitude());
            force.push(norms(&target.force)[0]);
            bearing.push(bearing_of(norms(&target.forces).into_iter()));
        }
        let [few, most] = [0.05, 0.99];
        let [force] = quantiles(force, [most]);
        let [bearing] = quantiles(bearing, [few]);
        Self { amplitude: quantiles(amplitude, [few, most]), force, bearing }
    }
}

/// Effective number of nodes that bear forces of the given norms, (Σ f)² / Σ f²: n for n equal
/// forces, 0 without force.
pub(super) fn bearing_of(norms: impl Iterator<Item = f64>) -> f64 {
    let add = |[sum, squares]: [f64; 2], norm: f64| [sum + norm, squares + norm * norm];
    let [sum, squares] = norms.fold([0.0; 2], add);
    if squares > 0.0 { sum * sum / squares } else { 0.0 }
}

impl Data {
    /// Fills in the entries that a dataset's configuration determines.
    pub(super) fn of(config: &DatasetConfig, fingerprint: String, trained_by: &str) -> Self {
        let range = |field: fn(&GelConfig) -> f64| {
            let values = config.gels.iter().map(field);
            [values.clone().fold(f64::INFINITY, f64::min), values.fold(0.0, f64::max)]
        };
        let mut sensors: Vec<_> = config.gels.iter().map(|gel| gel.sensor.clone()).collect();
        sensors.sort();
        sensors.dedup();
        let of_file = |gel: &GelConfig| Some((gel.sensor.clone(), gel.definition.clone()?));
        Self {
            fingerprint,
            trained_by: trained_by.to_owned(),
            sensors,
            definitions: config.gels.iter().filter_map(of_file).collect(),
            poisson: range(|gel| gel.poisson),
            friction: config.frictions().unwrap_or_else(|| range(|gel| gel.friction)),
            ..Self::default()
        }
    }

    /// Returns whether a displacement (V, 3) in m on `gel` lies within the range of these data.
    pub(super) fn covers(&self, gel: &PadMaterial, displacement: &[Vector3<f64>]) -> bool {
        let within = |x: f64, [low, high]: [f64; 2]| (low..=high).contains(&x);
        let deepest = displacement.iter().map(Vector3::norm).fold(0.0, f64::max);
        deepest <= self.amplitude * gel.thickness
            && within(gel.moduli.poisson, self.poisson)
            && within(gel.friction, self.friction)
    }
}

/// Numbers of grasps and frames, from the name of the grasp of each frame.
pub(super) fn counts<'a>(grasps: impl Iterator<Item = &'a String>) -> [usize; 2] {
    let all: Vec<_> = grasps.collect();
    let grasps: BTreeSet<_> = all.iter().collect();
    [grasps.len(), all.len()]
}

/// SHA-256 of a dataset's configuration and of the grasps of a split.
pub(super) fn fingerprint(dataset: &Dataset, split: &Split) -> String {
    let text = serde_json::to_string(&(dataset.config(), split)).expect("plain data");
    sha256(text)
}

/// A card with the kind of its network.
pub(super) trait NetworkCard: DeserializeOwned {
    /// Permitted values of its `variant`.
    const VARIANTS: &'static [&'static str];
}

impl NetworkCard for Card {
    const VARIANTS: &'static [&'static str] = &["corrector"];
}

/// Part that all kinds of cards have in common.
#[derive(Deserialize)]
struct Form {
    variant: Option<String>,
}

/// Largest file that is read (bytes).
pub(super) const MOST: u64 = 64 << 20;

/// Serialises named tensors with `card`.
pub(super) fn to_bytes(tensors: &Vectors, card: &impl Serialize) -> Vec<u8> {
    let part = |(name, (shape, values)): (&String, &(Vec<usize>, Vec<f32>))| {
        let bytes = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        (name.clone(), (Dtype::F32, shape.clone(), bytes))
    };
    let text = serde_json::to_string(card).expect("plain data");
    TensorFile::to_bytes(tensors.iter().map(part).collect(), text)
}

/// Returns the kind of the weights in `bytes`, or an error that names `name` if it is none of those
/// `expected`.
pub(super) fn variant(name: &str, bytes: &[u8], expected: &[&str]) -> Result<String> {
    let (_, Form { variant }) = opened(name, bytes)?;
    let variant = variant.unwrap_or_else(|| "an agent".to_owned());
    if expected.contains(&&*variant) {
        return Ok(variant);
    }
    let reason = format!("weights of {variant}, expected {}", expected.join(", "));
    Err(Error::file(name, reason))
}

/// Returns the tensors and the card in `bytes`, or an error that names `name` if they are of
/// another kind.
pub(super) fn of_kind<C: NetworkCard>(name: &str, bytes: &[u8]) -> Result<(Vectors, C)> {
    variant(name, bytes, C::VARIANTS)?;
    from_bytes(name, bytes)
}

/// Returns the tensors and the card in `bytes`, or an error that names `name` if they are invalid.
pub(super) fn from_bytes<C: DeserializeOwned>(name: &str, bytes: &[u8]) -> Result<(Vectors, C)> {
    let (file, card) = opened(name, bytes)?;
    let mut tensors = BTreeMap::new();
    for (tensor, view) in file.tensors {
        if view.dtype() != Dtype::F32 {
            let reason = format!("{tensor} is {:?}, expected F32", view.dtype());
            return Err(Error::file(name, reason));
        }
        let numbers = view.data().as_chunks().0.iter();
        let values: Vec<f32> = numbers.map(|bytes| f32::from_le_bytes(*bytes)).collect();
        if let Some(x) = values.iter().find(|x| !x.is_finite()) {
            let reason = format!("{tensor} holds {x}, expected finite numbers");
            return Err(Error::file(name, reason));
        }
        tensors.insert(tensor, (view.shape().to_vec(), values));
    }
    Ok((tensors, card))
}

/// Returns the file in `bytes`, whose tensors are not read yet, and its card.
fn opened<'a, C: DeserializeOwned>(name: &str, bytes: &'a [u8]) -> Result<(TensorFile<'a>, C)> {
    let bad = |reason: String| Error::file(name, reason);
    let file = TensorFile::read(bytes)
        .map_err(|found| bad(format!("{found}, expected weights of ruffini")))?;
    let card = serde_json::from_str(&file.card).map_err(|e| bad(format!("its card: {e}")))?;
    Ok((file, card))
}

/// Reads a file, or returns an error if it is larger than [`MOST`].
pub(super) fn read(path: &Path) -> Result<Vec<u8>> {
    let size = fs::metadata(path).map_err(|error| Error::file(path, error))?.len();
    if size > MOST {
        return Err(Error::file(path, format!("{size} bytes, expected at most {MOST}")));
    }
    fs::read(path).map_err(|error| Error::file(path, error))
}
