//! One episode: its start, its steps and its end.

use std::mem;

use nalgebra::{Isometry3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::{
    Setup,
    contact::{ContactState, PerFinger, StepSolutions, stiffened},
    distractors::beside,
    given::GivenStart,
    guarded,
    plan::{CHANNEL, CORRECTION, PEAK, PRESS, REWARD, SCENE, StageTimes},
    start::{InitialState, settle},
    trajectory::{PosesInPads, Trajectory},
    trial::{TrialHold, limit},
};
use crate::{
    Error, Result,
    deformation::{Deformation, Press},
    scene::{MOST_DISTRACTORS, Scene, SceneObject, SceneState},
    task::{
        ACTION_SIZE, Ending, EpisodeParameters, FaultySensors, Progress, Range, RewardTerms, Start,
        StartQuantity, StepState, TrialGrip, command,
    },
};

/// Most draws of the parameters of an episode until the hand holds the object.
pub(super) const DRAWS: usize = 20;

/// Running episode.
#[derive(Serialize, Deserialize)]
pub(super) struct Episode {
    scene: Scene,
    parameters: EpisodeParameters,
    contact: ContactState,
    grip: f64,
    steps: u32,
    progress: Progress,
    /// Sensors with errors, if the settings have any.
    sensors: Option<FaultySensors>,
    pub(super) over: bool,
}

/// State of the rigid bodies after a reset or step, with the presses that follow from it.
pub(super) struct PendingStep {
    state: SceneState,
    pub(super) presses: PerFinger<Press>,
    pub(super) answers: PerFinger<Result<Deformation>>,
    /// Kind of the error of a press of which only the last pose was solved, from rest.
    pub(super) restarted: Option<&'static str>,
    /// Object that is still to come to rest.
    unsettled: Option<Unsettled>,
}

/// Object gripped by pads that no solution has corrected yet.
enum Unsettled {
    /// The object of the episode.
    Start,
    /// The object in the trial grip of a fragile grasp, which is not a part of the episode.
    Trial(Box<TrialHold>),
}

/// Result of a step, besides its observation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Weighted mean of the terms, in [0, 1].
    pub reward: f64,
    /// Each term, in [0, 1].
    pub terms: RewardTerms,
    /// `true` if a rule or an error ended the episode.
    pub terminated: bool,
    /// `true` if the episode reached its time limit, whatever else happened in its last step, as
    /// gymnasium's `TimeLimit` has it.
    pub truncated: bool,
    /// `true` if the task is done.
    pub is_success: bool,
    /// Reason for which the episode terminated.
    pub ending: Option<Ending>,
    /// Kind of the error ([`Error::kind`]) of a press that could not be solved. The episode
    /// continues if its last pose could be solved from rest.
    pub press_error: Option<&'static str>,
}

impl Outcome {
    /// Outcome of an episode that ended without a reward.
    pub(super) fn ended(ending: Ending) -> Self {
        Self { terminated: true, ending: Some(ending), ..Self::default() }
    }

    fn press_failed(error: &Error) -> Self {
        Self { press_error: Some(error.kind()), ..Self::ended(Ending::PressFailed) }
    }
}

impl PendingStep {
    /// Returns whether [`Episode::settle`] has still to be called.
    pub(super) fn is_unsettled(&self) -> bool {
        self.unsettled.is_some()
    }
}

impl Episode {
    /// Creates an episode with parameters that are `given` or else drawn from `random`, and its
    /// first motion. Parameters with which the hand does not hold the object, where it has to, are
    /// drawn again; if it never does, that is an error.
    pub(super) fn start(
        setup: &Setup,
        random: &mut ChaCha8Rng,
        given: &GivenStart,
    ) -> Result<(Self, PendingStep)> {
        let mut failed = None;
        for _ in 0..DRAWS {
            let (parameters, pose, place) = drawn(setup, random, given);
            match Self::with(setup, random, &parameters, pose, &place) {
                Err(Error::NotHeld { grip }) => failed = Some((parameters.object, grip)),
                other => return other,
            }
        }
        let (object, grip) = failed.unwrap_or_default();
        Err(never_held(setup, object, grip))
    }

