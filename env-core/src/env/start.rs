//! Initial state of an episode: the hand above an object on the table, about to touch it, or
//! holding it.

use nalgebra::{Isometry3, Translation3, Vector3};

use super::{
    Setup,
    contact::{ContactState, PerFinger},
    trajectory::{FINE, Trajectory},
};
use crate::{
    Error, Result,
    deformation::{Deformation, Press},
    scene::{FingerState, Pads, Scene, SceneConfig, SceneObject},
    task::{Distractor, EpisodeParameters, Start},
};

/// Scene, grip force (N), and the trajectory of the object that led to the scene.
pub(super) struct InitialState {
    pub(super) scene: Scene,
    pub(super) grip: f64,
    pub(super) path: Trajectory,
}

impl InitialState {
    /// Creates the initial state for an `object` that rests on the table, unless the task places it
    /// in the hand. The hand is at `place` (m), unless the task places it around the object.
    pub(super) fn new(
        setup: &Setup,
        object: &SceneObject,
        place: &Vector3<f64>,
        parameters: &EpisodeParameters,
    ) -> Result<Self> {
        let mut config = scene_of(setup, parameters);
        let task = &setup.config.task;
        config.fixture = task.fixture(&object.model.shape().scaled(object.scale), parameters)?;
        let grip = task.gradual_grip().map_or(0.0, |grip| grip.start);
        match task.start() {
            Start::OverTable => {
                let distractors = parameters.distractors.iter().flatten();
                let distractors: Vec<_> = distractors
                    .map(|&Distractor { object, scale, mass, pose }| {
                        let (model, friction) = (&setup.models[object], parameters.friction);
                        SceneObject { model, scale, mass, friction, pose }
                    })
                    .collect();
                let scene = Scene::with_distractors(&config, object, &distractors, place, 0.0)?;
                Ok(Self::at_once(scene, grip))
            }
            Start::AroundObject => Ok(Self::at_once(around(&config, object)?, grip)),
            Start::InHand => {
                let (place, usual) = Self::in_hand(&config, object, place);
                let given = task.pose_in_hand(parameters);
                let pose = given.map_or(usual, |pose| Translation3::from(place) * pose);
                Self::holding(&config, &SceneObject { pose, ..object.clone() }, &place, grip, FINE)
            }
        }
    }

    /// The nearest place to `place` (m) within reach of the hand, and the object's pose between its
    /// pads there.
    pub(super) fn in_hand(
        config: &SceneConfig,
        object: &SceneObject,
        place: &Vector3<f64>,
    ) -> (Vector3<f64>, Isometry3<f64>) {
        let place = config.workspace.clamp(place);
        (place, object.model.in_hand(object.scale, &place))
    }

    /// Creates a hand at `place` (m) that has gripped the object where it is with `grip` (N) in the
    /// air. The poses of its trajectory are `coarseness` (m) apart.
    pub(super) fn holding(
        config: &SceneConfig,
        object: &SceneObject,
        place: &Vector3<f64>,
        grip: f64,
        coarseness: f64,
    ) -> Result<Self> {
        let mut path = None::<Trajectory>;
        let seen = |scene: &Scene| match &mut path {
            Some(path) => path.go_on(scene.bodies_in_pads()),
            None => path = Some(Trajectory::from(scene.bodies_in_pads(), coarseness)),
        };
        let scene = Scene::holding(config, object, place, grip, seen)?;
        let mut path = path.unwrap_or_else(|| Trajectory::from(scene.bodies_in_pads(), coarseness));
        path.arrive(scene.bodies_in_pads());
        Ok(Self { scene, grip, path })
    }

    fn at_once(scene: Scene, grip: f64) -> Self {
        let mut path = Trajectory::from(scene.bodies_in_pads(), FINE);
        path.arrive(scene.bodies_in_pads());
        Self { scene, grip, path }
    }
}

/// Corrects the pads of a hand that holds an object with `grip` (N) towards `answers`, the
/// solutions of its presses, and lets the object come to rest again. Returns the presses of this
/// motion; an [`Error::NotHeld`] if the object slips out of the hand.
///
/// Until then the grip was that of the elastic foundation alone, whose forces differ from those of
/// the model by a quarter.
pub(super) fn settle(
    setup: &Setup,
    scene: &mut Scene,
    contact: &mut ContactState,
    grip: f64,
    parameters: &EpisodeParameters,
    answers: PerFinger<Result<Deformation>>,
) -> Result<PerFinger<Press>> {
    let solutions = contact.keep(setup, answers, parameters)?;
    contact.correct(scene, &scene.state(), &solutions);
    let mut path = contact.trajectory();
    scene.rest_in_hand(grip, |scene| {
        if let Some(path) = &mut path {
            path.go_on(scene.bodies_in_pads());
        }
    });
    if let Some(path) = &mut path {
        path.arrive(scene.bodies_in_pads());
    }
    let state = scene.state();
    if state.failure.is_some() {
        return Ok([None, None]);
    }
    if !state.fingers.iter().all(FingerState::touches) {
        return Err(Error::NotHeld { grip });
    }
    let poses = path.as_ref().map_or(&[][..], Trajectory::poses);
    contact.press(setup, scene, poses, parameters)
}

/// Configuration of the scene of an episode with these parameters: that of the settings, with pads
/// of the stiffness of this episode's gel or soft object.
pub(super) fn scene_of(setup: &Setup, parameters: &EpisodeParameters) -> SceneConfig {
    let mut config = setup.config.scene.clone();
    if let Pads::Soft(pads) = &mut config.pads {
        pads.young = parameters.young.unwrap_or(pads.young * parameters.gel_stiffness);
    }
    config
}

/// Creates a hand about to touch an object where it rests, with its narrower side between the
/// fingers.
fn around(config: &SceneConfig, object: &SceneObject) -> Result<Scene> {
    let place = object.pose.translation.vector;
    let object = SceneObject { pose: object.model.in_hand(object.scale, &place), ..object.clone() };
    Scene::around(config, &object, &place)
}
