//! Share of the normal force that slides, against the closed forms for a ball on a half-space.
//!
//! Under a growing tangential force Q, at the normal force P, what is outside of the radius
//! c = a (1 − Q/μP)^{1/3} slides (Cattaneo 1938, Mindlin 1949). When Q falls from its peak, all
//! sticks at first, and the change of Q slides back as half of it did forward, for what slid has to
//! be undone (Mindlin and Deresiewicz 1953). A pad is no half-space, so this holds roughly.

use nalgebra::Isometry3;
use ruffini_core::{
    compliance::nodal::ContactResolution,
    deformation::{Deformation, DeformationModel, Moduli, Press},
    geometry::Shape,
    sensor::Sensor,
    surrogate::LinearPad,
};

const MM: f64 = 1e-3;
const FRICTION: f64 = 0.6;
const RADIUS: f64 = 5.0 * MM;
/// Distances that the ball is moved down (m), and by which it is dragged in a frame.
const DOWN: [f64; 4] = [-0.1 * MM, 0.08 * MM, 0.14 * MM, 0.2 * MM];
const DRAG: f64 = 0.01 * MM;

/// Share of the normal force outside of the radius within which this part of the greatest friction
/// leaves all sticking.
fn mindlin(part: f64) -> f64 {
    (1.0 - (1.0 - part.min(1.0)).powf(2.0 / 3.0)).powf(1.5)
}

/// Part of the greatest friction that is used, with its sign, and share that slides, in each frame
/// in which the pressed ball is at these distances, in drags.
fn dragged(distances: impl Iterator<Item = i32>) -> Vec<(f64, f64)> {
    let down = DOWN.into_iter().map(|depth| (0.0, depth));
    let path = down.chain(distances.map(|i| (DRAG * f64::from(i), DOWN[3])));
    let frames = path.map(|(x, depth)| vec![Isometry3::translation(x, 0.0, RADIUS - depth)]);
    let ball = Shape::Sphere { radius: RADIUS };
    let press = Press::along(vec![ball], frames.collect()).unwrap();
    let press = press.with_friction(FRICTION).unwrap();
    let read = |felt: Deformation| {
        let force = felt.wrench.force;
        (force.x / (FRICTION * -force.z), felt.sliding)
    };
    let sensor = Sensor::named("gelsight-mini").unwrap();
    let moduli = Moduli { young: 3e5, poisson: 0.47 };
    let pad = LinearPad::new(&sensor, moduli, FRICTION, 1000, ContactResolution::FAST).unwrap();
    let frames = pad.solve_path(&press).into_iter().skip(DOWN.len() - 1);
    frames.map(|felt| read(felt.unwrap())).collect()
}

#[test]
fn when_the_force_turns_all_sticks_at_first() {
    const THERE: i32 = 12;
    let frames = dragged((1..=THERE).chain((0..THERE).rev()));
    let (peak, before) = frames[THERE as usize];
    assert!((0.4..0.95).contains(&peak) && before > 0.15, "{before} at {peak}");
    let back = &frames[THERE as usize + 1..];
    for (used, share) in back {
        let expected = mindlin(0.5 * (peak - used));
        assert!((share - expected).abs() < 0.12, "{share} at {used}, on a half-space {expected}");
    }
    let (first, last) = (back[0].1, back[back.len() - 1].1);
    assert!(first < 0.05 && last > first + 0.03, "{first} at once, {last} later");
}
