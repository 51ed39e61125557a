//! `ruffini._core`: Python bindings of the Rust crate. Numbers are passed as numpy arrays, settings
//! as JSON, snapshots as bytes.

mod dataset;
mod error;
mod gif;
mod mechanics;
mod pool;
mod sensor;
mod signals;
mod tensors;
mod training;

use std::{
    path::PathBuf,
    sync::{Arc, Mutex, MutexGuard, TryLockError},
};

use nalgebra::Vector3;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::{
    exceptions::PyRuntimeError,
    prelude::*,
    types::{PyBytes, PyDict},
};
use ruffini_core::{
    Error,
    env::{Autoreset, Row, Setup, StepResult},
    geometry::read_solid,
    render::{PinholeCamera, STRESS_COLORS, Viewpoint},
    scene::{CATALOGUE, Gripper, ObjectModel},
    task::{Ending, StartQuantity, TaskConfig},
};

use error::{PressError, SimulationError, python_error};
use mechanics::arrays::array_of_rows;
use signals::interruptible;

/// Batch of N environments that are stepped together, by one thread at a time.
#[pyclass(frozen, module = "ruffini._core")]
struct Batch {
    inner: Mutex<ruffini_core::env::Batch>,
}

/// Observations (N, D), rewards (N), terminated (N), truncated (N), reward terms (N, K), success
/// (N), codes of the endings (N), the rows that were reset with the last observation of the ended
/// episode, and the rows with a failed press with the kind of its error.
type Step<'py> = (
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<u8>>,
    Vec<(usize, Bound<'py, PyArray1<f32>>)>,
    Vec<(usize, &'static str)>,
);

/// Name, lower bounds, upper bounds and unit of a channel's component.
type Component = (String, Vec<f32>, Vec<f32>, &'static str);

/// Camera by its name, or by position (m), target (m) and vertical field of view (rad).
#[derive(FromPyObject)]
enum CameraArgument {
    Name(String),
    Pose(([f64; 3], [f64; 3], f64)),
}

#[pymethods]
#[allow(clippy::needless_pass_by_value)] // Arguments come owned from Python.
impl Batch {
    #[new]
    fn new(
        py: Python<'_>,
        settings: &str,
        num_envs: usize,
        num_threads: usize,
        autoreset: &str,
    ) -> PyResult<Self> {
        let autoreset = match autoreset {
            "NextStep" => Autoreset::NextStep,
            "SameStep" => Autoreset::SameStep,
            "Disabled" => Autoreset::Disabled,
            other => {
                let expected = "NextStep, SameStep or Disabled";
                return Err(python_error(Error::invalid("autoreset_mode", other, expected)));
            }
        };
        let inner = interruptible(py, || {
            let setup = Arc::new(Setup::new(TaskConfig::from_json(settings)?)?);
            ruffini_core::env::Batch::new(setup, num_envs, num_threads, autoreset)
        })?;
        Ok(Self { inner: Mutex::new(inner.map_err(python_error)?) })
    }

    /// Channels of the observation with their components.
    fn layout(&self) -> PyResult<Vec<(&'static str, Vec<Component>)>> {
        let components = |components: &[ruffini_core::task::Component]| {
            let row = |c: &ruffini_core::task::Component| {
                (c.name.clone(), c.low.clone(), c.high.clone(), c.unit)
            };
            components.iter().map(row).collect()
        };
        let batch = self.held()?;
        let channels = batch.setup().layout().channels();
        Ok(channels.iter().map(|(name, parts)| (*name, components(parts))).collect())
    }

    /// Names of the reward's terms, in order.
    fn reward_terms(&self) -> PyResult<Vec<&'static str>> {
        let batch = self.held()?;
        let terms = batch.setup().config().task.terms();
        Ok(terms.iter().map(|term| term.name).collect())
    }

    /// Starts episodes in the rows of `mask`, or in all, after reseeding the rows that have a seed.
    fn reset<'py>(
        &self,
        py: Python<'py>,
        seeds: Option<Vec<Option<u64>>>,
        mask: Option<PyReadonlyArray1<'py, bool>>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let mask = mask.map(|mask| mask.as_array().to_vec());
        let mut batch = self.held()?;
        let reset = |batch: &mut ruffini_core::env::Batch| {
            if let Some(seeds) = seeds {
                batch.seed(&seeds)?;
            }
            batch.reset(mask.as_deref())
        };
        let observation = patient(py, &mut batch, reset)?.map_err(python_error)?;
        rows(py, &batch, observation)
    }

    /// Takes one step; `actions` is (N, 5).
    fn step<'py>(
        &self,
        py: Python<'py>,
        actions: PyReadonlyArray2<'py, f32>,
    ) -> PyResult<Step<'py>> {
        let columns = actions.as_array().ncols();
        if columns != ruffini_core::task::ACTION_SIZE {
            let found = format!("rows of {columns} numbers");
            return Err(python_error(Error::invalid("actions", found, "rows of 5 numbers")));
        }
        let actions: Vec<f32> = actions.as_array().iter().copied().collect();
        let mut batch = self.held()?;
        let StepResult { observation, outcomes, finals } =
            patient(py, &mut batch, |batch| batch.step(&actions))?.map_err(python_error)?;
        let column = |f: fn(&ruffini_core::env::Outcome) -> bool| {
            PyArray1::from_iter(py, outcomes.iter().map(f))
        };
        let failed = outcomes.iter().enumerate();
        let failed = failed.filter_map(|(i, o)| o.press_error.map(|kind| (i, kind))).collect();
        let task = &batch.setup().config().task;
        // Adding zero removes its sign.
        let terms = outcomes.iter().flat_map(|o| o.terms.values(task)).map(|term| term + 0.0);
        let terms = PyArray1::from_iter(py, terms);
        Ok((
            rows(py, &batch, observation)?,
            PyArray1::from_iter(py, outcomes.iter().map(|o| o.reward)),
            column(|o| o.terminated),
            column(|o| o.truncated),
            terms.reshape([outcomes.len(), task.terms().len()])?,
            column(|o| o.is_success),
            PyArray1::from_iter(py, outcomes.iter().map(|o| o.ending.map_or(0, Ending::code))),
            finals.into_iter().map(|(i, last)| (i, PyArray1::from_vec(py, last))).collect(),
            failed,
        ))
    }

    /// Sets a quantity of the start of all further episodes (N,); NaN has it drawn.
    fn give(&self, name: &str, values: PyReadonlyArray1<'_, f64>) -> PyResult<()> {
        let quantity = StartQuantity::named(name).map_err(python_error)?;
        self.held()?.give(quantity, &values.as_array().to_vec()).map_err(python_error)
    }

    /// Ends the episodes of the rows of `mask`.
    fn end(&self, mask: PyReadonlyArray1<'_, bool>) -> PyResult<()> {
        self.held()?.end(&mask.as_array().to_vec()).map_err(python_error)
    }

    /// Stages of a step: name, mean number of runs and mean time (µs) in a step of one environment.
    fn plan(&self, forget: bool) -> PyResult<Vec<(String, f64, f64)>> {
        let plan = self.held()?.plan(forget).into_iter();
        Ok(plan.map(|stage| (stage.name, stage.runs, stage.microseconds)).collect())
    }

    /// Rest positions (m) that the tactile channels refer to; `None` for rigid fingers.
    fn skin<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let batch = self.held()?;
        let Some(touch) = batch.setup().tactile().pads() else { return Ok(None) };
        mechanics::skin::places(py, touch.skin()).map(Some)
    }

    /// Renders the scene of one row as a picture (height, width, 3).
    fn render<'py>(
        &self,
        py: Python<'py>,
        row: usize,
        width: usize,
        height: usize,
        camera: CameraArgument,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let viewpoint = match camera {
            CameraArgument::Name(name) => Viewpoint::named(&name).map_err(python_error)?,
            CameraArgument::Pose((position, target, field_of_view)) => {
                Viewpoint::Fixed(PinholeCamera::new(position, target, field_of_view))
            }
        };
        let batch = &mut *self.held()?;
        let render = || batch.render(row, [width, height], &viewpoint);
        let picture = py.detach(render).map_err(python_error)?;
        PyArray1::from_vec(py, picture).reshape([height, width, 3])
    }

    /// Surfaces of a row's objects and fixture by name: vertices (V, 3) in m, triangles (F, 3), and
    /// von Mises stress (V,) in Pa or `None`.
    fn surfaces<'py>(&self, py: Python<'py>, row: usize) -> PyResult<Bound<'py, PyDict>> {
        let batch = &mut *self.held()?;
        let surfaces = py.detach(|| batch.surfaces(row)).map_err(python_error)?;
        let dict = PyDict::new(py);
        for surface in surfaces {
            let vertices = array_of_rows(py, surface.vertices.iter().map(|&p| p.into()));
            let triangles = array_of_rows(py, surface.triangles.into_iter());
            let stress = surface.stress.map(|stress| PyArray1::from_vec(py, stress));
            dict.set_item(surface.name, (vertices, triangles, stress))?;
        }
        Ok(dict)
    }

    /// Snapshots of all rows as bytes.
    fn save<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyBytes>>> {
        Ok(self.held()?.save().iter().map(|state| PyBytes::new(py, state)).collect())
    }

    /// Restores all rows from snapshots made by `save` and returns their observations.
    fn load<'py>(
        &self,
        py: Python<'py>,
        states: Vec<Vec<u8>>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let mut batch = self.held()?;
        let observation = batch.load(&states).map_err(python_error)?;
        rows(py, &batch, observation)
    }

    /// Booleans (N,), true where the episode of a row is over or has not begun.
    fn ended<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<bool>>> {
        Ok(PyArray1::from_iter(py, self.held()?.rows().iter().map(Row::needs_reset)))
    }

    /// Presses of the pads of a row as its bodies stand, the one on -x first; `None` where nothing
    /// is near.
    fn presses(&self, py: Python<'_>, row: usize) -> PyResult<[Option<mechanics::Press>; 2]> {
        let [a, b] = self.held()?.presses(row).map_err(python_error)?;
        let wrap = |press: Option<_>| press.map(|press| mechanics::Press::of(py, press));
        Ok([wrap(a).transpose()?, wrap(b).transpose()?])
    }

    /// Quantities drawn for the episode of a row and poses of its bodies, in SI units; `None`
    /// before the first reset.
    fn look<'py>(&self, py: Python<'py>, row: usize) -> PyResult<Option<Bound<'py, PyDict>>> {
        let batch = self.held()?;
        let rows = batch.rows();
        let found = rows.get(row).ok_or_else(|| {
            python_error(Error::invalid("row", row, format!("less than {}", rows.len())))
        })?;
        let Some((state, episode)) = found.state() else { return Ok(None) };
        let objects = &batch.setup().config().objects;
        let pose = &state.object.pose;
        let dict = PyDict::new(py);
        dict.set_item("object", objects[episode.object].to_string())?;
        dict.set_item("size", episode.scale)?;
        dict.set_item("mass", episode.mass)?;
        dict.set_item("friction", episode.friction)?;
        if batch.setup().tactile().pads().is_some() {
            dict.set_item("gel_stiffness", episode.gel_stiffness)?;
        }
        if let Some(young) = episode.young {
            dict.set_item("young", young)?;
        }
        if let Some(limit) = episode.stress_limit {
            dict.set_item("stress_limit", limit)?;
        }
        if let Some(trial) = episode.trial {
            dict.set_item("trial_grip", trial.grip)?;
            dict.set_item("margin", trial.margin)?;
        }
        if let Some(shaking) = episode.shaking {
            dict.set_item("load", shaking.load)?;
            dict.set_item("shaking", shaking.amplitude)?;
            dict.set_item("shaking_frequency", shaking.frequency)?;
        }
        if let Some(insertion) = episode.insertion {
            dict.set_item("clearance", insertion.clearance)?;
            dict.set_item("hole_position", insertion.hole)?;
            dict.set_item("hole_yaw", insertion.hole_yaw)?;
            dict.set_item("peg_offset", insertion.offset)?;
            dict.set_item("peg_tilt", insertion.tilt)?;
        }
        dict.set_item("object_position", pose.translation.vector.as_slice().to_vec())?;
        dict.set_item("object_quaternion", pose.rotation.coords.as_slice().to_vec())?;
        let distractors = episode.distractors.iter().flatten().zip(&state.distractors);
        let distractors = distractors.map(|(drawn, body)| {
            let dict = PyDict::new(py);
            dict.set_item("object", objects[drawn.object].to_string())?;
            dict.set_item("size", drawn.scale)?;
            dict.set_item("mass", drawn.mass)?;
            dict.set_item("position", body.pose.translation.vector.as_slice().to_vec())?;
            dict.set_item("quaternion", body.pose.rotation.coords.as_slice().to_vec())?;
            Ok(dict)
        });
        let distractors = distractors.collect::<PyResult<Vec<_>>>()?;
        if !distractors.is_empty() {
            dict.set_item("distractors", distractors)?;
        }
        let tool = state.wrist.pose.translation.vector;
        dict.set_item("tool_position", tool.as_slice().to_vec())?;
        dict.set_item("tool_yaw", state.wrist.yaw)?;
        dict.set_item("opening", state.opening())?;
        let wrenches = state.fingers.iter().map(|f| {
            let (force, torque) = (f.wrench.force, f.wrench.torque);
            force.iter().chain(torque.iter()).copied().collect::<Vec<f64>>()
        });
        dict.set_item("pad_wrenches", wrenches.collect::<Vec<_>>())?;
        dict.set_item("indentations", found.indentations().unwrap_or_default().to_vec())?;
        Ok(Some(dict))
    }
}

