//! One environment: reset, step and end of its episodes.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::{
    Outcome, Setup,
    answers::Answer,
    contact::PerFinger,
    episode::{DRAWS, Episode, PendingStep, never_held},
    given::GivenStart,
    guarded,
    plan::StageTimes,
};
use crate::{
    Error, Result,
    deformation::Press,
    scene::SceneState,
    task::{ACTION_SIZE, Ending, EpisodeParameters, StartQuantity},
};

/// One environment and the random stream of its resets.
#[derive(Serialize, Deserialize)]
pub struct Row {
    random: ChaCha8Rng,
    episode: Option<Episode>,
    /// Reset or step whose presses have not been solved yet.
    #[serde(skip)]
    motion: Option<PendingStep>,
    /// Draws of this reset of which the object slipped out of the hand.
    #[serde(skip)]
    slipped: usize,
    #[serde(skip)]
    costs: StageTimes,
    #[serde(skip)]
    given: GivenStart,
}

impl Row {
    /// Creates a row that has not been reset yet.
    pub fn new(seed: u64) -> Self {
        Self {
            random: ChaCha8Rng::seed_from_u64(seed),
            episode: None,
            motion: None,
            slipped: 0,
            costs: StageTimes::default(),
            given: GivenStart::default(),
        }
    }

    /// Restarts the random stream.
    pub fn seed(&mut self, seed: u64) {
        self.random = ChaCha8Rng::seed_from_u64(seed);
    }

    /// Begins a reset, which [`Row::open`] ends. After an error the row is as one that was never
    /// reset.
    pub(super) fn reset(&mut self, setup: &Setup) -> Result<()> {
        self.slipped = 0;
        self.draw(setup)
    }

    fn draw(&mut self, setup: &Setup) -> Result<()> {
        (self.episode, self.motion) = (None, None);
        let start = || Episode::start(setup, &mut self.random, &self.given);
        let (episode, motion) = guarded(start).flatten()?;
        (self.episode, self.motion) = (Some(episode), Some(motion));
        Ok(())
    }

    /// Returns whether the reset that has begun is to go on with [`Row::settle`].
    pub(super) fn is_unsettled(&self) -> bool {
        self.motion.as_ref().is_some_and(PendingStep::is_unsettled)
    }

    /// Replaces the solved presses by further ones while an object that the hand holds at the
    /// beginning of an episode has not come to rest. If it slips out of the hand, the parameters of
    /// the episode are drawn again; if it does in [`DRAWS`] draws, that is an error. Errors are as
    /// those of [`Row::reset`].
    pub(super) fn settle(&mut self, setup: &Setup) -> Result<()> {
        let (Some(episode), Some(motion)) = (&mut self.episode, &mut self.motion) else {
            return Ok(());
        };
        let Err(error) = guarded(|| episode.settle(setup, motion)).flatten() else {
            return Ok(());
        };
        let object = episode.object();
        (self.episode, self.motion) = (None, None);
        self.slipped += 1;
        match error {
            Error::NotHeld { .. } if self.slipped < DRAWS => self.draw(setup),
            Error::NotHeld { grip } => Err(never_held(setup, object, grip)),
            error => Err(error),
        }
    }

    /// Ends the reset that [`Row::reset`] began and writes the first observation.
    pub(super) fn open(&mut self, setup: &Setup, observation: &mut [f32]) {
        if let (Some(episode), Some(motion)) = (&mut self.episode, self.motion.take()) {
            episode.open(setup, motion, observation);
        }
    }

    /// Returns whether the row has no episode: it was never reset, or its last reset failed.
    pub fn is_new(&self) -> bool {
        self.episode.is_none()
    }

    /// Returns whether the row must be reset before it can be stepped.
    pub fn needs_reset(&self) -> bool {
        self.episode.as_ref().is_none_or(|episode| episode.over)
    }

    /// Sets a quantity of the start of all further episodes; with NaN it is drawn again.
    pub(super) fn give(
        &mut self,
        quantity: StartQuantity,
        value: f64,
        setup: &Setup,
    ) -> Result<()> {
        self.given.set(quantity, value, setup)
    }

    /// Ends the episode.
    pub(super) fn end(&mut self) {
        if let Some(episode) = &mut self.episode {
            episode.over = true;
        }
    }

    /// Moves the rigid bodies through one control period; [`Row::conclude`] ends the step.
    ///
    /// # Panics
    /// If [`Row::is_new`].
    pub(super) fn advance(&mut self, setup: &Setup, action: &[f32; ACTION_SIZE]) {
        let episode = self.episode.as_mut().expect("callers reset a row before they step it");
        // A panic ends only the episode of this row.
        self.motion = guarded(|| episode.advance(setup, action, &mut self.costs)).ok();
    }

    /// Takes the presses of the reset or step that has begun.
    pub(super) fn ask(&mut self) -> PerFinger<Press> {
        self.motion.as_mut().map(|motion| std::mem::take(&mut motion.presses)).unwrap_or_default()
    }

    /// Returns presses that reproduce the current contact of the fingers; none before the first
    /// reset.
    pub(super) fn touch_again(&self, setup: &Setup) -> Result<PerFinger<Press>> {
        self.episode.as_ref().map_or(Ok([None, None]), |episode| episode.touch_again(setup))
    }

    /// Index of this episode's object, 0 before the first reset.
    pub(super) fn object(&self) -> usize {
        self.episode.as_ref().map_or(0, Episode::object)
    }