    /// Creates an episode with these parameters, the object at `pose` and the hand at `place` (m),
    /// and its first motion.
    fn with(
        setup: &Setup,
        random: &ChaCha8Rng,
        parameters: &EpisodeParameters,
        pose: Isometry3<f64>,
        place: &Vector3<f64>,
    ) -> Result<(Self, PendingStep)> {
        let config = &setup.config;
        let EpisodeParameters { object, scale, mass, friction, .. } = *parameters;
        // The sensors have streams of their own, so they change no other draw.
        let streams = [2, 3].map(|number| stream(random, number));
        let (errors, period) = (&config.sensor_errors, config.scene.physics.control_period);
        let sensors = FaultySensors::draw(errors, &setup.layout, streams, period);
        let object = SceneObject { model: &setup.models[object], scale, mass, friction, pose };
        let InitialState { scene, grip, path } =
            InitialState::new(setup, &object, place, parameters)?;
        let tried = |t: TrialGrip| TrialHold::new(setup, &object, parameters, t.grip);
        let trial = parameters.trial.map(tried).transpose()?;
        let state = scene.state();
        let contact = ContactState::new(setup.tactile(), path.start());
        let (progress, steps, over) = (Progress::new(&state), 0, false);
        let parameters = *parameters;
        let mut episode = Self { scene, parameters, contact, grip, steps, progress, sensors, over };
        let mut motion = episode.motion(setup, state, path.poses());
        if let Some((trial, presses)) = trial {
            motion.presses = presses;
            motion.unsettled = Some(Unsettled::Trial(Box::new(trial)));
        } else if setup.config.task.start() == Start::InHand {
            motion.unsettled = Some(Unsettled::Start);
        }
        Ok((episode, motion))
    }

    /// Corrects the pads of a hand that holds an object at the beginning of an episode with the
    /// solutions in `motion`, lets the object come to rest again, and puts the presses of this in
    /// their place. Everything else is left as it is. Returns an [`Error::NotHeld`] if the object
    /// slips out of the hand.
    pub(super) fn settle(&mut self, setup: &Setup, motion: &mut PendingStep) -> Result<()> {
        let Some(unsettled) = motion.unsettled.take() else { return Ok(()) };
        if motion.answers.iter().all(Option::is_none) {
            return Ok(());
        }
        let answers = mem::take(&mut motion.answers);
        let parameters = &self.parameters;
        let presses = match unsettled {
            Unsettled::Start => {
                let (scene, contact) = (&mut self.scene, &mut self.contact);
                let presses = settle(setup, scene, contact, self.grip, parameters, answers);
                motion.state = scene.state();
                self.progress = Progress::new(&motion.state);
                presses
            }
            Unsettled::Trial(trial) => trial.settle(setup, parameters, answers),
        };
        match presses {
            Ok(presses) => motion.presses = presses,
            Err(error @ Error::NotHeld { .. }) => return Err(error),
            Err(error) => motion.answers[0] = Some(Err(error)),
        }
        Ok(())
    }

    /// Ends a reset and writes the observation of the initial state in `motion`. If a press cannot
    /// be solved, the fingers report no contact until the first step. A fragile grasp starts
    /// without contact: the presses are those of its trial grip, whose solutions set the stress
    /// limit, and without a limit the first step ends the episode.
    pub(super) fn open(&mut self, setup: &Setup, motion: PendingStep, observation: &mut [f32]) {
        let PendingStep { state, answers, .. } = motion;
        let solutions = if let Some(trial) = &self.parameters.trial {
            let stiffness = self.parameters.gel_stiffness;
            self.parameters.stress_limit = limit(trial, stiffened(answers, stiffness)).ok();
            StepSolutions::default()
        } else {
            self.apply_solutions(setup, &state, answers).unwrap_or_default()
        };
        setup.layout.write(&self.step_state(&state, setup, &solutions), observation);
        if let Some(sensors) = &mut self.sensors {
            sensors.report(&setup.layout, observation);
        }
    }

