//! GraspFragile: lift an object that the hand is about to touch, under a limit on the stress in the
//! pads.
//!
//! The limit comes from a trial grip of the object at hand: its peak stress times a margin.

use serde::Serialize;

use super::{
    Ending, EpisodeParameters, GradualGrip, Progress, Range, RewardTerm, Rules, Setting, Start,
    StateChannel, StepState, TaskConfig, TrialGrip, least_grip, reward,
};
use crate::{Error, Result, tactile::Choice};

/// Settings of the task.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GraspFragile {
    grip: GradualGrip,
    /// Grip force of the trial, relative to the least that holds the object.
    safety_factor: f64,
    /// Stress limit relative to the peak stress of the trial.
    margin: Range,
}

impl Default for GraspFragile {
    fn default() -> Self {
        // The trial grip of the lightest object is 0.5 N; the force must grow slowly enough to
        // sense the contact before that.
        let grip = GradualGrip { start: 0.2, least: 0.2, rate: 5.0 };
        Self { grip, safety_factor: 2.0, margin: [1.1, 1.25] }
    }
}

impl Rules for GraspFragile {
    fn name(&self) -> &'static str {
        "GraspFragile"
    }

    fn doc(&self) -> &'static str {
        DOC
    }

    fn terms(&self) -> &'static [RewardTerm] {
        const TERMS: [RewardTerm; 3] = [
            RewardTerm::new(
                "grasp",
                0.1,
                reward::grasp,
                "both pads press with the trial grip (see Start) or more",
            ),
            RewardTerm::new(
                "lift",
                0.4,
                reward::lift,
                "the grasped object has risen by ``lift_height``, 3 cm",
            ),
            RewardTerm::new("hold", 0.5, reward::hold, "it has been up for ``hold_time``"),
        ];
        &TERMS
    }

    fn channels(&self) -> &'static [StateChannel] {
        &[StateChannel::StressRatio, StateChannel::StressLimit]
    }

    fn usual_channels(&self, _: bool) -> &'static [&'static str] {
        &["proprio", "wrench", "stress_ratio"]
    }

    fn settings(&mut self) -> Vec<Setting<'_>> {
        let Self { grip, safety_factor, margin } = self;
        let mut settings = Vec::from(grip.settings());
        settings.extend([
            Setting::number(
                "safety_factor",
                safety_factor,
                [1.0, 100.0],
                "",
                "grip force of the trial over the least that holds the object",
            ),
            Setting::range(
                "margin",
                margin,
                [0.01, 100.0],
                "",
                "limit of the stress over its peak in the trial",
            ),
        ]);
        settings
    }

    fn unused_settings(&self) -> &'static [&'static str] {
        &["yaw", "start", "start_height"]
    }

    fn adapt(&self, config: &mut TaskConfig) {
        // Only objects that meet the pads with neither an edge nor a flat face.
        config.choose_objects(&["sphere", "cylinder", "ellipsoid"]);
        config.begin_round_the_object();
        config.scene.gripper.max_force = super::config::FIRM_GRIP;
        config.mass = [0.05, 0.4];
        config.friction = [0.3, 1.0];
        config.size = [0.8, 1.2];
    }

    fn validate(&self, config: &TaskConfig) -> Result<()> {
        if config.tactile == Choice::None {
            let expected =
                "surrogate, compliance or fem: GraspFragile limits the stress in the pads";
            return Err(Error::invalid("tactile", "none", expected));
        }
        let heaviest = config.mass[1] * config.scene.physics.gravity;
        let hardest = self.safety_factor * least_grip(heaviest, config.friction[0]);
        let most = config.scene.gripper.max_force;
        if hardest <= most {
            return Ok(());
        }
        let found =
            format!("{}, a grip of {hardest:.1} N on the heaviest object", self.safety_factor);
        let expected = format!(
            "{most} N at most: less safety_factor or mass, more friction or gripper max_force"
        );
        Err(Error::invalid("safety_factor", found, expected))
    }

    fn start(&self) -> Start {
        Start::AroundObject
    }

    fn gradual_grip(&self) -> Option<&GradualGrip> {
        Some(&self.grip)
    }

    fn limits_pad_stress(&self) -> bool {
        true
    }

    fn draw(
        &self,
        config: &TaskConfig,
        episode: &mut EpisodeParameters,
        uniform: &mut dyn FnMut(Range) -> f64,
    ) {
        let weight = episode.mass * config.scene.physics.gravity;
        episode.trial = Some(TrialGrip {
            grip: self.safety_factor * least_grip(weight, episode.friction),
            margin: uniform(self.margin),
        });
    }

    fn ending(&self, step: &StepState, progress: &Progress) -> Option<Ending> {
        progress.is_let_go(step).then_some(Ending::Dropped)
    }
}

const DOC: &str = r#"Find out by touch how hard to grip an object: enough to lift it, too little to break it.

World, channels and settings are those of :class:`GraspLiftEnv`, with these differences. The
fingers start around the object, the hand moves up and down only, and mass and friction vary
such that the least force that holds an object varies by more than a factor of twenty. The limit
of the stress in the pads is a little above that of a safe grip of the object at hand, whatever
its mass, friction and curvature: only touch tells which force is enough and not too much.

## Action
The hand moves at 0.1 m/s at most; its workspace is a line, and it does not turn. The fifth
number changes the grip force at a relative rate of ``grip_rate`` times the number per second (a
factor of 1.22 per step at most), between ``least_grip`` and 20 N.

## Observation
By default ``proprio``, ``wrench`` and ``stress_ratio``; the position of the object is not
included. Two channels exist in this task only:

{channels}

An agent with touch uses ``stress_ratio``, or ``stress`` with ``stress_limit``; one without touch
uses neither.

## Reward
{terms}

## Start
The object lies in the middle, its narrower side across, half a millimetre from each pad; the
grip force is ``start_grip``, 0.2 N, which is also the least. Objects weigh 50 to 400 g,
friction is 0.3 to 1.0, size 0.8 to 1.2. The limit comes from a trial with the same object
before the start: it hangs in a hand that grips with ``safety_factor`` times the least force that
holds it, m g / 2 μ; the limit is the highest stress in that trial times a number drawn from
``margin``. Every limit can therefore be kept, and none allows an arbitrary grip.

## End
Truncated after ``max_episode_steps`` steps, 60 by default. Also terminated, with
``info["ending"]`` ``stress_exceeded`` after the first step that ends with more stress than the
limit, ``dropped`` when no pad touches the object any more, and ``press_failed`` in the first
step if the trial could not be solved (``no-trial``).

## Settings
Those of :class:`GraspLiftEnv`, with these differences:

{settings}

``tactile="none"``, ``yaw``, ``start`` and ``start_height`` are errors."#;
