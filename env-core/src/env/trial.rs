//! Stress limit of a fragile grasp: the peak stress of a trial grip, computed with the tactile
//! model of the fingers.

use nalgebra::Vector3;

use super::{
    Setup,
    contact::{ContactState, PerFinger},
    start::{InitialState, scene_of, settle},
};
use crate::{
    Error, Result,
    deformation::{Deformation, Press},
    scene::{Scene, SceneObject},
    tactile::peak_stress,
    task::{EpisodeParameters, TrialGrip},
};

/// Motion relative to a pad after which another pose of the trial's trajectory is kept (m).
const COARSE: f64 = 2e-4;

/// Hand that holds the object in the air with the trial grip.
pub(super) struct TrialHold {
    scene: Scene,
    contact: ContactState,
    grip: f64,
}

impl TrialHold {
    /// Creates a hand that holds the `object` in the air with `grip` (N), and the presses of this.
    pub(super) fn new(
        setup: &Setup,
        object: &SceneObject,
        parameters: &EpisodeParameters,
        grip: f64,
    ) -> Result<(Self, PerFinger<Press>)> {
        let config = &scene_of(setup, parameters);
        let [low, high] = [config.workspace.low, config.workspace.high].map(Vector3::from);
        let (place, pose) = InitialState::in_hand(config, object, &(0.5 * (low + high)));
        let object = SceneObject { pose, ..object.clone() };
        let InitialState { scene, path, .. } =
            InitialState::holding(config, &object, &place, grip, COARSE)?;
        let mut contact = ContactState::new(setup.tactile(), path.start());
        let presses = contact.press(setup, &scene, path.poses(), parameters)?;
        Ok((Self { scene, contact, grip }, presses))
    }

    /// Corrects the pads with the solutions `answers`; see [`settle`].
    pub(super) fn settle(
        mut self,
        setup: &Setup,
        parameters: &EpisodeParameters,
        answers: PerFinger<Result<Deformation>>,
    ) -> Result<PerFinger<Press>> {
        settle(setup, &mut self.scene, &mut self.contact, self.grip, parameters, answers)
    }
}

/// Computes the stress limit (Pa) from the solutions `answers` of a trial that has settled. For the
/// few per cent by which the normal force still differs from the grip force, the stress is assumed
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
