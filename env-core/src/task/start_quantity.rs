//! Quantities of an episode's start that the caller may give in place of what is drawn.

use crate::{Error, Result};

/// Quantity of an episode's start that can be given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StartQuantity {
    /// Index into the configured objects.
    Object,
    /// Mass (kg).
    Mass,
    /// Coulomb coefficient.
    Friction,
    /// Size relative to the configured object.
    Size,
    /// Yaw of the object (rad).
    Yaw,
    /// Position of the object along x (m).
    X,
    /// Position of the object along y (m).
    Y,
    /// Position of the tool centre along x (m).
    StartX,
    /// Position of the tool centre along y (m).
    StartY,
    /// Height of the tool centre (m).
    StartHeight,
    /// Young's modulus of the gel relative to that of its material.
    GelStiffness,
}

impl StartQuantity {
    /// All quantities with their names.
    pub const NAMED: [(&'static str, Self); 11] = [
        ("object", Self::Object),
        ("mass", Self::Mass),
        ("friction", Self::Friction),
        ("size", Self::Size),
        ("yaw", Self::Yaw),
        ("x", Self::X),
        ("y", Self::Y),
        ("start_x", Self::StartX),
        ("start_y", Self::StartY),
        ("start_height", Self::StartHeight),
        ("gel_stiffness", Self::GelStiffness),
    ];

    /// Name of the setting from whose range it is drawn.
    pub fn setting(self) -> &'static str {
        match self {
            Self::Object => "objects",
            Self::Mass => "mass",
            Self::Friction => "friction",
            Self::Size => "size",
            Self::Yaw => "yaw",
            Self::X | Self::Y => "position",
            Self::StartX | Self::StartY => "start",
            Self::StartHeight => "start_height",
            Self::GelStiffness => "gel_stiffness",
        }
    }

    /// Returns the quantity called `name`, or an error that lists all names.
    pub fn named(name: &str) -> Result<Self> {
        let found = Self::NAMED.iter().find(|(own, _)| *own == name);
        found.map(|(_, quantity)| *quantity).ok_or_else(|| {
            let known = Self::NAMED.map(|(own, _)| own).join(", ");
            Error::invalid("draw", name, format!("one of {known}"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantities_stand_in_the_order_of_their_names() {
        for (place, (name, quantity)) in StartQuantity::NAMED.into_iter().enumerate() {
            assert_eq!(quantity as usize, place);
            assert_eq!(StartQuantity::named(name).unwrap(), quantity);
        }
    }
}
