//! Who answers the presses, built once for all environments with the same settings.

use std::sync::{Arc, Mutex, PoisonError};

use rayon::ThreadPoolBuilder;

use super::{Choice, Config, Skin};
use crate::{
    Error, Result,
    compliance::{self, Compliance},
    deformation::{Deformation, DeformationModel, Press, SoftBody},
    fem::{self, Fem},
};

/// A model of a pad. Copies share what was computed in advance.
#[non_exhaustive]
#[derive(Clone)]
pub enum Model {
    /// Linear elasticity.
    Compliance(Compliance),
    /// Finite elements.
    Fem(Fem),
}

/// Everything fixed about the sense of touch: the surface of the pads and the model of their gel.
#[derive(Clone)]
pub struct Touch {
    skin: Arc<Skin>,
    model: Model,
}

impl std::fmt::Debug for Touch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Touch").field("model", &self.model.name()).finish_non_exhaustive()
    }
}

/// What was built last, most recent first.
static BUILT: Mutex<Vec<(Config, Touch)>> = Mutex::new(Vec::new());
/// How many are kept.
const KEPT: usize = 4;

impl Touch {
    /// What `config` describes, or none for rigid fingers. What this process built lately is shared.
    pub fn new(config: &Config) -> Result<Option<Self>> {
        config.validate()?;
        if config.choice == Choice::None {
            return Ok(None);
        }
        // Sensor files may change.
        let is_file = config.sensor.contains('.');
        let mut built = BUILT.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, touch)) = built.iter().find(|(known, _)| known == config && !is_file) {
            return Ok(Some(touch.clone()));
        }
        let sensor = config.sensor()?;
        let (pad, body) = config.pad(&sensor)?;
        let skin = Arc::new(Skin::new(&pad, &body, &sensor, &config.resolution)?);
        let Some(model) = Model::new(config.choice, body)? else { return Ok(None) };
        let touch = Self { skin, model };
        built.insert(0, (config.clone(), touch.clone()));
        built.truncate(KEPT);
        Ok(Some(touch))
    }

    /// Surface of the pads.
    pub fn skin(&self) -> &Arc<Skin> {
        &self.skin
    }

    /// The model, to be copied by whoever solves with it.
    pub fn model(&self) -> &Model {
        &self.model
    }
}

impl Model {
    /// The chosen model of `body`.
    fn new(choice: Choice, body: SoftBody) -> Result<Option<Self>> {
        Ok(match choice {
            Choice::None => None,
            Choice::Compliance => {
                let options = compliance::Options::default();
                Some(Self::Compliance(alone(move || Compliance::new(body, options))?))
            }
            Choice::Fem => Some(Self::Fem(Fem::new(body, fem::Options::default())?)),
        })
    }

    /// Its name in the settings.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Compliance(_) => "compliance",
            Self::Fem(_) => "fem",
        }
    }
}

impl DeformationModel for Model {
    fn solve(&mut self, presses: &[Press]) -> Vec<Result<Deformation>> {
        match self {
            Self::Compliance(model) => model.solve(presses),
            Self::Fem(model) => model.solve(presses),
        }
    }

    fn solve_path(&self, press: &Press) -> Vec<Result<Deformation>> {
        match self {
            Self::Compliance(model) => model.solve_path(press),
            Self::Fem(model) => model.solve_path(press),
        }
    }
}

/// What `build` returns, run on a thread that is gone afterwards: a process that has started rayon's
/// threads cannot be forked.
fn alone<T: Send>(build: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    let pool = ThreadPoolBuilder::new().num_threads(1).build();
    pool.map_err(|error| Error::invalid("threads", error, "a thread to start"))?.install(build)
}