impl Batch {
    /// The batch, or an error while another thread has it.
    fn held(&self) -> PyResult<MutexGuard<'_, ruffini_core::env::Batch>> {
        match self.inner.try_lock() {
            Ok(batch) => Ok(batch),
            // A panic has been told in Python, where rows may be reset.
            Err(TryLockError::Poisoned(error)) => Ok(error.into_inner()),
            Err(TryLockError::WouldBlock) => Err(PyRuntimeError::new_err(
                "environments: found in another call, expected one thread at a time; make \
                 environments for each thread, or one vector environment with more rows",
            )),
        }
    }
}

/// Observations (N, D).
fn rows<'py>(
    py: Python<'py>,
    batch: &ruffini_core::env::Batch,
    values: Vec<f32>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    PyArray1::from_vec(py, values).reshape([batch.rows().len(), batch.setup().layout().size()])
}

/// Runs `work` without the GIL; Ctrl-C ends it early, for a thread's time, if steps may be slow.
fn patient<T: Send>(
    py: Python<'_>,
    batch: &mut ruffini_core::env::Batch,
    work: impl FnOnce(&mut ruffini_core::env::Batch) -> T + Send,
) -> PyResult<T> {
    if batch.setup().config().tactile.is_slow() {
        interruptible(py, || work(batch))
    } else {
        Ok(py.detach(|| work(batch)))
    }
}

