//! Contact of the fingers with object and distractors through an episode: presses that follow from
//! the motion of the rigid bodies, and contact forces that follow from their solutions.

use std::cell::OnceCell;

use serde::{Deserialize, Serialize};

use super::{
    Setup,
    trajectory::{COARSE, PosesInPads, Trajectory},
};
use crate::{
    Result,
    deformation::{Deformation, History, Press},
    geometry::Shape,
    scene::{Scene, SceneState},
    tactile::{Finger, PadDeformations, RaisedFace, Squeezed, TactileModel},
    task::EpisodeParameters,
};

/// Value for each finger of a row, such as a press or its solution; `None` where the finger does
/// not touch. The press of a soft object, which is of both fingers, takes the first place.
pub(super) type PerFinger<T> = [Option<T>; 2];

/// State of the contact between steps; one variant for each of [`TactileModel`].
#[derive(Clone, Serialize, Deserialize)]
pub(super) enum ContactState {
    /// Nothing deforms.
    Rigid,
    /// Contact of each pad.
    Pads(Box<PadContact>),
    /// Contact of a soft object with both fingers, while there is one.
    Object(Option<History>),
}

/// State of the contact of the pads with the object and the distractors.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct PadContact {
    fingers: [Finger; 2],
    /// Object and distractors in their drawn sizes, set when they are first needed.
    #[serde(skip)]
    bodies: Vec<Shape>,
}

/// Solutions of one step.
#[derive(Default)]
pub(super) struct StepSolutions {
    /// Deformation of each pad that touches.
    pub(super) pads: PerFinger<Deformation>,
    /// Faces of the pads near contact, for the channels.
    raised: [OnceCell<RaisedFace>; 2],
    /// Deformation of a soft object that is squeezed.
    pub(super) squeezed: Option<Squeezed>,
}

impl ContactState {
    /// Creates the state before any contact, with the bodies at `poses`.
    pub(super) fn new(model: &TactileModel, poses: PosesInPads) -> Self {
        match model {
            TactileModel::Rigid => Self::Rigid,
            TactileModel::Pads(_) => {
                let fingers = poses.map(Finger::new);
                Self::Pads(Box::new(PadContact { fingers, bodies: Vec::new() }))
            }
            TactileModel::Objects(_) => Self::Object(None),
        }
    }

    /// Trajectory that goes on from the last press; `None` if presses do not depend on it.
    pub(super) fn trajectory(&self) -> Option<Trajectory> {
        match self {
            Self::Pads(contact) => {
                let last = contact.fingers.each_ref().map(|finger| finger.last().to_vec());
                Some(Trajectory::from(last, COARSE))
            }
            Self::Rigid | Self::Object(_) => None,
        }
    }

    /// Creates the presses in `scene`, after object and distractors have moved along `path`, poses
    /// in the frame of each pad. The solutions go to [`ContactState::keep`].
    pub(super) fn press(
        &mut self,
        setup: &Setup,
        scene: &Scene,
        path: &[PosesInPads],
        parameters: &EpisodeParameters,
    ) -> Result<PerFinger<Press>> {
        let (friction, mut presses) = (parameters.friction, [None, None]);
        match (self, setup.tactile()) {
            (Self::Pads(contact), TactileModel::Pads(pad)) => {
                let PadContact { fingers, bodies } = &mut **contact;
                if bodies.is_empty() {
                    let sized = |(object, scale)| setup.felt_shape(object).scaled(scale);
                    bodies.extend(parameters.bodies().map(sized));
                }
                for (i, (press, finger)) in presses.iter_mut().zip(fingers).enumerate() {
                    let clear = |poses: &PosesInPads| pad.model().beside_base(bodies, &poses[i]);
                    let path: Vec<_> = path.iter().map(clear).collect();
                    *press = finger.press(pad.skin(), bodies, &path, friction)?;
                }
            }
            (Self::Object(history), model) => {
                let history = history.take();
                let touches = scene.indentations().iter().all(|depth| *depth > 0.0);
                if let Some(object) = model.object(parameters.object).filter(|_| touches) {
                    let faces = scene.bodies_in_pads().map(|bodies| bodies[0].inverse());
                    presses[0] = Some(object.press(&faces, friction, history)?);
                }
            }
            _ => {}
        }
        Ok(presses)
    }