    /// Attaches the objects to a deserialised episode. Returns an error if the settings have no
    /// such object.
    pub(super) fn attach(&mut self, setup: &Setup) -> Result<()> {
        let count = setup.models.len();
        let model = |(index, _)| {
            let reason = || format!("object {index} of {count} in these settings");
            setup.models.get(index).ok_or_else(|| Error::BadState { reason: reason() })
        };
        let models = self.parameters.bodies().map(model).collect::<Result<Vec<_>>>()?;
        self.scene.attach(&models);
        Ok(())
    }

    /// State of the rigid bodies and the parameters of the episode.
    pub(super) fn state(&self) -> (SceneState, EpisodeParameters) {
        (self.scene.state(), self.parameters)
    }

    /// See [`Scene::indentations`].
    pub(super) fn indentations(&self) -> [f64; 2] {
        self.scene.indentations()
    }

    /// Index of the object.
    pub(super) fn object(&self) -> usize {
        self.parameters.object
    }

    fn time(&self, setup: &Setup) -> f64 {
        f64::from(self.steps) * setup.config.scene.physics.control_period
    }

    fn step_state<'a>(
        &'a self,
        state: &'a SceneState,
        setup: &'a Setup,
        solutions: &'a StepSolutions,
    ) -> StepState<'a> {
        let (pads, squeezed) = (self.contact.pads(setup, solutions), solutions.squeezed.as_ref());
        let (time, episode, grip) = (self.time(setup), &self.parameters, self.grip);
        let peak_stress = squeezed.map_or(0.0, |squeezed| squeezed.peak);
        StepState { state, episode, grip, time, pads, squeezed, peak_stress }
    }

    /// Stores the solutions of the presses and corrects the contact forces of the scene with them.
    /// Returns the solutions, or the first error.
    fn apply_solutions(
        &mut self,
        setup: &Setup,
        state: &SceneState,
        answers: PerFinger<Result<Deformation>>,
    ) -> Result<StepSolutions> {
        let solutions = self.contact.keep(setup, answers, &self.parameters)?;
        self.contact.correct(&mut self.scene, state, &solutions);
        Ok(solutions)
    }

    /// Creates the presses of the fingers in `state`, after the object has moved along `path`.
    fn motion(&mut self, setup: &Setup, state: SceneState, path: &[PosesInPads]) -> PendingStep {
        let mut motion = PendingStep {
            state,
            presses: [None, None],
            answers: [None, None],
            restarted: None,
            unsettled: None,
        };
        if motion.state.failure.is_some() {
            return motion;
        }
        match self.contact.press(setup, &self.scene, path, &self.parameters) {
            Ok(presses) => motion.presses = presses,
            Err(error) => motion.answers[0] = Some(Err(error)),
        }
        motion
    }

    /// Returns presses that reproduce the current contact. The state of the fingers does not
    /// change.
    pub(super) fn touch_again(&self, setup: &Setup) -> Result<PerFinger<Press>> {
        if self.scene.state().failure.is_some() {
            return Ok([None, None]);
        }
        let path = [self.scene.bodies_in_pads()];
        self.contact.clone().press(setup, &self.scene, &path, &self.parameters)
    }

    /// Moves the rigid bodies through one control period.
    pub(super) fn advance(
        &mut self,
        setup: &Setup,
        action: &[f32; ACTION_SIZE],
        costs: &mut StageTimes,
    ) -> PendingStep {
        let command = command(action, &setup.config, self.scene.yaw(), self.grip);
        let (start, shaking) = (self.time(setup), self.parameters.shaking);
        self.grip = command.grip;
        self.steps += 1;
        let mut path = self.contact.trajectory();
        let state = costs.time(SCENE, || {
            let force = |time| shaking.map_or_else(Vector3::zeros, |s| s.force(start + time));
            self.scene.step_under(&command, force, |scene| {
                if let Some(path) = &mut path {
                    path.go_on(scene.bodies_in_pads());
                }
            });
            self.scene.state()
        });
        if let Some(path) = &mut path {
            path.arrive(self.scene.bodies_in_pads());
        }
        let poses = path.as_ref().map_or(&[][..], Trajectory::poses);
        costs.time(PRESS, || self.motion(setup, state, poses))
    }

    /// Returns whether the episode has had all its steps.
    pub(super) fn is_out_of_time(&self, setup: &Setup) -> bool {
        self.steps >= setup.config.max_episode_steps
    }

    /// Ends the step that led to `motion`. `observation` holds the previous observation on entry
    /// and keeps it if the new one has an entry outside its declared range.
    pub(super) fn conclude(
        &mut self,
        setup: &Setup,
        motion: PendingStep,
        observation: &mut [f32],
        scratch: &mut [f32],
        costs: &mut StageTimes,
    ) -> Outcome {
        let config = &setup.config;
        let PendingStep { state, answers, restarted, .. } = motion;
        let solutions =
            match costs.time(CORRECTION, || self.apply_solutions(setup, &state, answers)) {
                Ok(solutions) => solutions,
                Err(error) => return Outcome::press_failed(&error),
            };
        let mut progress = self.progress;
        let mut step = self.step_state(&state, setup, &solutions);
        if self.parameters.trial.is_some() && self.parameters.stress_limit.is_none() {
            return Outcome::press_failed(&Error::NoTrial);
        }
        if let (Some(_), Some(pads)) = (self.parameters.stress_limit, &step.pads) {
            step.peak_stress = costs.time(PEAK, || pads.peak_stress());
        }
        observe(setup, &step, scratch, costs);
        let mut ending = Ending::of(&step, &progress, config);
        let holds = setup.layout.holds(scratch);
        if !holds {
            ending = ending.or(Some(Ending::OutOfRange));
        }
        let is_seen = holds && ending != Some(Ending::NonFinite);
        let terms = if ending.is_none_or(Ending::is_of_the_task) {
            costs.time(REWARD, || {
                progress.advance(&step, config);
                RewardTerms::of(&step, &progress, config)
            })
        } else {
            RewardTerms::default()
        };
        let outcome = Outcome {
            reward: terms.reward(&config.reward),
            terms,
            terminated: ending.is_some(),
            truncated: false,
            // What ended the episode early has failed, whatever it had reached.
            is_success: ending.is_none() && config.task.is_success(&step, &progress, config),
            ending,
            press_error: restarted,
        };
        self.progress = progress;
        if is_seen {
            observation.copy_from_slice(scratch);
            if let Some(sensors) = &mut self.sensors {
                sensors.report(&setup.layout, observation);
            }
        }
        outcome
    }
}

