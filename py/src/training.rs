//! Training and judging of surrogates, for Python.

use std::path::PathBuf;

use pyo3::{exceptions::PyValueError, prelude::*};
use ruffini_core::surrogate::{PressErrors, Progress, Training, evaluate, train};

use crate::error::python_error;

/// Trains on the dataset in `data` into the folder `out`; the card as JSON, or `None` if stopped.
///
/// `settings` is a JSON object laid over the default training. `watch` is called with the name of a
/// stage and a JSON value; false stops. It is called in this thread, where signals are heard.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)] // Arguments come owned from Python.
pub(crate) fn train_surrogate(
    py: Python<'_>,
    data: PathBuf,
    out: PathBuf,
    settings: &str,
    commit: &str,
    watch: Py<PyAny>,
) -> PyResult<Option<String>> {
    let training = training(settings)?;
    let mut raised = None;
    let mut go_on = |progress: &Progress| {
        let answer = Python::attach(|py| {
            py.check_signals()?;
            match message(progress) {
                Some((stage, value)) => watch.call1(py, (stage, value))?.is_truthy(py),
                None => Ok(true),
            }
        });
        answer.unwrap_or_else(|error| {
            raised = Some(error);
            false
        })
    };
    let card = py.detach(|| train(&data, &out, &training, commit, &mut go_on));
    if let Some(error) = raised {
        return Err(error);
    }
    let text = |card| serde_json::to_string(&card).expect("plain data");
    Ok(card.map_err(python_error)?.map(text))
}

/// Errors on the test part of a split: for each frame the grasp's name, and as JSON the errors of the
/// network and of the linear answer.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)] // Arguments come owned from Python.
pub(crate) fn evaluate_surrogate(
    py: Python<'_>,
    weights: PathBuf,
    data: PathBuf,
    split: &str,
) -> PyResult<Vec<(String, String, String)>> {
    let found = py.detach(|| evaluate(&weights, &data, split)).map_err(python_error)?;
    let text = |errors: &PressErrors| serde_json::to_string(errors).expect("plain data");
    Ok(found.into_iter().map(|(grasp, net, linear)| (grasp, text(&net), text(&linear))).collect())
}

fn training(settings: &str) -> PyResult<Training> {
    let bad = |error: serde_json::Error| PyValueError::new_err(format!("training: {error}"));
    serde_json::from_str::<Training>(settings).map_err(bad)?.validated().map_err(python_error)
}

/// What Python is told of a stage; nothing of single batches.
fn message(progress: &Progress) -> Option<(&'static str, String)> {
    match progress {
        Progress::Batch => None,
        Progress::Shard { done, all } => {
            Some(("shard", serde_json::json!({"done": done, "all": all}).to_string()))
        }
        Progress::Samples { train, lost } => {
            Some(("samples", serde_json::json!({"train": train, "lost": lost}).to_string()))
        }
        Progress::Epoch { epoch, validation, left } => {
            let value = serde_json::json!({
                "epoch": epoch.epoch, "steps": epoch.steps, "errors": epoch.errors,
                "seconds": epoch.seconds, "validation": validation, "left": left,
            });
            Some(("epoch", value.to_string()))
        }
    }
}
