//! Soft pads: an implicit bed of bristles between the fingers and the object.

use ruffini_core::{
    scene::{SceneConfig, SoftPads},
    sensor::Sensor,
};

use crate::grasp::matrix;

pub(crate) fn soft() -> SceneConfig {
    let sensor = Sensor::named("gelsight-mini").unwrap();
    let pads = SoftPads::new(&sensor, &sensor.calibrations[0]);
    SceneConfig::default().with_pads(pads)
}

#[test]
fn soft_pads_hold_what_must_hold_and_drop_what_must_drop() {
    let wrong = matrix(&soft());
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
