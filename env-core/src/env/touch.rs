//! How the rigid world's motion becomes presses, and answers become what a row feels.

use super::{Setup, way::PosesInPads};
use crate::{
    Result,
    deformation::{Deformation, Press},
    geometry::Shape,
    scene::{Scene, SceneState, Wrench},
    tactile::Finger,
    task::Draw,
};

/// What one row's fingers ask or are told: for each a press, or an answer, where it touches.
pub(super) type PerFinger<T> = [Option<T>; 2];

/// The presses that `fingers` ask to be answered after the object has moved along `way`, its poses in
/// the frame of each pad.
pub(super) fn presses(
    fingers: &mut [Finger; 2],
    way: &[PosesInPads],
    object: &Shape,
    draw: &Draw,
    setup: &Setup,
) -> Result<PerFinger<Press>> {
    let Some(touch) = setup.touch() else { return Ok([None, None]) };
    let mut presses = [None, None];
    for (i, (press, finger)) in presses.iter_mut().zip(fingers).enumerate() {
        let path: Vec<_> = way.iter().map(|poses| poses[i]).collect();
        *press = finger.press(touch.skin(), object, &path, draw.friction)?;
    }
    Ok(presses)
}

/// Corrects the pads of `scene`, in `state`, towards what the fingers felt there.
pub(super) fn correct(scene: &mut Scene, state: &SceneState, felt: &PerFinger<Deformation>) {
    for (finger, felt) in felt.iter().enumerate() {
        if felt.is_some() || state.fingers[finger].touches() {
            let wrench = felt.as_ref().map(|felt| felt.wrench).unwrap_or_default();
            scene.correct(finger, &Wrench { force: wrench.force, torque: wrench.torque });
        }
    }
}

/// Hands each finger its answer; the answers of those that still touch, or the first error.
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
