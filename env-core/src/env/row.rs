//! One environment: reset, step, and what ended it.

use std::panic::{AssertUnwindSafe, catch_unwind};

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::Setup;
use crate::{
    Error, Result,
    scene::{Object, Scene, SceneState},
    task::{ACTION_SIZE, Draw, Ending, Moment, Progress, Range, RewardTerms, command},
};

/// One environment and the random stream that its resets draw from.
#[derive(Serialize, Deserialize)]
pub struct Row {
    random: ChaCha8Rng,
    episode: Option<Episode>,
}

#[derive(Serialize, Deserialize)]
struct Episode {
    scene: Scene,
    draw: Draw,
    grip: f64,
    steps: u32,
    progress: Progress,
    over: bool,
}

/// What a step came to, beside its observation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Weighted mean of the terms, in [0, 1].
    pub reward: f64,
    /// Each term, in [0, 1].
    pub terms: RewardTerms,
    /// The episode ended before its time.
    pub terminated: bool,
    /// The episode ran out of time.
    pub truncated: bool,
    /// The object is up and has been for long enough.
    pub is_success: bool,
    /// Why the episode ended before its time.
    pub ending: Option<Ending>,
}

impl Row {
    /// A row that has not been reset yet.
    pub fn new(seed: u64) -> Self {
        Self { random: ChaCha8Rng::seed_from_u64(seed), episode: None }
    }

    /// Restarts the random stream.
    pub fn seed(&mut self, seed: u64) {
        self.random = ChaCha8Rng::seed_from_u64(seed);
    }

    /// Starts a new episode and writes its first observation.
    pub fn reset(&mut self, setup: &Setup, observation: &mut [f32]) -> Result<()> {
        let episode = Episode::draw(setup, &mut self.random)?;
        let state = episode.scene.state();
        setup.layout.write(&episode.moment(&state, setup), observation);
        self.episode = Some(episode);
        Ok(())
    }

    /// Whether the row has never been reset.
    pub fn is_new(&self) -> bool {
        self.episode.is_none()
    }

    /// Whether the row must be reset before it can be stepped.
    pub fn needs_reset(&self) -> bool {
        self.episode.as_ref().is_none_or(|episode| episode.over)
    }

    /// Takes one control step and writes the observation. `observation` holds the previous one on
    /// entry, which stands where the new one would leave its declared range.
    ///
    /// # Panics
    /// If [`Row::needs_reset`].
    pub fn step(
        &mut self,
        setup: &Setup,
        action: &[f32; ACTION_SIZE],
        observation: &mut [f32],
        scratch: &mut [f32],
    ) -> Outcome {
        let episode = self.episode.as_mut().expect("callers reset a row before they step it");
        let step = || episode.step(setup, action, observation, scratch);
        // Rapier asserts its own invariants: a broken one ends this episode and no other.
        let outcome = catch_unwind(AssertUnwindSafe(step)).unwrap_or_else(|_| Outcome {
            terminated: true,
            ending: Some(Ending::EngineError),
            ..Outcome::default()
        });
        episode.over = outcome.terminated || outcome.truncated;
        outcome
    }

    /// Gives a row that was read from bytes the object of its episode back; an error if the settings
    /// have no such object.
    pub(super) fn attach(&mut self, setup: &Setup) -> Result<()> {
        let Some(episode) = &mut self.episode else { return Ok(()) };
        let (index, count) = (episode.draw.object, setup.models.len());
        let model = setup.models.get(index).ok_or_else(|| Error::BadState {
            reason: format!("object {index} of {count} in these settings"),
        })?;
        episode.scene.attach(model);
        Ok(())
    }

    /// The rigid world and the episode's draw, for a picture or a look inside.
    pub fn state(&self) -> Option<(SceneState, Draw)> {
        self.episode.as_ref().map(|episode| (episode.scene.state(), episode.draw))
    }
}

impl Episode {
    fn draw(setup: &Setup, random: &mut ChaCha8Rng) -> Result<Self> {
        let config = &setup.config;
        let object = random.random_range(0..setup.models.len());
        let mut uniform = |[low, high]: Range| low + (high - low) * random.random::<f64>();
        let (mass, friction) = (uniform(config.mass), uniform(config.friction));
        let (scale, yaw) = (uniform(config.size), uniform(config.yaw));
        let (x, y) = (uniform(config.position), uniform(config.position));
        let start = [config.start, config.start, config.start_height].map(&mut uniform);
        let model = &setup.models[object];
        let pose = model.rest(scale, x, y, yaw);
        let (low, high) = model.surface().bounds();
        let draw = Draw {
            object,
            scale,
            mass,
            friction,
            half_extents: (0.5 * scale * (high - low)).into(),
            rest_height: pose.translation.z,
        };
        let object = Object { model, scale, mass, friction, pose };
        let scene = Scene::new(&config.scene, &object, &Vector3::from(start), 0.0)?;
        let progress = Progress::default();
        Ok(Self { scene, draw, grip: 0.0, steps: 0, progress, over: false })
    }

    fn moment<'a>(&'a self, state: &'a SceneState, setup: &Setup) -> Moment<'a> {
        let time = f64::from(self.steps) * setup.config.scene.physics.control_period;
        Moment { state, draw: &self.draw, grip: self.grip, time }
    }

    fn step(
        &mut self,
        setup: &Setup,
        action: &[f32; ACTION_SIZE],
        observation: &mut [f32],
        scratch: &mut [f32],
    ) -> Outcome {
        let config = &setup.config;
        let command = command(action, &config.scene.gripper);
        self.scene.step(&command);
        self.grip = command.grip;
        self.steps += 1;
        let state = self.scene.state();
        let mut progress = self.progress;
        let moment = self.moment(&state, setup);
        setup.layout.write(&moment, scratch);
        let mut ending = Ending::of(&state);
        if !setup.layout.holds(scratch) {
            ending = ending.or(Some(Ending::OutOfRange));
        } else if ending != Some(Ending::NonFinite) {
            observation.copy_from_slice(scratch);
        }
        let terms = if matches!(ending, None | Some(Ending::ObjectLost)) {
            progress.advance(&moment, config);
            RewardTerms::of(&moment, &progress, config)
        } else {
            RewardTerms::default()
        };
        self.progress = progress;
        Outcome {
            reward: terms.reward(&config.reward),
            terms,
            terminated: ending.is_some(),
            truncated: ending.is_none() && self.steps >= config.max_episode_steps,
            is_success: progress.is_success(config),
            ending,
        }
    }
}
