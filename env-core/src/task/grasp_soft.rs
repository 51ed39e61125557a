//! GraspSoft: lift a soft object that rigid fingers are about to touch, deforming it little.

use serde::Serialize;

use super::{
    Ending, EpisodeParameters, GradualGrip, Progress, Range, RewardTerm, Rules, Setting, Start,
    StateChannel, StepState, TaskConfig, reward,
};
use crate::{Error, Result, tactile::Choice};

/// Thickness of the fingers (m): they may overlap the undeformed object by up to three quarters of
/// it.
const FINGER_THICKNESS: f64 = 0.012;

/// Material of a soft object.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SoftMaterial {
    /// Young's modulus (Pa).
    pub young: Range,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Von Mises stress, relative to Young's modulus, at which the object is crushed.
    pub crush: f64,
}

/// Settings of the task.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GraspSoft {
    grip: GradualGrip,
    material: SoftMaterial,
}

impl Default for GraspSoft {
    fn default() -> Self {
        Self {
            grip: GradualGrip { start: 0.1, least: 0.1, rate: 10.0 },
            material: SoftMaterial { young: [3e4, 1.5e5], poisson: 0.45, crush: 0.3 },
        }
    }
}

impl Rules for GraspSoft {
    fn name(&self) -> &'static str {
        "GraspSoft"
    }

    fn doc(&self) -> &'static str {
        DOC
    }

    fn terms(&self) -> &'static [RewardTerm] {
        const TERMS: [RewardTerm; 4] = [
            RewardTerm::new("touch", 0.1, reward::touch, "both fingers touch the object"),
            RewardTerm::new(
                "lift",
                0.3,
                reward::lift,
                "the grasped object has risen by ``lift_height``, 3 cm",
            ),
            RewardTerm::new("hold", 0.4, reward::hold, "it has been up for ``hold_time``"),
            RewardTerm::new(
                "gentle",
                0.2,
                reward::gentle,
                "lifted without stress; 0 where it crushes the object, linear between",
            ),
        ];
        &TERMS
    }

    fn channels(&self) -> &'static [StateChannel] {
        &[StateChannel::Squeeze, StateChannel::Deformation]
    }

    fn usual_channels(&self, _: bool) -> &'static [&'static str] {
        &["proprio", "wrench", "squeeze"]
    }

    fn settings(&mut self) -> Vec<Setting<'_>> {
        let Self { grip, material } = self;
        let SoftMaterial { young, poisson, crush } = material;
        let mut settings = Vec::from(grip.settings());
        settings.extend([
            Setting::range("young", young, [1e3, 1e8], "Pa", "Young's modulus of the object"),
            Setting::number("poisson", poisson, [0.0, 0.499], "", "Poisson's ratio of the object"),
            Setting::number(
                "crush",
                crush,
                [0.01, 1.0],
                "",
                "von Mises stress that crushes the object, over Young's modulus",
            ),
        ]);
        settings
    }

    fn unused_settings(&self) -> &'static [&'static str] {
        &["yaw", "start", "start_height"]
    }

    fn adapt(&self, config: &mut TaskConfig) {
        // Only objects that rigid faces touch first with neither a flat face nor an edge.
        config.choose_objects(&["sphere", "ellipsoid", "potato", "lemon"]);
        config.begin_round_the_object();
        config.scene.gripper.max_force = super::config::LIGHT_GRIP;
        config.scene.gripper.pad_thickness = FINGER_THICKNESS;
        config.mass = [0.02, 0.06];
        config.friction = [0.6, 1.0];
        config.size = [1.0, 1.0];
    }

    fn validate(&self, config: &TaskConfig) -> Result<()> {
        if config.tactile != Choice::Surrogate {
            let expected = "surrogate: it computes the deformation of the soft object";
            return Err(Error::invalid("tactile", serde_json::json!(config.tactile), expected));
        }
        if let Some(found) = &config.network {
            let expected = "none: the setting is for networks of pads, and the fingers are rigid";
            return Err(Error::invalid("network", found, expected));
        }
        if config.size != [1.0, 1.0] {
            let found = format!("{:?}", config.size);
            return Err(Error::invalid("size", found, "1: soft objects have one size"));
        }
        Ok(())
    }

    fn start(&self) -> Start {
        Start::AroundObject
    }

    fn gradual_grip(&self) -> Option<&GradualGrip> {
        Some(&self.grip)
    }

    fn soft_material(&self) -> Option<&SoftMaterial> {
        Some(&self.material)
    }

    fn draw(
        &self,
        _: &TaskConfig,
        episode: &mut EpisodeParameters,
        uniform: &mut dyn FnMut(Range) -> f64,
    ) {
        let young = uniform(self.material.young);
        episode.young = Some(young);
        episode.stress_limit = Some(self.material.crush * young);
    }

    fn ending(&self, step: &StepState, progress: &Progress) -> Option<Ending> {
        progress.is_let_go(step).then_some(Ending::Dropped)
    }
}

const DOC: &str = r#"Lift a soft object of unknown stiffness with two rigid fingers, deforming it little.

World and settings are those of :class:`GraspLiftEnv`, with these differences. The fingers are
rigid and flat, and start around the object, which is soft; the hand moves up and down only.
While both fingers touch the object, a graph network (:class:`ruffini.SoftSurrogate`) computes
its deformation and stress after every step, and the contact force of the simulation is
corrected towards that of the network. The network includes neither weight nor table: friction
is computed by the elastic foundation of bristles between fingers and object.

## Action
As of :class:`GraspFragileEnv`: the hand moves at 0.1 m/s at most, and the fifth number changes
the grip force by a factor of 1.5 per step at most, between ``least_grip`` and 10 N.

## Observation
By default ``proprio``, ``wrench`` and ``squeeze``; position and stiffness of the object are not
included: the stiffness shows in the relation of force and opening, and in ``squeeze``. Two
channels exist in this task only; without contact of both fingers they are exactly 0:

{channels}

Both exclude the best-fitting rigid motion of the object. There are no tactile channels of soft
pads.

## Reward
{terms}

## Start
The object lies in the middle, its narrower side across, half a millimetre from each finger;
the grip force is ``start_grip``, 0.1 N, the least. Young's modulus is drawn from ``young``;
objects weigh 20 to 60 g and have one size.

## End
Truncated after ``max_episode_steps`` steps, 60 by default. Also terminated, with
``info["ending"]`` ``stress_exceeded`` after the first step that ends with more stress somewhere
in the object than ``crush`` times Young's modulus: it is crushed; and ``dropped`` when no
finger touches it any more. A squeeze that the network cannot solve ends the episode as
``press_failed``.

## Picture
The object has its deformed shape and is coloured by von Mises stress, from 0 to the stress that
crushes it.

## Settings
Those of :class:`GraspLiftEnv`, with these differences:

{settings}

``tactile`` is ``"surrogate"`` and ``size`` 1; anything else is an error, as are ``yaw``,
``start`` and ``start_height``. ``sensor`` gives the fingers their outline."#;
