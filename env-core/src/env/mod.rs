//! Environments: a row runs one episode after another; a batch steps many rows together.
//!
//! Rows share only their settings, so the results of a row depend on its seed and actions alone:
//! not on the other rows, their number, or the number of threads. A step has three phases: each row
//! moves its rigid bodies, one call solves the presses of all fingers, and each row writes its
//! observation.

mod answers;
mod batch;
mod contact;
mod distractors;
mod episode;
mod given;
mod plan;
mod row;
mod snapshot;
mod start;
mod trajectory;
mod trial;

pub use batch::{Autoreset, Batch, BodySurface, StepResult};
pub use episode::Outcome;
pub use plan::Stage;
pub use row::Row;

use std::panic::{AssertUnwindSafe, catch_unwind};

use nalgebra::Vector3;

use crate::{
    Error, Result,
    deformation::Wanted,
    geometry::Shape,
    scene::ObjectModel,
    tactile::{Channel, Model, SoftObject, TactileModel, TactilePad},
    task::{EpisodeParameters, ObjectSpec, ObservationLayout, TaskConfig},
};

/// Validated settings with the models built from them, shared by all rows.
#[derive(Debug)]
pub struct Setup {
    config: TaskConfig,
    layout: ObservationLayout,
    models: Vec<ObjectModel>,
    tactile: TactileModel,
    /// Hash that identifies the settings and their files in snapshots.
    fingerprint: [u8; 8],
}

impl Setup {
    /// Validates the settings and builds their models; returns the first error found.
    pub fn new(config: TaskConfig) -> Result<Self> {
        let config = config.with_sensor()?;
        config.validate()?;
        let models = guarded(|| config.models()).flatten()?;
        let tactile = tactile_model(&config, &models)?;
        let layout = ObservationLayout::new(&config, tactile.pads().map(|pad| &**pad.skin()))?;
        check_predicted(&layout, &tactile)?;
        let fingerprint = snapshot::fingerprint(&config)?;
        let setup = Self { config, layout, models, tactile, fingerprint };
        episode::check_starts(&setup)?;
        Ok(setup)
    }

    /// The settings.
    pub fn config(&self) -> &TaskConfig {
        &self.config
    }

    /// Position of each channel in an observation.
    pub fn layout(&self) -> &ObservationLayout {
        &self.layout
    }

    /// The configured objects.
    pub fn models(&self) -> &[ObjectModel] {
        &self.models
    }

    /// Shape of an object for contact with the fingers.
    fn felt_shape(&self, object: usize) -> &Shape {
        let model = &self.models[object];
        if self.config.tactile.takes_sampled_shapes() { model.sampled() } else { model.shape() }
    }

    /// Optional parts of a solution that the observation or the task needs.
    pub fn wanted(&self) -> Wanted {
        let mut channels =
            self.layout.channels().iter().filter_map(|(name, _)| Channel::named(name));
        let is_soft = matches!(self.tactile, TactileModel::Objects(_));
        let stress = is_soft || self.config.task.limits_pad_stress();
        Wanted { stress: stress || channels.any(Channel::is_of_stress), residual: false }
    }

    /// Body that deforms where the fingers touch, with its model.
    pub fn tactile(&self) -> &TactileModel {
        &self.tactile
    }

    /// Young's modulus of what deforms in an episode, relative to that of its model.
    fn stiffness(&self, parameters: &EpisodeParameters) -> f64 {
        let soft = self.tactile.object(parameters.object).zip(parameters.young);
        soft.map_or(parameters.gel_stiffness, |(object, young)| young / object.stress(1.0))
    }
}

/// Builds the model of what deforms: the configured objects if they are soft, or else the pads.
fn tactile_model(config: &TaskConfig, models: &[ObjectModel]) -> Result<TactileModel> {
    let Some(material) = config.task.soft_material() else {
        return Ok(
            TactilePad::new(&config.touch())?.map_or(TactileModel::Rigid, TactileModel::Pads)
        );
    };
    let gripper = &config.scene.gripper;
    let extents = Vector3::new(gripper.pad_width, gripper.pad_length, gripper.pad_thickness);
    let object = |(spec, model): (&ObjectSpec, &ObjectModel)| {
        SoftObject::new(model.shape(), 0.5 * extents, material.poisson)
            .map_err(|error| of_object(error, spec))
    };
    let objects = config.objects.iter().zip(models).map(object);
    objects.collect::<Result<_>>().map(TactileModel::Objects)
}

/// An error about the mesh of a soft object, with the object named as in the settings.
fn of_object(error: Error, spec: &ObjectSpec) -> Error {
    match error {
        Error::Invalid { name, found, expected } if name == "shape" => {
            Error::invalid("objects", format!("{spec}, {found}"), expected)
        }
        Error::BadMesh { name, reason } => {
            Error::BadMesh { name: format!("{spec} {name}"), reason }
        }
        other => other,
    }
}

/// Returns an error if errors are observed that `tactile` does not predict.
fn check_predicted(layout: &ObservationLayout, tactile: &TactileModel) -> Result<()> {
    let channel = Channel::PredictedError.name();
    let Some(pad) = tactile.pads() else { return Ok(()) };
    let is_observed = layout.channels().iter().any(|(name, _)| *name == channel);
    if !is_observed || pad.model().predicts_errors() {
        return Ok(());
    }
    let (found, expected) = match pad.model() {
        Model::Surrogate(_) => ("weights whose card has no error model", "the shipped network"),
        model => (model.name(), "\"surrogate\", the only model that predicts its errors"),
    };
    Err(Error::invalid("tactile", found, format!("{expected}, for the channel {channel}")))
}

/// Result of `act`, or an [`Error::Panicked`] if it panics, as Rapier does if one of its internal
/// assertions fails.
fn guarded<T>(act: impl FnOnce() -> T) -> Result<T> {
    catch_unwind(AssertUnwindSafe(act)).map_err(|_| Error::Panicked)
}
