//! The limit of a fragile grasp: the stress of a trial grip, by the model that the fingers feel with.

use nalgebra::Vector3;

use super::{
    Setup,
    start::Start,
    touch::{PerFinger, presses},
};
use crate::{
    Error, Result,
    deformation::{Deformation, Press},
    scene::Object,
    tactile::{Finger, peak_stress},
    task::{Draw, Trial},
};

/// Motion past a pad from which a pose on the way into the trial is kept (m).
const COARSE: f64 = 2e-4;

/// The presses of a hand that holds the `object` in the air with `grip` (N).
pub(super) fn trial(
    setup: &Setup,
    object: &Object,
    draw: &Draw,
    grip: f64,
) -> Result<PerFinger<Press>> {
    let config = &setup.config.scene;
    let [low, high] = [config.workspace.low, config.workspace.high].map(Vector3::from);
    let Start { way, .. } = Start::holding(config, object, &(0.5 * (low + high)), grip, COARSE)?;
    let shape = setup.felt_shape(draw.object).scaled(draw.scale);
    presses(&mut way.start().map(Finger::new), way.poses(), &shape, draw, setup)
}

/// The limit (Pa) by the `answers` to a trial. There no model has corrected the pads, which press with
/// another force than the grip's: stress is taken to go as the root of the force.
pub(super) fn limit(trial: &Trial, answers: PerFinger<Result<Deformation>>) -> Result<f64> {
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
