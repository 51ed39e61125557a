//! One environment: reset, step, and what ended it.

use std::panic::{AssertUnwindSafe, catch_unwind};

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::{
    Setup,
    plan::{CHANNEL, CORRECTION, Costs, PRESS, REWARD, SCENE},
    touch::{PerFinger, correct, keep, poses_in_pads, presses},
};
use crate::{
    Error, Result,
    deformation::{Deformation, Press},
    geometry::Shape,
    scene::{Object, Scene, SceneState},
    tactile::{Feeling, Finger},
    task::{ACTION_SIZE, Draw, Ending, Moment, Progress, Range, RewardTerms, command},
};

/// One environment and the random stream that its resets draw from.
#[derive(Serialize, Deserialize)]
pub struct Row {
    random: ChaCha8Rng,
    episode: Option<Episode>,
    /// A step that has begun and waits for its presses to be answered.
    #[serde(skip)]
    motion: Option<Motion>,
    #[serde(skip)]
    costs: Costs,
}

#[derive(Serialize, Deserialize)]
struct Episode {
    scene: Scene,
    draw: Draw,
    /// The object in its drawn size, once a finger has asked for it.
    #[serde(skip)]
    object: Option<Shape>,
    fingers: [Finger; 2],
    grip: f64,
    steps: u32,
    progress: Progress,
    over: bool,
}

/// Where a step has led the rigid world.
struct Motion {
    state: SceneState,
    presses: PerFinger<Press>,
    answers: PerFinger<Result<Deformation>>,
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
    /// Kind of the error ([`Error::kind`]) where a press was not answered.
    pub press_error: Option<&'static str>,
}

impl Outcome {
    /// An episode that ended without a reward.
    fn ended(ending: Ending) -> Self {
        Self { terminated: true, ending: Some(ending), ..Self::default() }
    }

    fn press_failed(error: &Error) -> Self {
        Self { press_error: Some(error.kind()), ..Self::ended(Ending::PressFailed) }
    }
}

impl Row {
    /// A row that has not been reset yet.
    pub fn new(seed: u64) -> Self {
        Self {
            random: ChaCha8Rng::seed_from_u64(seed),
            episode: None,
            motion: None,
            costs: Costs::default(),
        }
    }

    /// Restarts the random stream.
    pub fn seed(&mut self, seed: u64) {
        self.random = ChaCha8Rng::seed_from_u64(seed);
    }

    /// Starts a new episode and writes its first observation.
    pub fn reset(&mut self, setup: &Setup, observation: &mut [f32]) -> Result<()> {
        let episode = Episode::draw(setup, &mut self.random)?;
        let state = episode.scene.state();
        setup.layout.write(&episode.moment(&state, setup, &[None, None]), observation);
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

    /// Moves the rigid world on by one control period; [`Row::conclude`] ends the step.
    ///
    /// # Panics
    /// If [`Row::needs_reset`].
    pub(super) fn advance(&mut self, setup: &Setup, action: &[f32; ACTION_SIZE]) {
        let episode = self.episode.as_mut().expect("callers reset a row before they step it");
        let costs = &mut self.costs;
        // Rapier asserts its own invariants: a broken one ends this episode and no other.
        let advance = || episode.advance(setup, action, costs);
        self.motion = catch_unwind(AssertUnwindSafe(advance)).ok();
    }

    /// Takes the presses that the step waits for.
    pub(super) fn ask(&mut self) -> PerFinger<Press> {
        self.motion.as_mut().map(|motion| std::mem::take(&mut motion.presses)).unwrap_or_default()
    }

    /// Gives a finger its answer.
    pub(super) fn answer(&mut self, finger: usize, answer: Result<Deformation>) {
        if let Some(motion) = &mut self.motion {
            motion.answers[finger] = Some(answer);
        }
    }

    /// Ends the step that [`Row::advance`] began and writes the observation. `observation` holds the
    /// previous one on entry, which stands where the new one would leave its declared range.
    ///
    /// # Panics
    /// If [`Row::needs_reset`].
    pub(super) fn conclude(
        &mut self,
        setup: &Setup,
        observation: &mut [f32],
        scratch: &mut [f32],
    ) -> Outcome {
        let episode = self.episode.as_mut().expect("callers reset a row before they step it");
        let (motion, costs) = (self.motion.take(), &mut self.costs);
        let mut conclude = |motion| episode.conclude(setup, motion, observation, scratch, costs);
        let outcome = motion
            .and_then(|motion| catch_unwind(AssertUnwindSafe(|| conclude(motion))).ok())
            .unwrap_or_else(|| Outcome::ended(Ending::EngineError));
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

    /// Time spent in this row's steps.
    pub(super) fn costs(&self) -> &Costs {
        &self.costs
    }

    /// Forgets the time spent.
    pub(super) fn forget_costs(&mut self) {
        self.costs = Costs::default();
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
        let fingers = poses_in_pads(&scene.state()).map(Finger::new);
        let (object, progress) = (None, Progress::default());
        Ok(Self { scene, draw, object, fingers, grip: 0.0, steps: 0, progress, over: false })
    }

    fn moment<'a>(
        &'a self,
        state: &'a SceneState,
        setup: &'a Setup,
        felt: &'a PerFinger<Deformation>,
    ) -> Moment<'a> {
        let time = f64::from(self.steps) * setup.config.scene.physics.control_period;
        let fingers = felt.each_ref().map(Option::as_ref);
        let feeling = setup.touch().map(|touch| Feeling { skin: touch.skin(), fingers });
        Moment { state, draw: &self.draw, grip: self.grip, time, feeling }
    }

