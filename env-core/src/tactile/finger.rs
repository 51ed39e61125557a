//! Contact state of a finger between control steps.

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use super::Skin;
use crate::{
    Result,
    deformation::{Deformation, History, Press},
    geometry::Shape,
};

/// Contact state of a finger, in the frame of its pad.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finger {
    /// Last pose of the object.
    last: Isometry3<f64>,
    /// History of the contact, while there is one.
    history: Option<History>,
}

impl Finger {
    /// Creates a finger without contact; the object is at `pose`.
    pub fn new(pose: Isometry3<f64>) -> Self {
        Self { last: pose, history: None }
    }

    /// Last pose of the object.
    pub fn last(&self) -> &Isometry3<f64> {
        &self.last
    }

    /// Returns whether the last press made contact.
    pub fn touches(&self) -> bool {
        self.history.is_some()
    }

    /// Creates the press that moves the object from its last pose through `path`, which has one
    /// pose or more; returns `None` if the object cannot touch the pad at the end of the path. The
    /// solution goes to [`Finger::keep`].
    pub fn press(
        &mut self,
        skin: &Skin,
        object: &Shape,
        path: &[Isometry3<f64>],
        friction: f64,
    ) -> Result<Option<Press>> {
        let from = self.last;
        self.last = path.last().copied().unwrap_or(from);
        let end = self.last;
        let history = self.history.take();
        if !skin.may_touch(|place| object.distance(&end.inverse_transform_point(place)).value) {
            return Ok(None);
        }
        let frames = |path: &[Isometry3<f64>]| path.iter().map(|&pose| vec![pose]).collect();
        let press = |path| Press::along(vec![object.clone()], path)?.with_friction(friction);
        match history {
            Some(history) => press(frames(path))?.after(history).map(Some),
            None => press(frames(&[&[from], path].concat())).map(Some),
        }
    }

    /// Stores the solution of the last press and returns whether it makes contact.
    pub fn keep(&mut self, answer: &Deformation) -> bool {
        let touches = answer.contact_force.iter().any(|force| force.iter().any(|&x| x != 0.0));
        self.history = touches.then(|| answer.history.clone());
        touches
    }
}
