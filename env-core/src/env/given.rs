//! Start of the next episode as given by the caller, in place of what is drawn.

use super::Setup;
use crate::{Error, Result, task::StartQuantity};

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
        let [low, high] = bounds(quantity, setup);
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

/// Least and greatest value under the settings.
fn bounds(quantity: StartQuantity, setup: &Setup) -> [f64; 2] {
    let config = setup.config();
    match quantity {
        StartQuantity::Object => [0.0, setup.models().len() as f64 - 1.0],
        StartQuantity::Mass => config.mass,
        StartQuantity::Friction => config.friction,
        StartQuantity::Size => config.size,
        StartQuantity::Yaw => config.yaw,
        StartQuantity::X | StartQuantity::Y => config.position,
        StartQuantity::StartX | StartQuantity::StartY => config.start,
        StartQuantity::StartHeight => config.start_height,
        StartQuantity::GelStiffness => config.gel_stiffness,
    }
}
