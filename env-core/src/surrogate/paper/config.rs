//! Choice and size of one of the paper's networks, and settings of its training.

use serde::{Deserialize, Serialize};

use crate::{
    Result,
    error::within,
    surrogate::{
        budget::Budget,
        train::{Training, in_range},
    },
};

/// Steps of the paper's ablation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Variant {
    /// Stress at nodes.
    Baseline,
    /// Stress at tetrahedra, which receive messages from their corners.
    A,
    /// Tetrahedra as in A, and a global feature.
    B,
}

impl Variant {
    /// Name of weights of this form.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Baseline => "paper-baseline",
            Self::A => "paper-a",
            Self::B => "paper-b",
        }
    }
}

/// Known quantity of a press.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Input {
    /// The object's pose in the pad's frame.
    Translation,
    /// The net normal force, and the object's pose when it first touched; how far it has moved
    /// since is decoded at its nodes.
    Force,
}

/// Sizes of a network.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PaperConfig {
    /// Variant of the network.
    pub variant: Variant,
    /// Known quantity that is its input.
    pub input: Input,
    /// Latent width H.
    pub width: usize,
    /// Rounds of message passing.
    pub rounds: usize,
    /// `true` if all rounds have the same weights.
    pub shared: bool,
    /// `true` if layer norms end the perceptrons of encoders and rounds.
    pub norm: bool,
}

impl Default for PaperConfig {
    /// Variant B by translation at a size that trains on one core; the paper's is 128 wide, 15
    /// rounds.
    fn default() -> Self {
        Self {
            variant: Variant::B,
            input: Input::Translation,
            width: 16,
            rounds: 4,
            shared: false,
            norm: true,
        }
    }
}

impl PaperConfig {
    /// Most rounds of message passing.
    const MOST_ROUNDS: usize = 64;

    /// Returns this configuration, or an error if a size is out of range.
    pub(super) fn validated(self) -> Result<Self> {
        within("width", self.width, [4, 512])?;
        within("rounds", self.rounds, [1, Self::MOST_ROUNDS])?;
        Ok(self)
    }
}

/// Data and budget that runs have in common.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PaperTrainingConfig {
    /// Split of the dataset; the last grasp of each training object is for evaluation instead.
    pub split: String,
    /// Seed of weights and batches.
    pub seed: u64,
    /// Number of epochs; ten if neither this nor `seconds` is given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub epochs: Option<usize>,
    /// Budget of time (s) in place of epochs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Number of presses per step.
    pub batch: usize,
    /// Highest learning rate.
    pub rate: f64,
    /// Interval of the frames that are evaluated: 1 for all.
    pub every: usize,
}

impl Default for PaperTrainingConfig {
    /// One press per step: in few epochs, more steps are worth more than better ones.
    fn default() -> Self {
        Self {
            split: "novel-14".to_owned(),
            seed: 0,
            epochs: None,
            seconds: None,
            batch: 1,
            rate: 2e-3,
            every: 1,
        }
    }
}

/// Default number of epochs.
const EPOCHS: usize = 10;

impl PaperTrainingConfig {
    /// Returns this configuration with its budget filled in, or an error if a setting is out of
    /// range.
    pub(super) fn validated(mut self) -> Result<Self> {
        Budget::filled(&mut self.epochs, self.seconds, EPOCHS)?;
        in_range(self.seed, self.rate, self.batch, 1)?;
        within("every", self.every, [1, 1_000_000])?;
        Ok(self)
    }

    pub(super) fn budget(&self) -> Result<Budget> {
        Budget::of(self.epochs, self.seconds)
    }

    /// Training configuration of a network of that size.
    pub(super) fn training<C: Default>(&self, network: C) -> Training<C> {
        Training {
            seed: self.seed,
            split: self.split.clone(),
            batch: self.batch,
            rate: self.rate,
            network,
            ..Training::default()
        }
    }
}
