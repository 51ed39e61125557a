//! HoldStill: keep a gripped object in place under load and shaking, with little force.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{
    Ending, EpisodeParameters, GradualGrip, Progress, Range, RewardTerm, Rules, Setting, Start,
    StepState, Task, TaskConfig, least_grip, progress::OUT_OF_HAND, reward, setting::rising,
};
use crate::Result;

/// Time over which load and shaking grow to their full size (s).
const ONSET: f64 = 0.5;

/// Settings of the task.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HoldStill {
    grip: GradualGrip,
    /// Downward force in addition to the object's weight (N).
    load: Range,
    /// Amplitude of the shaking force (N).
    shaking: Range,
    /// Frequency of the shaking force (Hz).
    frequency: Range,
    /// Largest slip of an object that counts as held still (m).
    slip_limit: f64,
    /// Largest mean grip force of a success, relative to the least that holds against the largest
    /// force ([`Shaking::largest`]).
    max_grip_ratio: f64,
}

impl Default for HoldStill {
    fn default() -> Self {
        Self {
            grip: GradualGrip { start: 5.0, least: 0.2, rate: 10.0 },
            load: [0.0, 1.5],
            shaking: [0.3, 1.5],
            frequency: [0.5, 2.0],
            slip_limit: 3e-3,
            max_grip_ratio: 3.0,
        }
    }
}

impl Rules for HoldStill {
    fn name(&self) -> &'static str {
        "HoldStill"
    }

    fn doc(&self) -> &'static str {
        DOC
    }

    fn terms(&self) -> &'static [RewardTerm] {
        const TERMS: [RewardTerm; 2] = [
            RewardTerm::new(
                "still",
                0.6,
                still,
                "nothing has slipped; 0 at ``slip_limit``, linear between",
            ),
            RewardTerm::new(
                "grip_economy",
                0.4,
                grip_economy,
                "there is no grip force; 0 at twice the grip that success allows",
            ),
        ];
        &TERMS
    }

    fn usual_channels(&self, tactile: bool) -> &'static [&'static str] {
        if tactile { &["proprio", "wrench", "slip"] } else { &["proprio", "wrench"] }
    }

    fn settings(&mut self) -> Vec<Setting<'_>> {
        let Self { grip, load, shaking, frequency, slip_limit, max_grip_ratio } = self;
        let mut settings = Vec::from(grip.settings());
        settings.extend([
            Setting::range(
                "load",
                load,
                [0.0, 1e3],
                "N",
                "downward force in addition to the weight",
            ),
            Setting::range(
                "shaking",
                shaking,
                [0.0, 1e3],
                "N",
                "amplitude of a force that oscillates along one direction",
            ),
            Setting::range("shaking_frequency", frequency, [0.0, 5e3], "Hz", "its frequency"),
            Setting::number(
                "slip_limit",
                slip_limit,
                [1e-5, OUT_OF_HAND],
                "m",
                "largest slip of an object that counts as held still",
            ),
            Setting::number(
                "max_grip_ratio",
                max_grip_ratio,
                [1.0, 100.0],
                "",
                "largest mean grip of a success over the least that holds",
            ),
        ]);
        settings
    }

    fn unused_settings(&self) -> &'static [&'static str] {
        &["position", "yaw", "lift_height", "hold_time"]
    }

    fn adapt(&self, config: &mut TaskConfig) {
        // Also no objects that turn about the line between two contact points, which rigid pads
        // cannot prevent.
        config.choose_objects(&["sphere", "cuboid", "cylinder", "prism"]);
        config.move_gently();
        config.scene.gripper.max_force = super::config::FIRM_GRIP;
        config.start_height = [0.08, 0.12];
        config.mass = [0.02, 0.15];
        config.friction = [0.2, 1.6];
    }

    fn validate(&self, config: &TaskConfig) -> Result<()> {
        rising("friction", config.friction, [0.01, 10.0])?;
        let fastest = 0.5 / config.scene.physics.time_step;
        rising("shaking_frequency", self.frequency, [0.0, fastest])
    }

    fn start(&self) -> Start {
        Start::InHand
    }

    fn gradual_grip(&self) -> Option<&GradualGrip> {
        Some(&self.grip)
    }

    /// In equal ratios, so that no grip force suits more of the range than another.
    fn friction(&self, [low, high]: Range, share: f64) -> f64 {
        low * (high / low).powf(share)
    }

    fn draw(
        &self,
        _: &TaskConfig,
        episode: &mut EpisodeParameters,
        uniform: &mut dyn FnMut(Range) -> f64,
    ) {
        let (load, frequency) = (uniform(self.load), uniform(self.frequency));
        let amplitude = uniform(self.shaking);
        let (height, angle) = (uniform([-1.0, 1.0]), uniform([0.0, TAU]));
        let radius = (1.0 - height * height).max(0.0).sqrt();
        let direction = [radius * angle.cos(), radius * angle.sin(), height];
        let amplitude = direction.map(|x| amplitude * x);
        episode.shaking = Some(Shaking { load, amplitude, frequency });
    }

    fn ending(&self, step: &StepState, progress: &Progress) -> Option<Ending> {
        progress.is_out_of_hand(step).then_some(Ending::Dropped)
    }

    /// The object is in its place in the hand and held with little force.
    fn is_success(&self, step: &StepState, progress: &Progress, config: &TaskConfig) -> bool {
        step.both_touch()
            && progress.mean_grip().is_some_and(|mean| mean <= self.largest_grip(step, config))
            && progress.slip(step) <= self.slip_limit
    }
}

