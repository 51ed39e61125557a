//! Trained network for pads as a model of presses.

use std::path::PathBuf;

use pyo3::prelude::*;
use ruffini_core::{Result, deformation::Moduli, sensor::Sensor, surrogate};

use super::{
    Deformation, Press, SoftBody,
    body::{nodes_of, pad_error},
    model::{solve, solve_path},
};
use crate::{error::python_error, pool::in_pool};

/// Graph network that corrects a linear solution, to approximate fine finite elements in less time.
///
/// The linear elastic solution is computed first, as by LinearPad, with contact on cells of 1.3 to
/// 0.01 mm; the network adds the effect of large strain, on the mesh of `body`. It was trained on
/// indenters of 0.5 to 40 mm. Without contact the correction is exactly zero.
///
/// An OutsideTrainingWarning tells of a pad whose thickness, sides or radii, or of a gel whose
/// Poisson's ratio, is not between those that the network was trained on. Young's modulus only
/// scales its answers.
///
/// Args:
///     sensor: Name of a sensor, or the path of its .toml file.
///     calibration: Name of the material; the first of the sensor if not given.
///     young: Young's modulus (Pa), in place of the calibration's.
///     poisson: Poisson's ratio, in place of the calibration's.
///     friction: Coefficient of friction; the sensor's at rest if not given.
///
/// Raises:
///     ValueError: If a name is not known, or the network does not fit the sensor's pad.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct Surrogate {
    model: surrogate::Surrogate,
    /// Body, with mesh and material, to which solutions refer.
    #[pyo3(get)]
    body: Py<SoftBody>,
    /// Coefficient of friction.
    #[pyo3(get)]
    friction: f64,
}

/// Linear elastic model of a sensor's pad that resolves small contacts.
///
/// Contact is solved on one of eight grids of cells, of 1.3 to 0.01 mm, chosen by the size of the
/// contact, between which the gel responds as a bonded elastic layer; the influence of the pad's
/// sides is that of finite elements. Displacement and stress are those of these elements under the
/// same forces, on the mesh of `body`. Large strain is neglected. Features smaller than the finest
/// cells are not resolved.
///
/// Args:
///     sensor: Name of a sensor, or the path of its .toml file.
///     calibration: Name of the material; the first of the sensor if not given.
///     young: Young's modulus (Pa), in place of the calibration's.
///     poisson: Poisson's ratio, in place of the calibration's.
///     friction: Coefficient of friction; the sensor's at rest if not given.
///     resolution: Most nodes of the mesh of `body`.
///     contact: "fast": on at most about 96 touching cells, in milliseconds; "fine": on up to 800 and
///         as small as 0.01 mm, in seconds, within some per cent of the limit also under edges.
///
/// Raises:
///     ValueError: If a name is not known, or a number is out of range.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct LinearPad {
    model: surrogate::LinearPad,
    /// Body, with mesh and material, to which solutions refer.
    #[pyo3(get)]
    body: Py<SoftBody>,
    /// Coefficient of friction.
    #[pyo3(get)]
    friction: f64,
}

#[pymethods]
impl LinearPad {
    #[new]
    #[pyo3(signature = (sensor="gelsight-mini", calibration=None, young=None, poisson=None,
        friction=None, resolution=1000, contact="fast"))]
    #[allow(clippy::too_many_arguments)] // Named in Python.
    fn new(
        py: Python<'_>,
        sensor: &str,
        calibration: Option<&str>,
        young: Option<f64>,
        poisson: Option<f64>,
        friction: Option<f64>,
        resolution: i64,
        contact: &str,
    ) -> PyResult<Self> {
        let resolution = nodes_of(resolution)?;
        let gel = CalibratedGel::new(sensor, calibration, [young, poisson, friction]);
        let CalibratedGel { sensor, moduli, friction } = gel.map_err(pad_error)?;
        let model = in_pool(py, || {
            let contact = contact.parse()?;
            surrogate::LinearPad::new(&sensor, moduli, friction, resolution, contact)
        })?;
        let model = model.map_err(pad_error)?;
        let body = SoftBody::from_core(py, model.body().clone())?;
        Ok(Self { model, body: Py::new(py, body)?, friction })
    }

    fn __repr__(&self) -> String {
        format!("<ruffini.LinearPad {}>", self.body.get().about())
    }

    /// Solves each press and returns its last frame, as Fem.solve.
    ///
    /// Args:
    ///     presses: A list of Press, or one.
    ///
    /// Returns:
    ///     A list with a Deformation for each press, or a PressError with the reason if it is not
    ///     solved.
    fn solve<'py>(
        &self,
        py: Python<'py>,
        presses: &Bound<'py, PyAny>,
    ) -> PyResult<Vec<Bound<'py, PyAny>>> {
        solve(py, &self.model, &self.body, presses)
    }

    /// Solves every frame of one press, in order, as Fem.solve_path.
    ///
    /// Returns:
    ///     A list with a Deformation for each frame. It ends early with a PressError at the first
    ///     frame that is not solved.
    fn solve_path<'py>(&self, py: Python<'py>, press: &Press) -> PyResult<Vec<Bound<'py, PyAny>>> {
        solve_path(py, &self.model, &self.body, press)
    }
}

/// Gel to which a network is applied.
pub(super) struct CalibratedGel {
    pub(super) sensor: Sensor,
    pub(super) moduli: Moduli,
    pub(super) friction: f64,
}

