//! Limits of the lengths that describe a solid.

use nalgebra::Vector3;

use crate::{Error, Result};

/// Longest allowed dimension of a shape (m), for objects of hand scale.
pub(super) const LARGEST: f64 = 1.0;
/// Shortest allowed dimension (m).
pub(super) const SMALLEST: f64 = 1e-5;

/// Returns an error about `name` unless `value` (m) is an allowed length.
pub(super) fn length(name: &str, value: f64) -> Result<()> {
    if (SMALLEST..=LARGEST).contains(&value) {
        return Ok(());
    }
    let expected = format!("a length of {SMALLEST} to {LARGEST} m");
    Err(Error::invalid(name, format!("{value} m"), expected))
}

/// Returns an error about `name` unless all `values` (m) are allowed lengths.
pub(super) fn lengths(name: &str, values: &Vector3<f64>) -> Result<()> {
    values.iter().try_for_each(|&value| length(name, value))
}

/// Returns an error about `name` unless `value` (m) is an allowed length below `bound`, which is
/// called `than`.
pub(super) fn less(name: &str, value: f64, than: &str, bound: f64) -> Result<()> {
    length(name, value)?;
    if value < bound {
        return Ok(());
    }
    Err(Error::invalid(name, format!("{value} m"), format!("less than {than} ({bound} m)")))
}
