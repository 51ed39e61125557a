//! Environments: one row is one episode after another; a batch is many rows stepped together.
//!
//! Rows share nothing but their settings, so a row's numbers depend on its seed and actions alone:
//! not on the other rows, their number, or the number of threads. A step has three phases: every row
//! moves its rigid world, one call answers the presses of all fingers, every row observes.

mod answers;
mod batch;
mod episode;
mod plan;
mod row;
mod snapshot;
mod squeeze;
mod start;
mod touch;
mod trial;
mod way;

pub use batch::{Autoreset, Batch, StepResult};
pub use episode::Outcome;
pub use plan::Stage;
pub use row::Row;

use nalgebra::Vector3;

use crate::{
    Result,
    deformation::Wanted,
    geometry::Shape,
    scene::ObjectModel,
    tactile::{Channel, Choice, SoftObject, Touch},
    task::{Config, Layout},
};

/// Settings made ready once for all rows.
#[derive(Debug)]
pub struct Setup {
    config: Config,
    layout: Layout,
    models: Vec<ObjectModel>,
    touch: Option<Touch>,
    /// Models of the objects, where these are soft.
    soft: Vec<SoftObject>,
    /// Identifies the settings in snapshots.
    fingerprint: [u8; 8],
}

impl Setup {
    /// Ready settings, or the first thing wrong with them.
    pub fn new(config: Config) -> Result<Self> {
        let config = config.with_sensor()?;
        config.validate()?;
        let models = config.models()?;
        let soft = soft_objects(&config, &models)?;
        let touch = if config.pads_feel() { Touch::new(&config.touch())? } else { None };
        let layout = Layout::new(&config, touch.as_ref().map(|touch| &**touch.skin()))?;
        let fingerprint = snapshot::fingerprint(&config);
        Ok(Self { config, layout, models, touch, soft, fingerprint })
    }

    /// The settings.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Where each channel lies in an observation.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The configured objects.
    pub fn models(&self) -> &[ObjectModel] {
        &self.models
    }

    /// The shape of an object as fingers feel it: networks are wrong by more than a sampled one is.
    fn felt_shape(&self, object: usize) -> &Shape {
        let model = &self.models[object];
        match self.config.tactile {
            Choice::Surrogate | Choice::SurrogateFine => model.sampled(),
            Choice::None | Choice::Compliance | Choice::Fem => model.shape(),
        }
    }

    /// What must be known of each answer for the observation and the task.
    pub fn wanted(&self) -> Wanted {
        let channels = self.layout.channels().iter().filter_map(|(name, _)| Channel::named(name));
        let task = Wanted { stress: self.config.fragility.is_some(), residual: false };
        channels.map(Channel::wants).fold(task, |all, more| Wanted {
            stress: all.stress || more.stress,
            residual: all.residual || more.residual,
        })
    }

    /// The model of object `index`, if the objects are soft.
    pub fn soft(&self, index: usize) -> Option<&SoftObject> {
        self.soft.get(index)
    }

    /// What the fingers feel with, unless they are rigid.
    pub fn touch(&self) -> Option<&Touch> {
        self.touch.as_ref()
    }
}

/// Models of the configured objects, or none if they are rigid.
fn soft_objects(config: &Config, models: &[ObjectModel]) -> Result<Vec<SoftObject>> {
    let Some(softness) = &config.softness else { return Ok(Vec::new()) };
    let gripper = &config.scene.gripper;
    let extents = Vector3::new(gripper.pad_width, gripper.pad_length, gripper.pad_thickness);
    let object =
        |model: &ObjectModel| SoftObject::new(model.shape(), 0.5 * extents, softness.poisson);
    models.iter().map(object).collect()
}