#[pymethods]
impl Surrogate {
    #[new]
    #[pyo3(signature = (sensor="gelsight-mini", calibration=None, young=None, poisson=None,
        friction=None))]
    fn new(
        py: Python<'_>,
        sensor: &str,
        calibration: Option<&str>,
        young: Option<f64>,
        poisson: Option<f64>,
        friction: Option<f64>,
    ) -> PyResult<Self> {
        let gel = CalibratedGel::new(sensor, calibration, [young, poisson, friction]);
        let gel = gel.map_err(python_error)?;
        let make = || surrogate::Surrogate::new(&gel.sensor, gel.moduli, gel.friction);
        let model = Self::of(py, in_pool(py, make)?.map_err(python_error)?, gel.friction)?;
        warn(py, None, sensor, calibration, poisson)?;
        Ok(model)
    }

    /// Loads a network of one's own, from weights written by `ruffini network train`.
    ///
    /// Args:
    ///     path: The .safetensors file.
    ///     sensor, calibration, young, poisson, friction: As for Surrogate.
    ///
    /// Raises:
    ///     FileNotFoundError: If there is no such file.
    ///     ValueError: If the file is damaged or of another kind of network.
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
        let gel = CalibratedGel::new(sensor, calibration, [young, poisson, friction]);
        let gel = gel.map_err(python_error)?;
        let make = || surrogate::Surrogate::load(&path, &gel.sensor, gel.moduli, gel.friction);
        let model = Self::of(py, in_pool(py, make)?.map_err(python_error)?, gel.friction)?;
        warn(py, Some(model.card()), sensor, calibration, poisson)?;
        Ok(model)
    }

    fn __repr__(&self) -> String {
        format!("<ruffini.Surrogate {}>", self.body.get().about())
    }

    /// Same network evaluated by Candle's layers, the reference for the fast implementation:
    /// slower, with the same solutions up to rounding.
    fn plain(&self, py: Python<'_>) -> Self {
        let body = self.body.clone_ref(py);
        Self { model: self.model.plain(), body, friction: self.friction }
    }

    /// Description of the weights as JSON: form, training, data, errors on unseen data.
    #[getter]
    fn card(&self) -> String {
        serde_json::to_string(self.model.card()).expect("plain data")
    }

    /// Solves each press and returns its last frame, as Fem.solve.
    ///
    /// Args:
    ///     presses: A list of Press, or one.
    ///
    /// Returns:
    ///     A list with a Deformation for each press, or a PressError with the reason if it is not
    ///     solved. `residual` is the residual force with the elements of `body`'s own coarse mesh;
    ///     it is not zero even for the exact solution.
    fn solve<'py>(
        &self,
        py: Python<'py>,
        presses: &Bound<'py, PyAny>,
    ) -> PyResult<Vec<Bound<'py, PyAny>>> {
        solve(py, &self.model, &self.body, presses)
    }

    /// Solves every frame of one press, in order, as Fem.solve_path.
    ///
    /// Returns:
    ///     A list with a Deformation for each frame. It ends early with a PressError at the first
    ///     frame that is not solved.
    fn solve_path<'py>(&self, py: Python<'py>, press: &Press) -> PyResult<Vec<Bound<'py, PyAny>>> {
        solve_path(py, &self.model, &self.body, press)
    }

    /// Returns whether a solution of this network is like its training data.
    ///
    /// Poisson's ratio and friction must lie within those of the data, displacement, net force and
    /// number of force-bearing nodes within the bounds of most of the data (`usual` in the card),
    /// and the residual may be at most half of the net force. Without contact force, the skin must
    /// not overlap a shape. A solution with a smaller force or fewer nodes than usual may still be
    /// accurate.
    fn is_in_distribution(&self, answer: &Deformation) -> bool {
        let shapes: Vec<_> = answer.shapes.iter().map(|shape| shape.get().inner.clone()).collect();
        let found = &answer.inner;
        let (moved, forces) = (&found.displacement, &found.contact_force);
        self.model.is_in_distribution(&shapes, &found.poses, moved, forces, found.residual)
    }
}

impl Surrogate {
    fn of(py: Python<'_>, model: surrogate::Surrogate, friction: f64) -> PyResult<Self> {
        let body = SoftBody::from_core(py, model.body().clone())?;
        Ok(Self { model, body: Py::new(py, body)?, friction })
    }
}

/// Warns in Python if a gel is unlike those that the network of this card, or the shipped one, was
/// trained on.
fn warn(
    py: Python<'_>,
    card: Option<String>,
    sensor: &str,
    calibration: Option<&str>,
    poisson: Option<f64>,
) -> PyResult<()> {
    let trained = py.import("ruffini._trained_gels")?;
    trained.call_method1("warn", (card, sensor, calibration, poisson))?;
    Ok(())
}

impl CalibratedGel {
    pub(super) fn new(
        name: &str,
        calibration: Option<&str>,
        [young, poisson, friction]: [Option<f64>; 3],
    ) -> Result<Self> {
        let sensor = Sensor::open(name)?;
        let known = sensor.calibration(calibration)?;
        let moduli = Moduli {
            young: young.unwrap_or(known.young),
            poisson: poisson.unwrap_or(known.poisson),
        };
        Ok(Self { moduli, friction: friction.unwrap_or(sensor.friction.coefficient), sensor })
    }
}
