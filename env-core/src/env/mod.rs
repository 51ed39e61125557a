//! Environments: one row is one episode after another; a batch is many rows stepped together.
//!
//! Rows share nothing but their settings, so a row's numbers depend on its seed and actions alone:
//! not on the other rows, their number, or the number of threads.

mod batch;
mod row;
mod snapshot;

pub use batch::{Autoreset, Batch, StepResult};
pub use row::{Outcome, Row};

use crate::{
    Result,
    scene::ObjectModel,
    task::{Config, Layout},
};

/// Settings made ready once for all rows.
#[derive(Debug)]
pub struct Setup {
    config: Config,
    layout: Layout,
    models: Vec<ObjectModel>,
    /// Identifies the settings in snapshots.
    fingerprint: [u8; 8],
}

impl Setup {
    /// Ready settings, or the first thing wrong with them.
    pub fn new(config: Config) -> Result<Self> {
        config.validate()?;
        let (layout, models) = (Layout::new(&config)?, config.models()?);
        let fingerprint = snapshot::fingerprint(&config);
        Ok(Self { config, layout, models, fingerprint })
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
}
