//! Fruit and vegetables: ellipsoids with waves, bumps and dimples.
//!
//! The stem is at +z. Directions and lengths are drawn; proportions were chosen by eye.

use std::f64::consts::FRAC_PI_2;

use nalgebra::Vector3;

use super::draw::Draw;
use crate::geometry::{Bump, StarShaped, Wave};

/// An uneven ball, longer than wide.
pub(super) fn potato(draw: &mut Draw) -> StarShaped {
    let width = draw.spread(0.016, 0.021);
    let semi_axes = Vector3::new(width, draw.uniform(1.05, 1.2) * width, 1.45 * width);
    let wave = |draw: &mut Draw| {
        let vector = draw.uniform(2.0, 4.5) * draw.direction().into_inner();
        Wave { amplitude: draw.uniform(0.02, 0.06), vector, phase: draw.uniform(-3.0, 3.0) }
    };
    StarShaped::new(semi_axes, (0..5).map(|_| wave(draw)).collect())
}

/// A spindle with a nipple at the tip and a knob at the stem.
pub(super) fn lemon(draw: &mut Draw) -> StarShaped {
    let width = draw.spread(0.018, 0.022);
    let length = draw.uniform(1.15, 1.25) * width;
    blob([width, width, length], &[])
        .with_bumps(vec![stem(draw.uniform(0.08, 0.11), 30.0), tip(draw.uniform(0.14, 0.18), 22.0)])
}

/// A flattened ball with six soft ribs and a dimple at the stem.
pub(super) fn tomato(draw: &mut Draw) -> StarShaped {
    let width = draw.spread(0.022, 0.026);
    let height = draw.uniform(0.74, 0.84) * width;
    let rib = draw.uniform(0.006, 0.010);
    // Three waves at 60° make six lobes, which are deepest at a wave number of 7.
    let across = 0.75f64.sqrt();
    let ribs = [[1.0, 0.0], [0.5, across], [-0.5, across]]
        .map(|[x, y]| wave(rib, [7.0 * x, 7.0 * y, 0.0], 0.0));
    blob([width, width, height], &ribs)
        .with_bumps(vec![stem(-draw.uniform(0.26, 0.30), 14.0), tip(-0.08, 20.0)])
}

/// A ball, wider above the middle, with a deep dimple at the stem and a flat one below.
pub(super) fn apple(draw: &mut Draw) -> StarShaped {
    let width = draw.spread(0.021, 0.026);
    let height = draw.uniform(0.95, 1.05) * width;
    blob([width, width, height], &[wider_up(draw.uniform(0.04, 0.07))])
        .with_bumps(vec![stem(-draw.uniform(0.27, 0.31), 14.0), tip(-0.10, 30.0)])
}

/// A rounded cone, tip down, with shoulders round the stem.
pub(super) fn strawberry(draw: &mut Draw) -> StarShaped {
    let width = draw.spread(0.015, 0.018);
    let height = draw.uniform(1.15, 1.25) * width;
    blob([width, width, height], &[wider_up(draw.uniform(0.14, 0.18))])
        .with_bumps(vec![stem(-0.14, 8.0), tip(0.14, 5.0)])
}

/// A long stick with blunt ends, a little bent.
pub(super) fn cucumber(draw: &mut Draw) -> StarShaped {
    let width = draw.spread(0.013, 0.015);
    blob([width, width, draw.uniform(3.6, 4.0) * width], &bent(draw.uniform(0.02, 0.04)))
        .with_bumps(vec![stem(-0.2, 20.0), tip(-0.2, 20.0)])
}

/// A bent pear with a short piece of its stem.
pub(super) fn eggplant(draw: &mut Draw) -> StarShaped {
    let width = draw.spread(0.017, 0.020);
    let [one, other] = bent(draw.uniform(0.03, 0.04));
    blob([width, width, draw.uniform(2.1, 2.3) * width], &[wider_up(-0.17), one, other])
        .with_bumps(vec![stem(0.06, 50.0), tip(-0.12, 6.0)])
}

fn blob(semi_axes: [f64; 3], waves: &[Wave]) -> StarShaped {
    StarShaped::new(semi_axes.into(), waves.to_vec())
}

fn wave(amplitude: f64, vector: [f64; 3], phase: f64) -> Wave {
    Wave { amplitude, vector: vector.into(), phase }
}

/// `amplitude` sin(1.6 z): radii grow towards the stem.
fn wider_up(amplitude: f64) -> Wave {
    wave(amplitude, [0.0, 0.0, 1.6], -FRAC_PI_2)
}

/// 2 `amplitude` sin(1.5 x) cos(2.4 z), as two waves: out at +x in the middle, at −x towards the
/// ends.
fn bent(amplitude: f64) -> [Wave; 2] {
    [2.4, -2.4].map(|z| wave(amplitude, [1.5, 0.0, z], -FRAC_PI_2))
}

fn stem(amplitude: f64, concentration: f64) -> Bump {
    Bump { amplitude, axis: Vector3::z_axis(), concentration }
}

fn tip(amplitude: f64, concentration: f64) -> Bump {
    Bump { amplitude, axis: -Vector3::z_axis(), concentration }
}
