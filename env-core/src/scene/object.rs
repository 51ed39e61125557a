//! A free object of an episode, and the limits of its properties.

use nalgebra::Isometry3;

use super::{Gripper, ObjectModel};
use crate::{Error, Result, error::within};

/// A free object of one episode.
#[derive(Clone, Debug)]
pub struct SceneObject<'a> {
    /// Shape, prepared for Rapier.
    pub model: &'a ObjectModel,
    /// Size relative to the model.
    pub scale: f64,
    /// Mass (kg).
    pub mass: f64,
    /// Coulomb coefficient against pads and table.
    pub friction: f64,
    /// Initial pose of the shape's frame (m).
    pub pose: Isometry3<f64>,
}

/// Largest grip force over object mass (m/s²) at which contact forces are accurate. Above it
/// Rapier's iterations no longer converge: forces are too low, then the object is ejected.
const MOST_ACCELERATION: f64 = 2e4;

impl SceneObject<'_> {
    /// Checks all properties; the error names the first one out of its range.
    pub fn validate(&self, gripper: &Gripper) -> Result<()> {
        let lightest = gripper.max_force / MOST_ACCELERATION;
        within("object scale", self.scale, [0.05, 20.0])?;
        if !(lightest..=1000.0).contains(&self.mass) {
            let force = gripper.max_force;
            let expected = format!("{lightest} to 1000 kg under a grip of up to {force} N");
            return Err(Error::invalid("object mass", format!("{} kg", self.mass), expected));
        }
        within("object friction", self.friction, [0.0, 10.0])?;
        let position = self.pose.translation.vector;
        if !position.iter().all(|x| x.abs() <= 1.0) {
            let found = format!("{:?} m", position.as_slice());
            return Err(Error::invalid("object position", found, "within 1 m of the origin"));
        }
        Ok(())
    }
}