/// Error about an object that the hand, with `grip` (N), has not held in [`DRAWS`] draws.
pub(super) fn never_held(setup: &Setup, object: usize, grip: f64) -> Error {
    let spec = &setup.config.objects[object];
    let found = format!("{spec}, which the hand does not hold in any of {DRAWS} draws");
    Error::invalid("objects", found, format!("one that it can grip with {grip:.3} N"))
}

/// Returns an error if no episode can start with an object of one's own. Those of the catalogue are
/// known to be held.
pub(super) fn check_starts(setup: &Setup) -> Result<()> {
    for (object, spec) in setup.config.objects.iter().enumerate() {
        if !spec.is_in_catalogue() {
            let mut given = GivenStart::default();
            given.set(StartQuantity::Object, object as f64, setup)?;
            let mut random = ChaCha8Rng::seed_from_u64(0);
            guarded(|| Episode::start(setup, &mut random, &given)).flatten()?;
        }
    }
    Ok(())
}

/// Draws the parameters of an episode from `random` unless they are `given`, with the pose of the
/// object on the table and the place of the hand (m).
fn drawn(
    setup: &Setup,
    random: &mut ChaCha8Rng,
    given: &GivenStart,
) -> (EpisodeParameters, Isometry3<f64>, Vector3<f64>) {
    let config = &setup.config;
    let object = random.random_range(0..setup.models.len());
    let object = given.or(StartQuantity::Object, object as f64) as usize;
    let mut uniform = |[low, high]: Range| low + (high - low) * random.random::<f64>();
    let mass = given.or(StartQuantity::Mass, uniform(config.mass));
    let friction = config.task.friction(config.friction, uniform([0.0, 1.0]));
    let friction = given.or(StartQuantity::Friction, friction);
    let scale = given.or(StartQuantity::Size, uniform(config.size));
    let yaw = given.or(StartQuantity::Yaw, uniform(config.yaw));
    let x = given.or(StartQuantity::X, uniform(config.position));
    let y = given.or(StartQuantity::Y, uniform(config.position));
    let place = Vector3::new(
        given.or(StartQuantity::StartX, uniform(config.start)),
        given.or(StartQuantity::StartY, uniform(config.start)),
        given.or(StartQuantity::StartHeight, uniform(config.start_height)),
    );
    let model = &setup.models[object];
    let pose = model.rest(scale, x, y, yaw);
    let (low, high) = model.surface().bounds();
    let mut parameters = EpisodeParameters {
        object,
        scale,
        mass,
        friction,
        half_extents: (0.5 * scale * (high - low)).into(),
        rest_height: pose.translation.z,
        stress_limit: None,
        trial: None,
        young: None,
        gel_stiffness: 1.0,
        shaking: None,
        insertion: None,
        distractors: [None; MOST_DISTRACTORS],
    };
    config.task.draw(config, &mut parameters, &mut uniform);
    // The gel has a stream of its own, so it changes no other draw.
    let [low, high] = config.gel_stiffness;
    let stiffness = low + (high - low) * stream(random, 1).random::<f64>();
    parameters.gel_stiffness = given.or(StartQuantity::GelStiffness, stiffness);
    // So have the distractors.
    parameters.distractors = beside(setup, stream(random, 4), &parameters, &pose);
    (parameters, pose, place)
}

