//! A finger that remembers its contact.

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use super::Skin;
use crate::{
    Result,
    deformation::{Deformation, History, Press},
    geometry::Shape,
};

/// What a finger knows of the object that it may touch: everything is in the frame of its pad.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finger {
    /// Where the object was.
    last: Isometry3<f64>,
    /// What the contact remembers, while there is one.
    history: Option<History>,
}

impl Finger {
    /// A finger without contact, the object being at `pose`.
    pub fn new(pose: Isometry3<f64>) -> Self {
        Self { last: pose, history: None }
    }

    /// Where the object was.
    pub fn last(&self) -> &Isometry3<f64> {
        &self.last
    }

    /// Whether the last press touched.
    pub fn touches(&self) -> bool {
        self.history.is_some()
    }

    /// The press that leads the object from where it was through `path`, which has a pose or more;
    /// none if the object cannot touch the pad where it ends. The answer goes to [`Finger::keep`].
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

    /// Takes what became of the last press; whether it still touches.
    pub fn keep(&mut self, answer: &Deformation) -> bool {
        let touches = answer.contact_force.iter().any(|force| force.iter().any(|&x| x != 0.0));
        self.history = touches.then(|| answer.history.clone());
        touches
    }
}
