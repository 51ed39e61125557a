//! Contact state of a finger between control steps.

use std::mem;

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use super::Skin;
use crate::{
    Result,
    deformation::{Deformation, History, Press},
    geometry::Shape,
};

/// Contact state of a finger, in the frame of its pad. B bodies can be touched.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finger {
    /// Last poses of the bodies (B).
    last: Vec<Isometry3<f64>>,
    /// Numbers of the bodies in the last press (S).
    pressed: Vec<usize>,
    /// History of the contact, while there is one.
    history: Option<History>,
}

impl Finger {
    /// Creates a finger without contact; the bodies are at `poses` (B).
    pub fn new(poses: Vec<Isometry3<f64>>) -> Self {
        Self { last: poses, pressed: Vec::new(), history: None }
    }

    /// Last poses of the bodies (B).
    pub fn last(&self) -> &[Isometry3<f64>] {
        &self.last
    }

    /// Numbers of the bodies in the last press, in the order of its shapes (S).
    pub fn pressed(&self) -> &[usize] {
        &self.pressed
    }

    /// Returns whether the last press made contact.
    pub fn touches(&self) -> bool {
        self.history.is_some()
    }

    /// Creates the press that moves `bodies` (B) from their last poses through `path` (F, B), which
    /// has one frame or more. It has the bodies that can touch the pad at the end of the path;
    /// returns `None` if there are none. The solution goes to [`Finger::keep`].
    pub fn press(
        &mut self,
        skin: &Skin,
        bodies: &[Shape],
        path: &[Vec<Isometry3<f64>>],
        friction: f64,
    ) -> Result<Option<Press>> {
        let end = path.last().unwrap_or(&self.last).clone();
        let from = mem::replace(&mut self.last, end);
        let may_touch = |&body: &usize| {
            let (shape, pose) = (&bodies[body], &self.last[body]);
            skin.may_touch(|place| shape.distance(&pose.inverse_transform_point(place)).value)
        };
        let pressed: Vec<_> = (0..bodies.len()).filter(may_touch).collect();
        let before = mem::replace(&mut self.pressed, pressed);
        let (history, pressed) = (self.history.take(), &self.pressed);
        if pressed.is_empty() {
            return Ok(None);
        }
        let frame = |poses: &Vec<Isometry3<f64>>| pressed.iter().map(|&i| poses[i]).collect();
        let frames = |path: &[Vec<Isometry3<f64>>]| path.iter().map(frame).collect();
        let shapes = pressed.iter().map(|&body| bodies[body].clone()).collect();
        let press = |path| Press::along(shapes, path)?.with_friction(friction);
        match history {
            Some(history) if before == *pressed => press(frames(path))?.after(history).map(Some),
            Some(history) => {
                let place = |body| before.iter().position(|other| other == body);
                let shapes: Vec<_> = pressed.iter().map(|i| (place(i), from[*i])).collect();
                press(frames(path))?.after(history.with_shapes(&shapes)).map(Some)
            }
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
