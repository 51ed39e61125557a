//! Stress limit of a fragile grasp: the peak stress of a trial grip, computed with the tactile
//! model of the fingers.

use nalgebra::Vector3;

use super::{
    Setup,
    contact::{ContactState, PerFinger},
    start::{InitialState, scene_of},
};
use crate::{
    Error, Result,
    deformation::{Deformation, Press},
    scene::SceneObject,
    tactile::peak_stress,
    task::{EpisodeParameters, TrialGrip},
};

/// Motion relative to a pad after which another pose of the trial's trajectory is kept (m).
const COARSE: f64 = 2e-4;

/// Creates the presses of a hand that holds the `object` in the air with `grip` (N).
pub(super) fn trial(
    setup: &Setup,
    object: &SceneObject,
    parameters: &EpisodeParameters,
    grip: f64,
) -> Result<PerFinger<Press>> {
    let config = &scene_of(setup, parameters);
    let [low, high] = [config.workspace.low, config.workspace.high].map(Vector3::from);
    let (place, pose) = InitialState::in_hand(config, object, &(0.5 * (low + high)));
    let object = SceneObject { pose, ..object.clone() };
    let InitialState { scene, path, .. } =
        InitialState::holding(config, &object, &place, grip, COARSE)?;
    let mut contact = ContactState::new(setup.tactile(), path.start());
    contact.press(setup, &scene.state(), path.poses(), parameters)
}

/// Computes the stress limit (Pa) from the solutions `answers` of a trial. During the trial no
/// model corrects the pads, so the normal force differs from the grip force; the stress is assumed
/// to be proportional to the square root of the force.
pub(super) fn limit(trial: &TrialGrip, answers: PerFinger<Result<Deformation>>) -> Result<f64> {
    let [left, right] = answers.map(|answer| answer.unwrap_or(Err(Error::NoTrial)));
    let (left, right) = (left?, right?);
    let force = -0.5 * (left.wrench.force.z + right.wrench.force.z);
    let peak = peak_stress([&left, &right].into_iter());
    if force > 0.0 && peak > 0.0 {
        Ok(trial.margin * peak * (trial.grip / force).sqrt())
    } else {
        Err(Error::NoTrial)
    }
}