    fn advance(&mut self, setup: &Setup, action: &[f32; ACTION_SIZE], costs: &mut Costs) -> Motion {
        let command = command(action, &setup.config.scene.gripper);
        self.grip = command.grip;
        self.steps += 1;
        let state = costs.time(SCENE, || {
            self.scene.step(&command);
            self.scene.state()
        });
        let mut motion = Motion { state, presses: [None, None], answers: [None, None] };
        if setup.touch().is_some() && motion.state.failure.is_none() {
            match costs.time(PRESS, || self.presses(&motion.state, setup)) {
                Ok(presses) => motion.presses = presses,
                Err(error) => motion.answers[0] = Some(Err(error)),
            }
        }
        motion
    }

    fn presses(&mut self, state: &SceneState, setup: &Setup) -> Result<PerFinger<Press>> {
        let draw = &self.draw;
        let scaled = || setup.models[draw.object].shape().scaled(draw.scale);
        let object = self.object.get_or_insert_with(scaled);
        presses(&mut self.fingers, state, object, draw, setup)
    }

    fn conclude(
        &mut self,
        setup: &Setup,
        motion: Motion,
        observation: &mut [f32],
        scratch: &mut [f32],
        costs: &mut Costs,
    ) -> Outcome {
        let config = &setup.config;
        let Motion { state, answers, .. } = motion;
        let felt = match keep(&mut self.fingers, answers) {
            Ok(felt) => felt,
            Err(error) => return Outcome::press_failed(&error),
        };
        if setup.touch().is_some() {
            costs.time(CORRECTION, || correct(&mut self.scene, &state, &felt));
        }
        let mut progress = self.progress;
        let moment = self.moment(&state, setup, &felt);
        observe(setup, &moment, scratch, costs);
        let mut ending = Ending::of(&state);
        if !setup.layout.holds(scratch) {
            ending = ending.or(Some(Ending::OutOfRange));
        } else if ending != Some(Ending::NonFinite) {
            observation.copy_from_slice(scratch);
        }
        let terms = if matches!(ending, None | Some(Ending::ObjectLost)) {
            costs.time(REWARD, || {
                progress.advance(&moment, config);
                RewardTerms::of(&moment, &progress, config)
            })
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
            press_error: None,
        }
    }
}

/// Writes the observation of `moment` into `row`, the time of each channel counted.
fn observe(setup: &Setup, moment: &Moment, row: &mut [f32], costs: &mut Costs) {
    let mut rest = row;
    for channel in 0..setup.layout.channels().len() {
        let here = rest;
        rest = costs.time(CHANNEL + channel, || setup.layout.write_channel(channel, moment, here));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        tactile::{Choice, Resolution},
        task::Config,
    };

    /// A row that feels, once reset, and its observation.
    fn row() -> (Setup, Row, Vec<f32>) {
        let resolution = Resolution { nodes: 100, ..Resolution::default() };
        let config = Config { tactile: Choice::Compliance, resolution, ..Config::default() };
        let (setup, mut row) = (Setup::new(config).unwrap(), Row::new(1));
        let mut observation = vec![0.0; setup.layout().size()];
        row.reset(&setup, &mut observation).unwrap();
        (setup, row, observation)
    }

    #[test]
    fn an_unanswered_press_ends_the_episode_with_the_last_observation() {
        let (setup, mut row, mut observation) = row();
        let (before, mut scratch) = (observation.clone(), observation.clone());
        row.advance(&setup, &[0.0, 0.0, -1.0, 0.0, 0.0]);
        row.answer(1, Err(Error::Inverted));
        let outcome = row.conclude(&setup, &mut observation, &mut scratch);
        assert_eq!(outcome.ending, Some(Ending::PressFailed));
        assert_eq!(outcome.press_error, Some("inverted"));
        assert!(outcome.terminated && row.needs_reset());
        assert_eq!(observation, before);
    }

    #[test]
    fn a_step_without_a_motion_is_an_engine_error() {
        let (setup, mut row, mut observation) = row();
        let mut scratch = observation.clone();
        let outcome = row.conclude(&setup, &mut observation, &mut scratch);
        assert_eq!(outcome.ending, Some(Ending::EngineError));
    }
}
