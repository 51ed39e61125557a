//! Choice and size of one of the paper's networks.

use serde::{Deserialize, Serialize};

use crate::{Result, surrogate::train::within};

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
    /// The net normal force, and the object's pose when it first touched; how far it has moved since is
    /// decoded at its nodes.
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
    /// Variant B by translation at a size that trains on one core; the paper's is 128 wide, 15 rounds.
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
    pub(super) const MOST_ROUNDS: usize = 64;

    /// Returns this configuration, or an error if a size is out of range.
    pub(super) fn validated(self) -> Result<Self> {
        within("width", self.width, [4, 512])?;
        within("rounds", self.rounds, [1, Self::MOST_ROUNDS])?;
        Ok(self)
    }
}
