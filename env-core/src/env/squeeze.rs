//! Conversion of the fingers' motion to a press of a soft object, and of its solution to the state
//! of the object.

use serde::{Deserialize, Serialize};

use crate::{
    Result,
    deformation::{Deformation, History, Press},
    scene::{Scene, SceneState},
    tactile::{SoftObject, Squeezed},
};

/// State of the contact of a soft object with both fingers.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct SoftObjectContact {
    history: Option<History>,
}

impl SoftObjectContact {
    /// Creates the press of both fingers. Returns `None` and discards the history unless both
    /// touch. The solution goes to [`SoftObjectContact::keep`].
    pub(super) fn press(
        &mut self,
        object: &SoftObject,
        state: &SceneState,
        friction: f64,
    ) -> Result<Option<Press>> {
        let history = self.history.take();
        if !state.fingers.iter().all(|finger| finger.indentation > 0.0) {
            return Ok(None);
        }
        let faces = state.fingers.each_ref().map(|finger| finger.object.inverse());
        object.press(&faces, friction, history).map(Some)
    }

    /// Stores the solution of the last press, and evaluates it for Young's modulus `young` (Pa) of
    /// the object.
    pub(super) fn keep(
        &mut self,
        object: &SoftObject,
        answer: Option<&Deformation>,
        young: f64,
    ) -> Result<Option<Squeezed>> {
        let Some(answer) = answer else { return Ok(None) };
        self.history = Some(answer.history.clone());
        object.squeezed(answer, young)
    }
}

/// Corrects the elastic foundation between fingers and object towards the normal forces of the
/// solution. Its model of the object is in equilibrium and without weight, so it gives the normal
/// forces of the fingers but not the friction that carries the weight.
pub(super) fn correct(scene: &mut Scene, squeezed: Option<&Squeezed>) {
    for finger in 0..2 {
        let force = squeezed.map_or(0.0, |squeezed| squeezed.forces[finger]);
        scene.correct_pressing(finger, force);
    }
}
