//! Python functions that generate datasets of solved grasps.

use std::{
    path::PathBuf,
    sync::{Mutex, PoisonError},
};

use numpy::PyArray1;
use pyo3::{IntoPyObjectExt, prelude::*};
use ruffini_core::{
    dataset::{
        self, BodyFields, DatasetConfig, Estimate, GenerationProgress, Orders, Plan, Scenario,
        estimate, generate, shards,
    },
    deformation::Wrench,
    fem::Carried,
    interrupt::Interrupt,
    objects::{GraspSampler, Object},
    scene::{Approach, ObjectModel},
};

use crate::{
    error::{press_error, python_error, value_error},
    mechanics::{
        Shape,
        arrays::{array_of_vectors, refused},
        press::pose,
    },
    pool::in_pool,
    signals::interruptible,
};

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

/// Fields of one press of the first gel of a configuration, solved as the presses of a dataset are;
/// the configuration is as in `generate_dataset`.
///
/// `path` holds poses: the first where the indenter touches, then those of the frames, up to four
/// of them straight below. Returns for each frame displacement (V, 3) in m and von Mises stress
/// (T,) in Pa on the mesh of `model_nodes`, and the wrench on the pad (6,) in N and N m. It ends
/// early with a `PressError` at the first frame that is not solved.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)] // Arguments come owned from Python.
pub(crate) fn solve_press<'py>(
    py: Python<'py>,
    config: Option<PathBuf>,
    overrides: &str,
    shape: &Shape,
    path: Vec<Bound<'py, PyAny>>,
) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let config = configuration(config, overrides)?;
    let poses = path.iter().enumerate().map(|(i, found)| pose(&format!("path[{i}]"), found));
    let poses = poses.collect::<PyResult<Vec<_>>>()?;
    let [start, frames @ ..] = &poses[..] else {
        return Err(refused("path", "no pose", "two or more"));
    };
    let solve = || dataset::solve_press(&config, &shape.inner, *start, frames.to_vec());
    let (frames, error) = in_pool(py, solve)?.map_err(python_error)?;
    let fields = |frame: BodyFields| {
        let Carried { displacement, von_mises } = frame.carried;
        let Wrench { force, torque } = frame.wrench;
        let wrench: Vec<f64> = force.iter().chain(&torque).copied().collect();
        let [stress, wrench] = [von_mises, wrench].map(|values| PyArray1::from_vec(py, values));
        (array_of_vectors(py, &displacement), stress, wrench).into_bound_py_any(py)
    };
    let ended = error.map(|error| press_error(py, &error, None));
    frames.into_iter().map(fields).chain(ended).collect()
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
    let bad = |error: serde_json::Error| value_error(format!("configuration: {error}"));
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
            let unfit = |error| value_error(format!("{name}: {error}"));
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