    /// Stores the solution of a finger's press.
    pub(super) fn answer(&mut self, finger: usize, answer: Answer) {
        if let Some(motion) = &mut self.motion {
            motion.answers[finger] = Some(answer.found);
            motion.restarted = motion.restarted.or(answer.restarted);
        }
    }

    /// Ends the step that [`Row::advance`] began and writes the observation. `observation` holds
    /// the previous observation on entry and keeps it if the new one has an entry outside its
    /// declared range.
    ///
    /// # Panics
    /// If [`Row::is_new`].
    pub(super) fn conclude(
        &mut self,
        setup: &Setup,
        observation: &mut [f32],
        scratch: &mut [f32],
    ) -> Outcome {
        let episode = self.episode.as_mut().expect("callers reset a row before they step it");
        let (motion, costs) = (self.motion.take(), &mut self.costs);
        let mut conclude = |motion| episode.conclude(setup, motion, observation, scratch, costs);
        let mut outcome = motion
            .and_then(|motion| guarded(|| conclude(motion)).ok())
            .unwrap_or_else(|| Outcome::ended(Ending::EngineError));
        outcome.truncated = episode.is_out_of_time(setup);
        episode.over = outcome.terminated || outcome.truncated;
        outcome
    }

    /// Attaches the object of the episode to a deserialised row. Returns an error if the settings
    /// have no such object.
    pub(super) fn attach(&mut self, setup: &Setup) -> Result<()> {
        self.episode.as_mut().map_or(Ok(()), |episode| episode.attach(setup))
    }

    /// Time spent in the steps of this row.
    pub(super) fn costs(&self) -> &StageTimes {
        &self.costs
    }

    /// Resets the time spent to zero.
    pub(super) fn forget_costs(&mut self) {
        self.costs = StageTimes::default();
    }

    /// Greatest depths of the pads' faces inside the object (m), see
    /// [`crate::scene::Scene::indentations`]; `None` before the first reset.
    pub fn indentations(&self) -> Option<[f64; 2]> {
        self.episode.as_ref().map(Episode::indentations)
    }

    /// State of the rigid bodies and parameters of the episode; `None` before the first reset.
    pub fn state(&self) -> Option<(SceneState, EpisodeParameters)> {
        self.episode.as_ref().map(Episode::state)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        deformation::Wanted,
        tactile::{Choice, Resolution},
        task::{Task, TaskConfig},
    };

    /// A tactile row after a reset, and its observation.
    fn row() -> (Setup, Row, Vec<f32>) {
        let resolution = Resolution { nodes: 100, ..Resolution::default() };
        let config =
            TaskConfig { tactile: Choice::Compliance, resolution, ..TaskConfig::default() };
        let (setup, mut row) = (Setup::new(config).unwrap(), Row::new(1));
        let mut observation = vec![0.0; setup.layout().size()];
        row.reset(&setup).unwrap();
        row.open(&setup, &mut observation);
        (setup, row, observation)
    }

    #[test]
    fn an_unanswered_press_ends_the_episode_with_the_last_observation() {
        let (setup, mut row, mut observation) = row();
        let (before, mut scratch) = (observation.clone(), observation.clone());
        row.advance(&setup, &[0.0, 0.0, -1.0, 0.0, 0.0]);
        row.answer(1, Answer { found: Err(Error::Inverted), restarted: None });
        let outcome = row.conclude(&setup, &mut observation, &mut scratch);
        assert_eq!(outcome.ending, Some(Ending::PressFailed));
        assert_eq!(outcome.press_error, Some("inverted"));
        assert!(outcome.terminated && row.needs_reset());
        assert_eq!(observation, before);
    }

    #[test]
    fn an_object_that_slips_out_of_the_hand_in_every_draw_is_an_error() {
        let config = TaskConfig {
            tactile: Choice::Compliance,
            resolution: Resolution { nodes: 100, ..Resolution::default() },
            friction: [0.2; 2],
            ..TaskConfig::of(&Task::named("HoldStill").unwrap())
        };
        let (setup, mut row) = (Setup::new(config).unwrap(), Row::new(1));
        row.reset(&setup).unwrap();
        row.slipped = DRAWS - 1;
        let model = setup.tactile().clone();
        for (finger, press) in row.ask().into_iter().enumerate() {
            let press = press.expect("the hand holds the object");
            let found = model.solve_partially(&[row.object()], &[press], Wanted::default());
            let mut found = found.into_iter().next().unwrap().unwrap();
            // Both pads drag the object along the fingers with more than friction.
            found.wrench.force.y = -100.0;
            row.answer(finger, Answer { found: Ok(found), restarted: None });
        }
        let error = row.settle(&setup).unwrap_err().to_string();
        assert!(error.contains("does not hold in any of 20 draws"), "{error}");
        assert!(row.is_new());
    }

    #[test]
    fn a_panic_is_a_named_error() {
        assert_eq!(guarded(|| panic!("as Rapier does")), Err::<(), _>(Error::Panicked));
    }

    #[test]
    fn a_step_without_a_motion_is_an_engine_error() {
        let (setup, mut row, mut observation) = row();
        let mut scratch = observation.clone();
        let outcome = row.conclude(&setup, &mut observation, &mut scratch);
        assert_eq!(outcome.ending, Some(Ending::EngineError));
    }
}