/// Random stream of that `number`, from 1 to 7, beside `random`. No other episode has it: streams of
/// the same number, each begun a few draws after the last, would be nearly the same numbers.
fn stream(random: &ChaCha8Rng, number: u64) -> ChaCha8Rng {
    let mut own = random.clone();
    own.set_stream((random.get_word_pos() as u64) << 3 | number);
    own
}

/// Writes the observation of `step` into `row` and records the time of each channel.
fn observe(setup: &Setup, step: &StepState, row: &mut [f32], costs: &mut StageTimes) {
    let mut rest = row;
    for channel in 0..setup.layout.channels().len() {
        let here = rest;
        rest = costs.time(CHANNEL + channel, || setup.layout.write_channel(channel, step, here));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        tactile::Choice,
        task::{ObjectSpec, Task, TaskConfig},
    };

    /// A cube of 3 cm.
    const CUBE: &str = "v -0.015 -0.015 -0.015\nv 0.015 -0.015 -0.015\nv 0.015 0.015 -0.015\n\
        v -0.015 0.015 -0.015\nv -0.015 -0.015 0.015\nv 0.015 -0.015 0.015\nv 0.015 0.015 0.015\n\
        v -0.015 0.015 0.015\nf 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

    #[test]
    fn a_start_with_an_own_mesh_is_tried_however_it_is_given() {
        let path = std::env::temp_dir().join(format!("ruffini-cube-{}.obj", std::process::id()));
        std::fs::write(&path, CUBE).unwrap();
        // So heavy and smooth that the hand holds nothing.
        let setup = |object: serde_json::Value| {
            let objects: Vec<ObjectSpec> = vec![serde_json::from_value(object).unwrap()];
            let (tactile, task) = (Choice::None, Task::named("HoldStill").unwrap());
            let (mass, friction) = ([0.5; 2], [0.01; 2]);
            Setup::new(TaskConfig { objects, mass, friction, tactile, ..TaskConfig::of(&task) })
        };
        assert!(setup("cuboid".into()).is_ok());
        let path = path.display().to_string();
        for object in [serde_json::json!(path), serde_json::json!({"mesh": path})] {
            let error = setup(object).err().unwrap().to_string();
            assert!(error.contains("which the hand does not hold"), "{error}");
        }
        std::fs::remove_file(path).unwrap();
    }
}
