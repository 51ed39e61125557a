//! Card of the weights of one of the paper's networks.

use serde::{Deserialize, Serialize};

use super::{config::PaperConfig, judge::Judged, patch::Density, training::PaperTrainingConfig};
use crate::surrogate::weights::{Data, NetworkCard};

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
