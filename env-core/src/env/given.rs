//! Start of the next episode as given by the caller, in place of what is drawn.

use super::Setup;
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

    /// Returns the quantity called `name`, or an error that lists all names.
    pub fn named(name: &str) -> Result<Self> {
        let found = Self::NAMED.iter().find(|(own, _)| *own == name);
        found.map(|(_, quantity)| *quantity).ok_or_else(|| {
            let known = Self::NAMED.map(|(own, _)| own).join(", ");
            Error::invalid("draw", name, format!("one of {known}"))
        })
    }

    /// Least and greatest value under the settings.
    fn bounds(self, setup: &Setup) -> [f64; 2] {
        let config = setup.config();
        match self {
            Self::Object => [0.0, setup.models().len() as f64 - 1.0],
            Self::Mass => config.mass,
            Self::Friction => config.friction,
            Self::Size => config.size,
            Self::Yaw => config.yaw,
            Self::X | Self::Y => config.position,
            Self::StartX | Self::StartY => config.start,
            Self::StartHeight => config.start_height,
            Self::GelStiffness => config.gel_stiffness,
        }
    }
}

/// Values given for the next episodes of a row; the others are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct GivenStart([Option<f64>; StartQuantity::NAMED.len()]);

impl GivenStart {
    /// The given value, or else the `drawn` one.
    pub(super) fn or(&self, quantity: StartQuantity, drawn: f64) -> f64 {
        self.0[quantity as usize].unwrap_or(drawn)
    }

    /// Sets a quantity, or has it drawn again if `value` is not a number. Returns an error unless
    /// it is within the range of its setting, for which the objects were validated.
    pub(super) fn set(&mut self, quantity: StartQuantity, value: f64, setup: &Setup) -> Result<()> {
        let [low, high] = quantity.bounds(setup);
        let whole = quantity != StartQuantity::Object || value.fract() == 0.0;
        let sound = value.is_nan() || whole && (low..=high).contains(&value);
        if !sound {
            let (name, _) = StartQuantity::NAMED[quantity as usize];
            let number = if quantity == StartQuantity::Object { "a whole number " } else { "" };
            let expected = format!("{number}within {low} to {high}, the range of the settings");
            return Err(Error::invalid(format!("draw {name}"), value, expected));
        }
        self.0[quantity as usize] = (!value.is_nan()).then_some(value);
        Ok(())
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
