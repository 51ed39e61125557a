//! Models that solve presses: of the pads, built once for all environments with the same settings,
//! or of soft objects.

use std::{path::Path, slice, sync::Arc};

use nalgebra::Isometry3;
use rayon::prelude::*;

use super::{Choice, Shell, Skin, SoftObject, TactileConfig, config::NODES};
use crate::{
    Error, Result,
    compliance::nodal::ContactResolution,
    deformation::{Deformation, DeformationModel, Law, Press, SoftBody, Wanted},
    fem::{Fem, FemOptions},
    geometry::Shape,
    interrupt::Interrupt,
    sensor::Sensor,
    surrogate::{LinearPad, Surrogate},
};

/// Body that deforms where fingers touch an object, with its model.
#[derive(Clone, Debug)]
pub enum TactileModel {
    /// Nothing: fingers and objects are rigid.
    Rigid,
    /// The pads of the fingers.
    Pads(TactilePad),
    /// The object; one model for each of the configured objects.
    Objects(Vec<Arc<SoftObject>>),
}

/// Model of a pad. Copies share the precomputed data.
#[non_exhaustive]
#[derive(Clone)]
pub enum Model {
    /// Linear elasticity.
    Linear(LinearPad),
    /// Finite elements.
    Fem(Fem),
    /// Network that corrects the linear solution.
    Surrogate(Surrogate),
}

/// Surface of the pads and model of their gel.
#[derive(Clone)]
pub struct TactilePad {
    skin: Arc<Skin>,
    model: Model,
}

impl std::fmt::Debug for TactilePad {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TactilePad").field("model", &self.model.name()).finish_non_exhaustive()
    }
}

impl TactileModel {
    /// Name of the model in a plan; `None` if nothing deforms.
    pub fn name(&self) -> Option<&'static str> {
        match self {
            Self::Rigid => None,
            Self::Pads(pad) => Some(pad.model.name()),
            Self::Objects(_) => Some("soft"),
        }
    }

    /// The pads, if they are what deforms.
    pub fn pads(&self) -> Option<&TactilePad> {
        match self {
            Self::Pads(pad) => Some(pad),
            Self::Rigid | Self::Objects(_) => None,
        }
    }

    /// Object `index`, if the objects are what deforms.
    pub fn object(&self, index: usize) -> Option<&SoftObject> {
        match self {
            Self::Objects(objects) => objects.get(index).map(|object| &**object),
            Self::Rigid | Self::Pads(_) => None,
        }
    }

    /// Surface of what deforms at contact with object `index`, for rendering.
    pub fn shell(&self, index: usize) -> Option<&Shell> {
        match self {
            Self::Pads(pad) => Some(pad.skin.shell()),
            Self::Rigid | Self::Objects(_) => self.object(index).map(SoftObject::shell),
        }
    }

    /// Solves `presses` in order, each at contact with the object of that index in `objects`;
    /// optional parts of the solutions that are not `wanted` may be left out.
    pub fn solve_partially(
        &self,
        objects: &[usize],
        presses: &[Press],
        wanted: Wanted,
    ) -> Vec<Result<Deformation>> {
        let rigid = || Err(Error::invalid("press", "rigid bodies", "soft pads or a soft object"));
        match self {
            Self::Rigid => presses.iter().map(|_| rigid()).collect(),
            Self::Pads(pad) => pad.model.solve_partially(presses, wanted),
            Self::Objects(all) => {
                let interrupt = Interrupt::current();
                let one = |(&index, press): (&usize, &Press)| {
                    let Some(object) = all.get(index) else { return rigid() };
                    let solve = || object.model().solve_partially(slice::from_ref(press), wanted);
                    interrupt.during(solve).remove(0)
                };
                objects.par_iter().zip(presses).map(one).collect()
            }
        }
    }
}

impl TactilePad {
    /// Builds the instance that `config` describes; `None` for rigid fingers.
    pub fn new(config: &TactileConfig) -> Result<Option<Self>> {
        config.validate()?;
        if config.choice == Choice::None {
            return Ok(None);
        }
        let sensor = config.sensor()?;
        let Some((model, body)) = Model::new(config, &sensor)? else { return Ok(None) };
        let skin = Arc::new(Skin::new(&body, &sensor, &config.resolution)?);
        Ok(Some(Self { skin, model }))
    }

    /// Surface of the pads.
    pub fn skin(&self) -> &Arc<Skin> {
        &self.skin
    }

