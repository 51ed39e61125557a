//! How the fingers' closing on a soft object becomes a press, and its answer what the object feels.

use serde::{Deserialize, Serialize};

use crate::{
    Result,
    deformation::{Deformation, History, Press},
    scene::{Scene, SceneState},
    tactile::{SoftObject, Squeezed},
};

/// What the contact of an object with both fingers remembers.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Squeeze {
    history: Option<History>,
}

impl Squeeze {
    /// The press of both fingers; none unless both touch, and then all is forgotten. The answer goes
    /// to [`Squeeze::keep`].
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

    /// Takes what became of the last press, of an object of Young's modulus `young` (Pa).
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

/// Corrects the bed between fingers and object towards what the object felt: the model is of an object
/// in balance and without weight, so it says how hard the fingers press and not what friction bears.
pub(super) fn correct(scene: &mut Scene, squeezed: Option<&Squeezed>) {
    for finger in 0..2 {
        let force = squeezed.map_or(0.0, |squeezed| squeezed.forces[finger]);
        scene.correct_pressing(finger, force);
    }
}
