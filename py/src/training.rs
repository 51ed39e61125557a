//! Python functions that train and evaluate surrogates.

use std::{
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use pyo3::prelude::*;
use ruffini_core::{
    Error,
    interrupt::Interrupt,
    surrogate::{
        Evaluated, PressErrors, Training, TrainingProgress, evaluate,
        paper::{PaperRun, PaperTrainingConfig},
        soft::SoftTrainingConfig,
        train,
    },
};
use serde_json::{Value, json};

use crate::{
    error::{python_error, value_error},
    pool::{in_new_pool, in_pool},
};

/// Trains a network on the dataset in `data` and writes it to the folder `out`; returns its card as
/// JSON, or `None` if stopped.
///
/// `settings` is a JSON object of values that replace the defaults of that variant. `clock` returns
/// the time (s) by which a budget of seconds is measured. `watch` is called with the name of a
/// stage and a JSON value, and stops the training if it returns false. Both are called from another
/// thread. A signal that raises an exception in this one, as Ctrl-C does, stops the training.
#[pyfunction]
#[allow(clippy::needless_pass_by_value, clippy::too_many_arguments)] // As they come from Python.
pub(crate) fn train_surrogate(
    py: Python<'_>,
    data: PathBuf,
    coarser: Option<PathBuf>,
    out: PathBuf,
    variant: &str,
    settings: &str,
    commit: &str,
    clock: Py<PyAny>,
    watch: Py<PyAny>,
) -> PyResult<Option<String>> {
    let request = TrainingRequest::new(variant, settings)?;
    let work = || {
        let raised = Mutex::new(None);
        let heard = |error: PyErr| {
            raised.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        };
        let now = || {
            let now = Python::attach(|py| clock.call0(py)?.extract::<f64>(py));
            now.map_err(heard).unwrap_or_default()
        };
        let interrupt = Interrupt::current();
        let mut go_on = |progress: &TrainingProgress| {
            let answer = Python::attach(|py| match message(progress) {
                Some((stage, value)) => watch.call1(py, (stage, value))?.is_truthy(py),
                None => Ok(true),
            });
            // An exception raised by the clock stops the training, too.
            answer.map_err(heard).unwrap_or_default()
                && raised.lock().unwrap_or_else(PoisonError::into_inner).is_none()
                && !interrupt.is_requested()
        };
        let card = request.train((&data, coarser.as_deref()), &out, commit, &now, &mut go_on);
        raised.into_inner().unwrap_or_else(PoisonError::into_inner).map_or(Ok(card), Err)
    };
    in_new_pool(py, work)??.map_err(python_error)
}

/// Requested training run.
enum TrainingRequest {
    Corrector(Training),
    Paper(PaperRun, PaperTrainingConfig),
    Soft(SoftTrainingConfig),
}

impl TrainingRequest {
    fn new(variant: &str, settings: &str) -> PyResult<Self> {
        let settings = serde_json::from_str(settings).map_err(bad)?;
        match variant {
            "corrector" => {
                let training: Training = serde_json::from_value(settings).map_err(bad)?;
                Ok(Self::Corrector(training.validated().map_err(python_error)?))
            }
            "baseline" | "a" | "b" => Self::paper(variant, settings),
            "soft" => Ok(Self::Soft(serde_json::from_value(settings).map_err(bad)?)),
            other => {
                let expected = "corrector, baseline, a, b or soft";
                Err(python_error(Error::invalid("variant", other, expected)))
            }
        }
    }

    /// Reads the settings of one of the paper's networks: `network` and `density` define the
    /// network, the others its training.
    fn paper(variant: &str, mut settings: Value) -> PyResult<Self> {
        let mut run = json!({"network": {}});
        if let Some(settings) = settings.as_object_mut() {
            let known = ["network", "density"].into_iter();
            known.for_each(|key| {
                if let Some(value) = settings.remove(key) {
                    run[key] = value;
                }
            });
        }
        if let Some(network) = run["network"].as_object_mut()
            && network.insert("variant".to_owned(), variant.into()).is_some()
        {
            let error = Error::invalid("network", "a variant", "none beside the one to train");
            return Err(python_error(error));
        }
        let run = serde_json::from_value(run).map_err(bad)?;
        Ok(Self::Paper(run, serde_json::from_value(settings).map_err(bad)?))
    }

    /// Trains the network and returns its card as JSON, or `None` if stopped.
    fn train(
        &self,
        (data, coarser): (&Path, Option<&Path>),
        out: &Path,
        commit: &str,
        clock: &dyn Fn() -> f64,
        watch: &mut dyn FnMut(&TrainingProgress) -> bool,
    ) -> ruffini_core::Result<Option<String>> {
        if coarser.is_some() && !matches!(self, Self::Corrector(_)) {
            let expected = "none beside the dataset, but for the variant corrector";
            return Err(Error::invalid("coarser", "a dataset", expected));
        }
        let card = match self {
            Self::Corrector(training) => {
                train(data, coarser, out, training, commit, watch)?.map(|card| json!(card))
            }
            Self::Paper(run, settings) => {
                run.train(settings, data, out, commit, clock, watch)?.map(|card| json!(card))
            }
            Self::Soft(settings) => {
                settings.train(data, out, commit, clock, watch)?.map(|card| json!(card))
            }
        };
        Ok(card.map(|card| card.to_string()))
    }
}

#[allow(clippy::needless_pass_by_value)] // For `map_err`.
fn bad(error: serde_json::Error) -> PyErr {
    value_error(format!("training: {error}"))
}

/// Errors on the test part of a split: for each frame the grasp's name and, as JSON, the errors of
/// the network, null for quantities that it does not output, and those of the linear solution that
/// it corrects, if it corrects one.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)] // Arguments come owned from Python.
pub(crate) fn evaluate_surrogate(
    py: Python<'_>,
    weights: PathBuf,
    data: PathBuf,
    split: &str,
    coarser: bool,
) -> PyResult<Vec<(String, String, Option<String>)>> {
    let found = in_pool(py, || evaluate(&weights, &data, split, coarser))?.map_err(python_error)?;
    let text = |errors: &PressErrors| serde_json::to_string(errors).expect("plain data");
    let one = |Evaluated { grasp, network, linear }: Evaluated| {
        (grasp, text(&network), linear.as_ref().map(text))
    };
    Ok(found.into_iter().map(one).collect())
}

/// Name and JSON value of a stage for Python; `None` for single steps.
fn message(progress: &TrainingProgress) -> Option<(&'static str, String)> {
    match progress {
        TrainingProgress::Step => None,
        TrainingProgress::Shard { done, all } => {
            Some(("shard", serde_json::json!({"done": done, "all": all}).to_string()))
        }
        TrainingProgress::Samples { train, lost } => {
            Some(("samples", serde_json::json!({"train": train, "lost": lost}).to_string()))
        }
        TrainingProgress::Epoch { epoch, validation, left } => {
            let value = serde_json::json!({
                "epoch": epoch.epoch, "steps": epoch.steps, "errors": epoch.errors,
                "seconds": epoch.seconds, "validation": validation, "left": left,
            });
            Some(("epoch", value.to_string()))
        }
    }
}