    /// Model of the gel.
    pub fn model(&self) -> &Model {
        &self.model
    }
}

impl Model {
    /// The model that was chosen.
    fn chosen(&self) -> &dyn DeformationModel {
        match self {
            Self::Linear(model) => model,
            Self::Fem(model) => model,
            Self::Surrogate(model) => model,
        }
    }

    /// Soft body of a model whose contact is linear; none of finite elements, which refuse inverted
    /// elements themselves.
    pub fn linear_body(&self) -> Option<&SoftBody> {
        match self {
            Self::Linear(pad) => Some(pad.body()),
            Self::Surrogate(network) => Some(network.body()),
            Self::Fem(_) => None,
        }
    }

    /// Poses of rigid bodies of these `shapes` (S), each moved out of the base of the pad, to which
    /// the gel is bonded and into which no press leads. Rapier lets a body overlap a finger by what
    /// either moves in a time step, up to a millimetre, and by more where the hand holds it down on
    /// the table.
    pub fn beside_base(&self, shapes: &[Shape], poses: &[Isometry3<f64>]) -> Vec<Isometry3<f64>> {
        let backing = match self {
            Self::Linear(pad) => pad.backing(),
            Self::Surrogate(network) => network.backing(),
            Self::Fem(fem) => fem.backing(),
        };
        shapes.iter().zip(poses).map(|(shape, pose)| backing.outside(shape, pose)).collect()
    }

    /// Builds the chosen model of the gel of `sensor`, with its soft body; `None` for rigid fingers.
    fn new(config: &TactileConfig, sensor: &Sensor) -> Result<Option<(Self, SoftBody)>> {
        let (_, body) = config.pad(sensor)?;
        let on = body.clone();
        let model = match config.choice {
            Choice::None => return Ok(None),
            Choice::Compliance => {
                let (_, moduli) = config.material(sensor)?;
                let (friction, nodes) = (usual_friction(config, sensor), config.resolution.nodes);
                let fast = ContactResolution::FAST;
                let model = LinearPad::new(sensor, moduli, friction, nodes, fast)?;
                Self::Linear(model.with_spread_stress())
            }
            Choice::Fem => Self::Fem(Fem::new(on, FemOptions::default())?),
            Choice::Surrogate => Self::Surrogate(trained(config, sensor)?),
        };
        Ok(Some((model, body)))
    }

    /// Returns whether solutions come with predicted errors.
    pub fn predicts_errors(&self) -> bool {
        match self {
            Self::Surrogate(network) => network.card().predicted.is_some(),
            Self::Linear(_) | Self::Fem(_) => false,
        }
    }

    /// Name in the settings.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Linear(_) => "compliance",
            Self::Fem(_) => "fem",
            Self::Surrogate(_) => "surrogate",
        }
    }
}

impl DeformationModel for Model {
    fn solve(&self, presses: &[Press]) -> Vec<Result<Deformation>> {
        self.chosen().solve(presses)
    }

    fn solve_partially(&self, presses: &[Press], wanted: Wanted) -> Vec<Result<Deformation>> {
        self.chosen().solve_partially(presses, wanted)
    }

    fn solve_path(&self, press: &Press) -> Vec<Result<Deformation>> {
        self.chosen().solve_path(press)
    }
}

/// Friction of presses that have none of their own, which those of an environment do.
fn usual_friction(config: &TactileConfig, sensor: &Sensor) -> f64 {
    sensor.friction.coefficient.min(config.choice.most_friction())
}

/// Loads the network for the gel of `sensor`.
fn trained(config: &TactileConfig, sensor: &Sensor) -> Result<Surrogate> {
    let (law, moduli) = config.material(sensor)?;
    if law != Law::NeoHookean {
        let expected = "a neo-hookean gel for the surrogate";
        return Err(Error::invalid("material", law, expected));
    }
    let friction = usual_friction(config, sensor);
    let model = match &config.network {
        Some(path) => Surrogate::load(Path::new(path), sensor, moduli, friction)?,
        None => Surrogate::new(sensor, moduli, friction)?,
    };
    let nodes = model.card().model_nodes;
    if nodes != config.resolution.nodes {
        let expected = format!(
            "{nodes}, the nodes of the network; tactile \"fem\" and \"compliance\" take {} to {}",
            NODES.start(),
            NODES.end()
        );
        return Err(Error::invalid("resolution.nodes", config.resolution.nodes, expected));
    }
    Ok(model)
}
