//! Conversion of the object's motion to presses of the fingers, and of their solutions to contact
//! forces.

use super::{Setup, trajectory::PosesInPads};
use crate::{
    Result,
    deformation::{Deformation, Press},
    geometry::Shape,
    scene::{Scene, SceneState},
    tactile::Finger,
    task::EpisodeParameters,
};

/// Value for each finger of a row, such as a press or its solution; `None` where the finger does
/// not touch.
pub(super) type PerFinger<T> = [Option<T>; 2];

/// Creates the presses of `fingers` after the object has moved along `way`, its poses in the frame
/// of each pad.
pub(super) fn presses(
    fingers: &mut [Finger; 2],
    way: &[PosesInPads],
    object: &Shape,
    parameters: &EpisodeParameters,
    setup: &Setup,
) -> Result<PerFinger<Press>> {
    let Some(touch) = setup.touch() else { return Ok([None, None]) };
    let mut presses = [None, None];
    for (i, (press, finger)) in presses.iter_mut().zip(fingers).enumerate() {
        let path: Vec<_> = way.iter().map(|poses| poses[i]).collect();
        *press = finger.press(touch.skin(), object, &path, parameters.friction)?;
    }
    Ok(presses)
}

/// Corrects the pads of `scene`, whose state is `state`, towards the wrenches of the solutions
/// `felt`.
pub(super) fn correct(scene: &mut Scene, state: &SceneState, felt: &PerFinger<Deformation>) {
    for (finger, felt) in felt.iter().enumerate() {
        if felt.is_some() || state.fingers[finger].touches() {
            let wrench = felt.as_ref().map(|felt| felt.wrench).unwrap_or_default();
            scene.correct(finger, &wrench);
        }
    }
}

/// Solutions for gels whose Young's modulus is `stiffness` times that of the model: displacements
/// are the same, stresses and forces are in proportion to it.
pub(super) fn stiffened(
    answers: PerFinger<Result<Deformation>>,
    stiffness: f64,
) -> PerFinger<Result<Deformation>> {
    answers.map(|answer| Some(answer?.map(|felt| felt.stiffened(stiffness))))
}

/// Stores each finger's solution. Returns the solutions of the fingers that still touch, or the
/// first error.
pub(super) fn keep(
    fingers: &mut [Finger; 2],
    answers: PerFinger<Result<Deformation>>,
) -> Result<PerFinger<Deformation>> {
    let mut felt = [None, None];
    for ((felt, finger), answer) in felt.iter_mut().zip(fingers).zip(answers) {
        let answer = answer.transpose()?;
        *felt = answer.filter(|answer| finger.keep(answer));
    }
    Ok(felt)
}
