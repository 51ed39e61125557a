//! Card of the weights of one of the paper's networks, with its errors.

use serde::{Deserialize, Serialize};

use super::{
    config::{PaperConfig, PaperTrainingConfig},
    patch::Density,
};
use crate::surrogate::{
    PressErrors, Spread, Summary,
    weights::{Data, NetworkCard},
};

/// Largest displacement over the pad's thickness from which a press is deep.
const DEEP: f64 = 0.25;

/// Errors of a model, and its computing time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// Errors by the corrector's measures.
    pub all: Summary,
    /// Errors of presses that move the gel by more than a quarter of its thickness.
    pub deep: Summary,
    /// Error of the gel's rigid motion: translation (m) and rotation (degrees).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rigid: Option<[Spread; 2]>,
    /// The true rigid motion: translation (m) and rotation (degrees).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rigid_truth: Option<[Spread; 2]>,
    /// Relative error of the object's motion since touch, where the input is a force.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<Spread>,
    /// Mean time of a press (s by the clock of training), the linear solution not included.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
}

impl Judged {
    /// Summarises the errors of single presses.
    pub(super) fn of(presses: &[PressErrors], seconds: Option<f64>) -> Self {
        let deep: Vec<_> = presses.iter().filter(|press| press.amplitude > DEEP).copied().collect();
        let (all, deep) = (Summary::of(presses), Summary::of(&deep));
        Self { all, deep, rigid: None, rigid_truth: None, object: None, seconds }
    }
}

/// Description of a network, its training data and its errors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaperCard {
    /// Form of the network: paper-baseline, paper-a or paper-b.
    pub variant: String,
    /// Sizes of the network.
    pub network: PaperConfig,
    /// Density of the objects' surfaces.
    pub density: Density,
    /// Nodes of the model mesh, at most.
    pub model_nodes: usize,
    /// Training configuration.
    pub training: PaperTrainingConfig,
    /// Training data; the test part has objects outside of it.
    pub data: Data,
    /// Errors on unseen grasps of known objects.
    pub known: Judged,
    /// Errors on objects outside the training data.
    pub novel: Judged,
}

impl NetworkCard for PaperCard {
    const VARIANTS: &'static [&'static str] = &["paper-baseline", "paper-a", "paper-b"];
}
