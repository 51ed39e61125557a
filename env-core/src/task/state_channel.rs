//! Channels of the rigid bodies, the task and soft objects: names, content and quantities.

use crate::tactile::Channel;

/// Channel that is computed from the state of the rigid bodies, the task, or a soft object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StateChannel {
    /// State and command of the gripper.
    Proprio,
    /// Pose and velocity of the object.
    Object,
    /// Force and torque on each pad.
    Wrench,
    /// Mass, friction and size of the object.
    Properties,
    /// Time since the start of the episode.
    Time,
    /// Highest stress in the pads relative to the episode's limit.
    StressRatio,
    /// The limit of that stress.
    StressLimit,
    /// Deformation and stress of a soft object in three numbers.
    Squeeze,
    /// Displacement of markers on a soft object.
    Deformation,
    /// Place of a peg relative to its hole, and the force between them.
    Insertion,
    /// Poses of the distractors.
    Distractors,
}

impl StateChannel {
    /// Channels that every environment has, in their order.
    pub const SHARED: [Self; 5] =
        [Self::Proprio, Self::Object, Self::Wrench, Self::Properties, Self::Time];

    /// All channels, those of single tasks last.
    pub(super) const ALL: [Self; 11] = [
        Self::Proprio,
        Self::Object,
        Self::Wrench,
        Self::Properties,
        Self::Time,
        Self::StressRatio,
        Self::StressLimit,
        Self::Squeeze,
        Self::Deformation,
        Self::Insertion,
        Self::Distractors,
    ];

    /// Quantities of a channel that has several, in the order of its entries, and the number of
    /// entries of each; those of one pad where each has its own.
    pub(super) const fn quantities(self) -> &'static [(&'static str, usize)] {
        match self {
            Self::Proprio => &[
                ("position", 3),
                ("yaw", 2),
                ("velocity", 3),
                ("yaw_rate", 1),
                ("opening", 1),
                ("opening_rate", 1),
                ("grip", 1),
                ("pad_force", 2),
            ],
            Self::Object => &[
                ("position", 3),
                ("rotation", 6),
                ("velocity", 3),
                ("angular_velocity", 3),
                ("rise", 1),
            ],
            Self::Wrench => Channel::Wrench.quantities(),
            Self::Properties => &[("mass", 1), ("friction", 1), ("size", 3)],
            Self::Squeeze => &[("deformation", 1), ("stress", 2)],
            Self::Insertion => &[("position", 3), ("yaw", 1), ("force", 3)],
            Self::Time
            | Self::StressRatio
            | Self::StressLimit
            | Self::Deformation
            | Self::Distractors => &[],
        }
    }

    /// Name in the settings.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Proprio => "proprio",
            Self::Object => "object",
            Self::Wrench => "wrench",
            Self::Properties => "properties",
            Self::Time => "time",
            Self::StressRatio => "stress_ratio",
            Self::StressLimit => "stress_limit",
            Self::Squeeze => "squeeze",
            Self::Deformation => "deformation",
            Self::Insertion => "insertion",
            Self::Distractors => "distractors",
        }
    }

    /// Content, as a phrase.
    pub const fn doc(self) -> &'static str {
        match self {
            Self::Proprio => {
                "tool centre, yaw, their rates, opening and rate, grip command, pad forces"
            }
            Self::Object => "pose and velocity of the object in the wrist's frame, rise",
            Self::Wrench => "force and torque on each pad in the pad's frame",
            Self::Properties => "mass, friction, half of the bounding box",
            Self::Time => "time since the start of the episode (s)",
            Self::StressRatio => {
                "highest von Mises stress in any tetrahedron of both pads, over the limit"
            }
            Self::StressLimit => "limit of that stress in this episode (Pa)",
            Self::Squeeze => {
                "root mean square deformation (m), highest and mean von Mises stress (Pa)"
            }
            Self::Deformation => {
                "displacement of 16 markers on the object in the wrist's frame (m)"
            }
            Self::Insertion => {
                "place of the peg's tip in the hole's frame, yaw of the hand from the hole's, \
                 force of the fixture"
            }
            Self::Distractors => {
                "pose in the wrist's frame of each of the ``distractors``, which must be 1 or more"
            }
        }
    }
}