impl HoldStill {
    /// Largest mean grip force of a success (N): `max_grip_ratio` times the least that holds, by
    /// Coulomb's law, against the largest sum of weight, load and shaking.
    fn largest_grip(&self, step: &StepState, config: &TaskConfig) -> f64 {
        let EpisodeParameters { mass, friction, shaking, .. } = *step.episode;
        let weight = mass * config.scene.physics.gravity;
        let largest = shaking.map_or(weight, |shaking| shaking.largest(weight));
        self.max_grip_ratio * least_grip(largest, friction)
    }
}

/// Settings of HoldStill, the only task that has the two terms below.
fn settings(config: &TaskConfig) -> &HoldStill {
    match &config.task {
        Task::HoldStill(task) => task,
        other => unreachable!("a term of HoldStill in {}", other.name()),
    }
}

/// 1 with the object where it was in the hand at the start, 0 at the slip limit.
fn still(step: &StepState, progress: &Progress, config: &TaskConfig) -> f64 {
    reward::falling(progress.slip(step), settings(config).slip_limit)
}

/// 1 without grip force, 0 at twice [`HoldStill::largest_grip`], linear between.
fn grip_economy(step: &StepState, _: &Progress, config: &TaskConfig) -> f64 {
    reward::falling(step.grip, 2.0 * settings(config).largest_grip(step, config))
}

/// Disturbing force of an episode on its object: a load, and a sine along one direction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shaking {
    /// Downward force (N).
    pub load: f64,
    /// Amplitude along x, y, z of the world (N).
    pub amplitude: [f64; 3],
    /// Frequency (Hz).
    pub frequency: f64,
}

impl Shaking {
    /// Force at `time` since the start of the episode (N), in the world.
    pub fn force(&self, time: f64) -> Vector3<f64> {
        let swing = (TAU * self.frequency * time).sin();
        let force = swing * Vector3::from(self.amplitude) - self.load * Vector3::z();
        (time / ONSET).clamp(0.0, 1.0) * force
    }

    /// Largest magnitude of this force together with a `weight` (N), after its onset, in N.
    pub fn largest(&self, weight: f64) -> f64 {
        let (mean, swing) = (-(self.load + weight) * Vector3::z(), Vector3::from(self.amplitude));
        (mean + swing).norm().max((mean - swing).norm())
    }
}

const DOC: &str = r#"Keep a held object from slipping under load and shaking, with the least force.

World, channels and settings are those of :class:`GraspLiftEnv`, with these differences.
The object starts between the pads. A downward load and a force that oscillates along one
direction grow to full size within half a second and act on its centre of mass until the end.
Friction varies by a factor of eight and is not observed: the least force that holds shows in
the share of the contact that slides.

## Action
As of :class:`GraspFragileEnv`: the hand moves up and down at 0.1 m/s at most, and the fifth
number changes the grip by a factor of 1.5 per step at most, between ``least_grip`` and 20 N.

## Observation
By default ``proprio``, ``wrench`` and ``slip``, the last not with rigid pads; position, mass
and friction of the object, load and shaking are not included.

## Reward
Slip is the distance that the object has moved in the hand since the start, plus 1 cm per radian
of its rotation.

{terms}

## Start
The hand, 8 to 12 cm over the table (``start_height``), has gripped the object's middle across
its narrower side with ``start_grip``, 5 N. Load, and amplitude, direction and frequency of the
shaking are also drawn. ``friction``, 0.2 to 1.6, is drawn log-uniformly, so that no grip in
proportion to the load suits more of the range than another.

## End
Truncated after ``max_episode_steps`` steps, 100 by default. Also terminated, with
``info["ending"]`` ``dropped``, when no pad touches the object or it has slipped by 2 cm.
``info["is_success"]`` is true if both pads press on the object, the slip is within
``slip_limit``, and the mean grip since the first second is at most ``max_grip_ratio`` times
F / 2 μ, the least grip that holds, by Coulomb's law, against a tangential force F; F is the
largest resultant of weight, load and shaking. It is never true in the first second.

## Settings
Those of :class:`GraspLiftEnv`, with these differences:

{settings}

``position``, ``yaw``, ``lift_height`` and ``hold_time`` are errors."#;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_force_comes_on_from_zero_and_has_the_load_as_its_mean() {
        let shaking = Shaking { load: 1.2, amplitude: [0.3, 0.0, -0.4], frequency: 2.0 };
        assert_eq!(shaking.force(0.0), Vector3::zeros());
        let period = (0..100).map(|i| shaking.force(1.0 + 0.005 * f64::from(i)));
        let mean: Vector3<f64> = period.sum::<Vector3<f64>>() / 100.0;
        assert!((mean - Vector3::new(0.0, 0.0, -1.2)).norm() < 1e-9, "{mean:?} N");
        let peak = shaking.force(1.125);
        assert!((peak - Vector3::new(0.3, 0.0, -1.6)).norm() < 1e-9, "{peak:?} N");
        let largest = shaking.largest(0.9);
        assert!((largest - 0.3f64.hypot(2.5)).abs() < 1e-12, "{largest} N");
    }
}
