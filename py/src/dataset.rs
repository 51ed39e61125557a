//! Python functions that generate datasets of solved grasps.

use std::{
    path::PathBuf,
    sync::{Mutex, PoisonError},
};

use pyo3::{exceptions::PyValueError, prelude::*};
use ruffini_core::{
    dataset::{
        DatasetConfig, Estimate, GenerationProgress, Orders, Plan, Scenario, estimate, generate,
        shards,
    },
    interrupt::Interrupt,
    objects::{GraspSampler, Object},
    scene::{Approach, ObjectModel},
};

use crate::{error::python_error, signals::interruptible};

/// Names of the shards of a dataset; the configuration is as in `generate_dataset`.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)] // Arguments come owned from Python.
pub(crate) fn dataset_shards(config: Option<PathBuf>, overrides: &str) -> PyResult<Vec<String>> {
    shards(&configuration(config, overrides)?).map_err(python_error)
}

/// Number of grasps and frames, bytes and processor time (s) of what `generate_dataset` has to do.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)] // Arguments come owned from Python.
pub(crate) fn estimate_dataset(
    py: Python<'_>,
    folder: PathBuf,
    config: Option<PathBuf>,
    overrides: &str,
) -> PyResult<(usize, usize, u64, f64)> {
    let config = configuration(config, overrides)?;
    let found = py.detach(|| estimate(&config, &folder)).map_err(python_error)?;
    let Estimate { grasps, frames, bytes, seconds } = found;
    Ok((grasps, frames, bytes, seconds))
}

/// Generates a dataset in `folder`, or its missing part, restricted to the shards `only` if given;
/// returns whether the dataset is finished.
///
/// The configuration is that of the TOML file `config`, or the default, with the values of the JSON
/// object `overrides` in place of its own. `watch` is called from another thread.
#[pyfunction]
#[allow(clippy::needless_pass_by_value, clippy::too_many_arguments)] // As Python passes them.
pub(crate) fn generate_dataset(
    py: Python<'_>,
    folder: PathBuf,
    config: Option<PathBuf>,
    overrides: &str,
    commit: &str,
    threads: usize,
    only: Option<Vec<String>>,
    watch: Py<PyAny>,
) -> PyResult<bool> {
    let config = configuration(config, overrides)?;
    let raised = Mutex::new(None);
    let raise = |error| *raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
    let go_on = |progress: &GenerationProgress| {
        let has_raised = raised.lock().unwrap_or_else(PoisonError::into_inner).is_some();
        !has_raised
            && ask(&watch, progress).unwrap_or_else(|error| {
                raise(error);
                false
            })
    };
    let manifest = interruptible(py, || {
        let interrupt = Interrupt::current();
        let orders = Orders {
            commit,
            obstacle: Some(&obstacle),
            threads,
            only: only.as_deref(),
            interrupt: Some(&interrupt),
        };
        generate(&config, &folder, &orders, &go_on)
    })?;
    let finished = manifest.map_err(python_error)?.is_some();
    let raised = raised.into_inner().unwrap_or_else(PoisonError::into_inner);
    raised.map_or(Ok(finished), Err)
}

/// Describes what keeps the gripper of the scene from a grasp, if anything does; indenters are held
/// by none.
fn obstacle(object: &Object, plan: &Plan) -> ruffini_core::Result<Option<String>> {
    if plan.indentation.is_some() {
        return Ok(None);
    }
    let model = ObjectModel::new(object.shape.clone())?;
    let approach = Approach::new(model, GraspSampler::default().clearance);
    Ok(approach.obstacle(&plan.tool, plan.width)?.map(|obstacle| obstacle.to_string()))
}

fn configuration(file: Option<PathBuf>, overrides: &str) -> PyResult<DatasetConfig> {
    let bad = |error: serde_json::Error| PyValueError::new_err(format!("configuration: {error}"));
    let base = file.map_or_else(|| Ok(DatasetConfig::default()), |file| DatasetConfig::read(&file));
    let mut settings = serde_json::to_value(base.map_err(python_error)?).map_err(bad)?;
    let overrides: serde_json::Map<_, _> = serde_json::from_str(overrides).map_err(bad)?;
    for (name, value) in overrides {
        settings[name] = value;
    }
    let config: DatasetConfig = serde_json::from_value(settings).map_err(bad)?;
    let config = config.validated().map_err(python_error)?;
    if config.scenario != Scenario::Presses {
        // The gripper has to be driven to each.
        for Object { name, shape, .. } in config.own_objects().map_err(python_error)? {
            let unfit = |error| PyValueError::new_err(format!("{name}: {error}"));
            ObjectModel::new(shape).map_err(unfit)?;
        }
    }
    Ok(config)
}

fn ask(watch: &Py<PyAny>, progress: &GenerationProgress) -> PyResult<bool> {
    let GenerationProgress { done, all, frames, unsolved, seconds, bytes, .. } = *progress;
    Python::attach(|py| {
        watch.call1(py, (done, all, frames, unsolved, seconds, bytes))?.is_truthy(py)
    })
}
