//! Tasks, and their names, reward terms and channels.

use serde::{Deserialize, Serialize};

use super::Term;

/// Task of the agent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Task {
    /// Grasp an object that lies on the table, and lift it.
    #[default]
    GraspLift,
    /// Lift an object that the hand is about to touch, under a limit on the stress in the pads.
    GraspFragile,
    /// Lift a soft object that rigid fingers are about to touch, deforming it little.
    GraspSoft,
    /// Keep a gripped object in place under load and shaking, with little force.
    HoldStill,
}

impl Task {
    /// Name, as in the environment's id.
    pub fn name(self) -> &'static str {
        match self {
            Self::GraspLift => "GraspLift",
            Self::GraspFragile => "GraspFragile",
            Self::GraspSoft => "GraspSoft",
            Self::HoldStill => "HoldStill",
        }
    }

    /// Terms of the reward in order, with their default weights.
    pub fn terms(self) -> &'static [(Term, f64)] {
        match self {
            Self::GraspLift => &[
                (Term::Reach, 0.1),
                (Term::Grasp, 0.1),
                (Term::Lift, 0.5),
                (Term::Hold, 0.2),
                (Term::Effort, 0.1),
            ],
            Self::GraspFragile => &[(Term::Grasp, 0.1), (Term::Lift, 0.4), (Term::Hold, 0.5)],
            Self::GraspSoft => {
                &[(Term::Touch, 0.1), (Term::Lift, 0.3), (Term::Hold, 0.4), (Term::Gentle, 0.2)]
            }
            Self::HoldStill => &[(Term::Still, 0.6), (Term::Thrift, 0.4)],
        }
    }

    /// Channels that only this task has.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Self::GraspFragile => &["limit", "share"],
            Self::GraspSoft => &["squeeze", "deformation"],
            Self::GraspLift | Self::HoldStill => &[],
        }
    }

    /// Default channels of the observation; `feels` is `true` for tactile fingers.
    pub fn usual_channels(self, feels: bool) -> &'static [&'static str] {
        match (self, feels) {
            (Self::GraspLift, false) => &["proprio", "object"],
            (Self::GraspLift, true) => &["proprio", "object", "markers"],
            (Self::GraspFragile, _) => &["proprio", "wrench", "share"],
            (Self::GraspSoft, _) => &["proprio", "wrench", "squeeze"],
            (Self::HoldStill, false) => &["proprio", "wrench"],
            (Self::HoldStill, true) => &["proprio", "wrench", "slip"],
        }
    }
}