/// Description of tasks, channels and settings as JSON.
#[pyfunction]
fn schema() -> String {
    ruffini_core::task::schema().to_string()
}

/// Builds the object of a mesh file as the environments do, its origin moved to its middle. Returns
/// the `size` below which it fits between the open pads, and of the object at rest on the table the
/// direction in the file's axes that points down, and the height (m).
#[pyfunction]
#[allow(clippy::needless_pass_by_value)] // Arguments come owned from Python.
fn check_mesh(py: Python<'_>, path: PathBuf, scale: f64) -> PyResult<(f64, [f64; 3], f64)> {
    let file = path.display().to_string();
    let model = || {
        let solid = read_solid(&path, scale, true)?;
        ObjectModel::new(solid).map_err(|error| error.of_mesh(&file))
    };
    let model = py.detach(model).map_err(python_error)?;
    let (low, high) = model.surface().bounds();
    let rest = model.rest(1.0, 0.0, 0.0, 0.0);
    let heights = model.surface().vertices().iter().map(|v| (rest * v).z);
    let down = rest.inverse_transform_vector(&-Vector3::z());
    Ok((
        Gripper::default().max_opening / (high - low).min(),
        down.into(),
        heights.fold(0.0, f64::max),
    ))
}

/// Compiled part of the `ruffini` package.
#[pymodule]
mod _core {
    #[pymodule_export]
    use super::{Batch, PressError, SimulationError, check_mesh, schema};
    #[pymodule_export]
    use crate::dataset::{dataset_shards, estimate_dataset, generate_dataset, solve_press};
    #[pymodule_export]
    use crate::gif::encode_gif;
    #[pymodule_export]
    use crate::mechanics::{
        Antipodal, Compliance, Deformation, Fem, Grasp, Grasped, History, LinearPad, Object,
        PaperAnswer, PaperNetwork, Press, Shape, Skin, SoftBody, SoftSurrogate, Surrogate, TetMesh,
        Transfer, objects, sensor,
    };
    #[pymodule_export]
    use crate::sensor::{fit_foundation, read_sensor, sensor_names, sensor_template};
    #[pymodule_export]
    use crate::tensors::{read_tensors, write_tensors};
    #[pymodule_export]
    use crate::training::{evaluate_surrogate, train_surrogate};

    use super::{
        Bound, CATALOGUE, PyArray1, PyModule, PyModuleMethods, PyResult, STRESS_COLORS, Viewpoint,
    };

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        // NumPy's interface is looked up with the first array. A Ctrl-C just then would be a panic.
        PyArray1::<f64>::zeros(module.py(), 0, false);
        module.add("OBJECTS", CATALOGUE.to_vec())?;
        module.add("CAMERAS", Viewpoint::NAMED.map(|(name, _)| name).to_vec())?;
        module.add("STRESS_COLORS", STRESS_COLORS.map(<(u8, u8, u8)>::from).to_vec())?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
