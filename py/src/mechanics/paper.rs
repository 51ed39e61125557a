//! The paper's networks as models of presses, and their solutions.

use std::path::PathBuf;

use numpy::{PyArray1, PyArray2};
use pyo3::{IntoPyObjectExt, prelude::*};
use ruffini_core::{Result, surrogate::paper};

use super::{
    Press, SoftBody,
    answer::pose,
    arrays::{array_of_vectors, vectors},
    press::one_or_many,
    surrogate::CalibratedGel,
};
use crate::{
    error::{press_error, python_error},
    pool::in_pool,
};

/// Solution of a press by one of the paper's networks, in the frame of the body.
///
/// The networks do not output contact forces, so there is no wrench, history or residual.
#[pyclass(frozen, get_all, module = "ruffini")]
pub(crate) struct PaperAnswer {
    /// Displacement of the nodes (V, 3) in m.
    displacement: Py<PyArray2<f64>>,
    /// Von Mises equivalent of the Cauchy stress in the tetrahedra (T,) in Pa.
    von_mises: Py<PyArray1<f64>>,
    /// Best-fit rigid motion of the gel, p -> R p + t: position t (3,) and quaternion (4,) xyzw;
    /// None from a network that does not output it.
    rigid: Py<PyAny>,
    /// Pose of the shape: position (3,) and quaternion (4,) xyzw.
    pose: Py<PyAny>,
    /// Wall time (s).
    seconds: f64,
}

/// Graph network of DefGraspNets (Huang et al. 2023); inputs are the object's surface and motion.
///
/// Unlike Surrogate it uses no linear solution, and it accepts only one shape that moves along a
/// path from rest. It outputs displacement, stress and the gel's rigid motion, but no contact
/// forces. It is far less accurate than Surrogate: see `card`. Without contact, all displacements
/// are zero.
///
/// Args:
///     weights: Name of shipped weights.
///     sensor: Name of a sensor, or the path of its .toml file.
///     calibration: Name of the material; the first of the sensor if not given.
///     young: Young's modulus (Pa), in place of the calibration's.
///     poisson: Poisson's ratio, in place of the calibration's.
///     friction: Coefficient of friction; the sensor's at rest if not given.
///
/// Raises:
///     ValueError: If a name is not known.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct PaperNetwork {
    model: paper::PaperNetwork,
    /// Body, with mesh and material, to which solutions refer.
    #[pyo3(get)]
    body: Py<SoftBody>,
}

#[pymethods]
impl PaperNetwork {
    #[new]
    #[pyo3(signature = (weights="paper-b", sensor="gelsight-mini", calibration=None, young=None,
        poisson=None, friction=None))]
    fn new(
        py: Python<'_>,
        weights: &str,
        sensor: &str,
        calibration: Option<&str>,
        young: Option<f64>,
        poisson: Option<f64>,
        friction: Option<f64>,
    ) -> PyResult<Self> {
        let model = in_pool(py, || {
            let CalibratedGel { sensor, moduli, friction } =
                CalibratedGel::new(sensor, calibration, [young, poisson, friction])?;
            paper::PaperNetwork::named(weights, &sensor, moduli, friction)
        })?;
        Self::of(py, model)
    }

    /// Loads a network of one's own, from weights written by `ruffini network train`.
    ///
    /// Args:
    ///     path: The .safetensors file.
    ///     sensor, calibration, young, poisson, friction: As for PaperNetwork.
    ///
    /// Raises:
    ///     FileNotFoundError: If there is no such file.
    ///     ValueError: If the file is damaged, of another kind of network, or of one whose input is a
    ///         force.
    #[staticmethod]
    #[pyo3(signature = (path, sensor="gelsight-mini", calibration=None, young=None, poisson=None,
        friction=None))]
    #[allow(clippy::needless_pass_by_value)] // Arguments come owned from Python.
    fn load(
        py: Python<'_>,
        path: PathBuf,
        sensor: &str,
        calibration: Option<&str>,
        young: Option<f64>,
        poisson: Option<f64>,
        friction: Option<f64>,
    ) -> PyResult<Self> {
        let model = in_pool(py, || {
            let CalibratedGel { sensor, moduli, friction } =
                CalibratedGel::new(sensor, calibration, [young, poisson, friction])?;
            paper::PaperNetwork::load(&path, &sensor, moduli, friction)
        })?;
        Self::of(py, model)
    }

    fn __repr__(&self) -> String {
        format!("<ruffini.PaperNetwork {}>", self.body.get().about())
    }

    /// Description of the weights as JSON: form, training, data, errors on unseen data.
    #[getter]
    fn card(&self) -> String {
        serde_json::to_string(self.model.card()).expect("plain data")
    }

    /// Solves each press and returns its last frame.
    ///
    /// Args:
    ///     presses: A list of Press, or one.
    ///
    /// Returns:
    ///     A list with a PaperAnswer for each press, or a PressError if the network does not accept
    ///     it: a press with a force or a history, several shapes, a shape without a finite surface.
    fn solve<'py>(
        &self,
        py: Python<'py>,
        presses: &Bound<'py, PyAny>,
    ) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let (presses, _) = one_or_many::<Press>("presses", "Press", presses)?;
        let inputs: Vec<_> = presses.iter().map(|press| press.get().inner.clone()).collect();
        let answers = in_pool(py, || self.model.solve(&inputs))?;
        answers.into_iter().map(|found| answer(py, found)).collect()
    }

    /// Solves every frame of one press, in order.
    ///
    /// Returns:
    ///     A list with a PaperAnswer for each frame. It ends early with a PressError at the first
    ///     frame that is not solved.
    fn solve_path<'py>(&self, py: Python<'py>, press: &Press) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let frames = in_pool(py, || self.model.solve_path(&press.inner))?;
        frames.into_iter().map(|frame| answer(py, frame)).collect()
    }

    /// Returns whether displacement, Poisson's ratio and friction of a solution of this network lie
    /// within its training data.
    fn is_in_distribution(&self, py: Python<'_>, answer: &PaperAnswer) -> PyResult<bool> {
        Ok(self.model.is_in_distribution(&vectors(answer.displacement.bind(py))?))
    }
}

impl PaperNetwork {
    fn of(py: Python<'_>, model: Result<paper::PaperNetwork>) -> PyResult<Self> {
        let model = model.map_err(python_error)?;
        let body = SoftBody::from_core(py, model.body().clone())?;
        Ok(Self { model, body: Py::new(py, body)? })
    }
}

/// Converts a solution, or the error in its place.
fn answer(py: Python<'_>, found: Result<paper::PaperAnswer>) -> PyResult<Bound<'_, PyAny>> {
    match found {
        Ok(found) => {
            let rigid = found.rigid.map(|motion| pose(py, &motion));
            let answer = PaperAnswer {
                displacement: array_of_vectors(py, &found.displacement).unbind(),
                von_mises: PyArray1::from_vec(py, found.von_mises).unbind(),
                rigid: rigid.into_py_any(py)?,
                pose: pose(py, &found.pose).into_py_any(py)?,
                seconds: found.seconds,
            };
            Ok(Bound::new(py, answer)?.into_any())
        }
        Err(error) => press_error(py, &error, None),
    }
}