    /// Stores the solutions of the last presses. Returns them for this episode's stiffness, without
    /// those that do not touch, or the first error.
    pub(super) fn keep(
        &mut self,
        setup: &Setup,
        answers: PerFinger<Result<Deformation>>,
        parameters: &EpisodeParameters,
    ) -> Result<StepSolutions> {
        let mut solutions = StepSolutions::default();
        match self {
            Self::Rigid => {}
            Self::Pads(contact) => {
                let answers = stiffened(answers, parameters.gel_stiffness);
                let fingers = solutions.pads.iter_mut().zip(&mut contact.fingers);
                for ((solution, finger), answer) in fingers.zip(answers) {
                    *solution = answer.transpose()?.filter(|answer| finger.keep(answer));
                }
            }
            Self::Object(history) => {
                let [answer, _] = answers;
                let object = setup.tactile().object(parameters.object);
                if let Some((object, answer)) = object.zip(answer.transpose()?) {
                    let young = parameters.young.unwrap_or_default();
                    solutions.squeezed = object.squeezed(&answer, young)?;
                    *history = Some(answer.history);
                }
            }
        }
        Ok(solutions)
    }

    /// Corrects the elastic foundation of `scene`, whose state is `state`, towards the forces of
    /// the solutions. The model of a soft object is in equilibrium and without weight, so it gives
    /// the normal forces of the fingers but not the friction that carries the weight.
    pub(super) fn correct(&self, scene: &mut Scene, state: &SceneState, solutions: &StepSolutions) {
        for finger in 0..2 {
            match self {
                Self::Rigid => {}
                Self::Pads(_) => {
                    let solution = solutions.pads[finger].as_ref();
                    if solution.is_some() || state.fingers[finger].touches() {
                        scene.correct(
                            finger,
                            &solution.map(|solution| solution.wrench).unwrap_or_default(),
                        );
                    }
                }
                Self::Object(_) => {
                    let force = solutions.squeezed.as_ref().map(|squeezed| squeezed.forces[finger]);
                    scene.correct_pressing(finger, force.unwrap_or_default());
                }
            }
        }
    }

    /// Input of the tactile channels; `None` unless the pads deform.
    pub(super) fn pads<'a>(
        &'a self,
        setup: &'a Setup,
        solutions: &'a StepSolutions,
    ) -> Option<PadDeformations<'a>> {
        let (Self::Pads(contact), Some(pad)) = (self, setup.tactile().pads()) else {
            return None;
        };
        let fingers = solutions.pads.each_ref().map(Option::as_ref);
        let pressed = contact.fingers.each_ref().map(Finger::pressed);
        let (bodies, raised) = (&contact.bodies, &solutions.raised);
        Some(PadDeformations { skin: pad.skin(), fingers, bodies, pressed, raised })
    }
}

/// Solutions for gels whose Young's modulus is `stiffness` times that of the model: displacements
/// are the same, stresses and forces are in proportion to it.
pub(super) fn stiffened(
    answers: PerFinger<Result<Deformation>>,
    stiffness: f64,
) -> PerFinger<Result<Deformation>> {
    answers.map(|answer| Some(answer?.map(|solution| solution.stiffened(stiffness))))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Vector3};

    use super::*;
    use crate::{
        deformation::Wanted,
        env::Row,
        scene::{Gripper, SceneObject},
        tactile::{Choice, Resolution},
        task::{ObjectSpec, TaskConfig},
    };

    /// Rapier lets a hand that comes down on an object overlap it.
    #[test]
    fn a_finger_that_stands_in_an_object_by_a_part_of_a_millimetre_has_an_answer() {
        let resolution = Resolution { nodes: 100, ..Resolution::default() };
        let objects = vec![ObjectSpec::Name("cuboid".into())];
        let config = TaskConfig {
            tactile: Choice::Compliance,
            objects,
            resolution,
            ..TaskConfig::default()
        };
        let (setup, mut row) = (Setup::new(config).unwrap(), Row::new(1));
        row.reset(&setup).unwrap();
        let (_, parameters) = row.state().unwrap();
        let pose = Isometry3::translation(0.0, 0.0, parameters.rest_height);
        let EpisodeParameters { scale, mass, friction, .. } = parameters;
        let object = SceneObject { model: &setup.models[0], scale, mass, friction, pose };
        let place = Vector3::new(0.0, 0.0, 0.1);
        let scene = Scene::new(&setup.config.scene, &object, &place, 0.0).unwrap();
        let end = 0.5 * Gripper::default().pad_length;
        let under = |overlap: f64| {
            let y = -end - parameters.half_extents[1] + overlap;
            vec![Isometry3::translation(0.0, y, -2e-3)]
        };
        let path = [under(-5e-3), under(3e-4)].map(|poses| [poses.clone(), poses]);
        let mut contact = ContactState::new(setup.tactile(), path[0].clone());
        let presses = contact.press(&setup, &scene, &path[1..], &parameters).unwrap();
        let press = presses[0].clone().expect("the object is in reach");
        let solution = setup.tactile().solve_partially(&[0], &[press], Wanted::default()).remove(0);
        let force = solution.map(|solution| solution.wrench.force.norm());
        // It stands beside the face of the pad, which feels nothing.
        assert_eq!(force, Ok(0.0));
    }
}
