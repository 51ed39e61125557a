//! Python classes of deformations and histories.

use nalgebra::{Isometry3, Vector3};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::{
    prelude::*,
    types::{PyBytes, PyType},
};
use ruffini_core::deformation::{self, PredictedError, Wrench};

use super::{
    Shape,
    arrays::{array_of_vectors, vectors},
    press,
};
use crate::error::python_error;

/// Equilibrium of a soft body with the shapes that press it, in the frame of the body.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct Deformation {
    /// Displacement of the nodes (V, 3) in m.
    #[pyo3(get)]
    pub(super) displacement: Py<PyArray2<f64>>,
    /// Von Mises equivalent of the Cauchy stress in the tetrahedra (T,) in Pa.
    #[pyo3(get)]
    von_mises: Py<PyArray1<f64>>,
    /// Contact force on the nodes (V, 3) in N.
    #[pyo3(get)]
    pub(super) contact_force: Py<PyArray2<f64>>,
    /// Force (N) and torque about the origin (N m) of all contact on the body (6,).
    #[pyo3(get)]
    wrench: Py<PyArray1<f64>>,
    /// Share of the normal force that the sliding part of the contact bears.
    #[pyo3(get)]
    sliding: f64,
    /// Poses of the shapes, in the form that `Press` takes: one pose (position (3,), quaternion
    /// (4,) xyzw) if a single shape was given without a list, else a list with one for each shape.
    #[pyo3(get)]
    pose: Py<PyAny>,
    /// State from which another press can continue.
    #[pyo3(get)]
    pub(super) history: Py<History>,
    /// Newton steps, or sweeps of Gauss-Seidel, since the last frame.
    #[pyo3(get)]
    iterations: usize,
    /// Norm of the residual force (N); 0 with `LinearPad`, which leaves it out.
    #[pyo3(get)]
    pub(super) residual: f64,
    /// Wall time (s).
    #[pyo3(get)]
    seconds: f64,
    /// Relative errors against fine finite elements that 19 of 20 answers like this one stay below:
    /// displacement, stress and net force; None for models that do not predict their errors.
    #[pyo3(get)]
    predicted_error: Option<(f64, f64, f64)>,
    /// Shapes that pressed, for [`Surrogate::is_in_distribution`](super::surrogate::Surrogate).
    pub(super) shapes: Vec<Py<Shape>>,
    /// Hash of the body's mesh, if it is known.
    pub(super) mesh_hash: Option<u64>,
}

impl Deformation {
    /// The solution in the Rust crate.
    pub(super) fn to_core(&self, py: Python<'_>) -> PyResult<deformation::Deformation> {
        let numbers = |array: &Py<PyArray1<f64>>| array.bind(py).to_vec();
        let of = |array: &Py<PyArray2<f64>>| vectors(array.bind(py));
        let wrench = numbers(&self.wrench)?;
        let vector = |from: usize| Vector3::from_column_slice(&wrench[from..from + 3]);
        let history = self.history.get().inner.clone();
        Ok(deformation::Deformation {
            displacement: of(&self.displacement)?,
            von_mises: numbers(&self.von_mises)?,
            contact_force: of(&self.contact_force)?,
            wrench: Wrench { force: vector(0), torque: vector(3) },
            sliding: self.sliding,
            poses: history.poses.clone(),
            history,
            iterations: self.iterations,
            residual: self.residual,
            seconds: self.seconds,
            predicted_error: self.predicted_error.map(|(displacement, stress, force)| {
                PredictedError { displacement, stress, force }
            }),
        })
    }

    /// Converts the solution of a press by `shapes`; with `single`, the pose of the only shape is
    /// not put in a list.
    pub(super) fn of(
        py: Python<'_>,
        answer: deformation::Deformation,
        shapes: Vec<Py<Shape>>,
        single: bool,
        mesh_hash: Option<u64>,
    ) -> PyResult<Self> {
        let wrench = answer.wrench.force.iter().chain(answer.wrench.torque.iter());
        let pose = press::frame_as_given(py, &answer.poses, single)?.unbind();
        let error = answer.predicted_error;
        Ok(Self {
            displacement: array_of_vectors(py, &answer.displacement).unbind(),
            contact_force: array_of_vectors(py, &answer.contact_force).unbind(),
            wrench: PyArray1::from_vec(py, wrench.copied().collect()).unbind(),
            von_mises: PyArray1::from_vec(py, answer.von_mises).unbind(),
            sliding: answer.sliding,
            pose,
            history: Py::new(py, History { inner: answer.history })?,
            iterations: answer.iterations,
            residual: answer.residual,
            seconds: answer.seconds,
            predicted_error: error.map(|e| (e.displacement, e.stress, e.force)),
            shapes,
            mesh_hash,
        })
    }
}

/// Fields of a `Deformation`, in order.
type Fields = (
    Py<PyArray2<f64>>,
    Py<PyArray1<f64>>,
    Py<PyArray2<f64>>,
    Py<PyArray1<f64>>,
    f64,
    Py<PyAny>,
    Py<History>,
    usize,
    f64,
    f64,
    Option<(f64, f64, f64)>,
    (Vec<Py<Shape>>, Option<u64>),
);

/// Position (3,) and quaternion (4,).
pub(super) type Pose<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

/// Converts a pose.
pub(super) fn pose<'py>(py: Python<'py>, pose: &Isometry3<f64>) -> Pose<'py> {
    let position = pose.translation.vector.as_slice().to_vec();
    (
        PyArray1::from_vec(py, position),
        PyArray1::from_vec(py, pose.rotation.coords.as_slice().to_vec()),
    )
}

#[pymethods]
impl Deformation {
    /// Restores an answer from its fields, as they are pickled.
    #[staticmethod]
    fn _restore(fields: Fields) -> Self {
        let (
            displacement,
            von_mises,
            contact_force,
            wrench,
            sliding,
            pose,
            history,
            iterations,
            residual,
            seconds,
            predicted_error,
            (shapes, mesh_hash),
        ) = fields;
        Self {
            displacement,
            von_mises,
            contact_force,
            wrench,
            sliding,
            pose,
            history,
            iterations,
            residual,
            seconds,
            predicted_error,
            shapes,
            mesh_hash,
        }
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Fields,))> {
        let fields = (
            self.displacement.clone_ref(py),
            self.von_mises.clone_ref(py),
            self.contact_force.clone_ref(py),
            self.wrench.clone_ref(py),
            self.sliding,
            self.pose.clone_ref(py),
            self.history.clone_ref(py),
            self.iterations,
            self.residual,
            self.seconds,
            self.predicted_error,
            (self.shapes.iter().map(|shape| shape.clone_ref(py)).collect(), self.mesh_hash),
        );
        Ok((py.get_type::<Self>().getattr("_restore")?, (fields,)))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let wrench = self.wrench.bind(py).call_method0("tolist")?.extract::<Vec<f64>>()?;
        let [x, y, z] = [0, 1, 2].map(|i| wrench[i]);
        let (iterations, residual) = (self.iterations, self.residual);
        Ok(format!(
            "<ruffini.Deformation force ({x:.4}, {y:.4}, {z:.4}) N, {iterations} iterations, \
             residual {residual:.1e} N>"
        ))
    }
}

/// State at the end of a press: displacement of the nodes, poses of the shapes, points that stick.
///
/// Another `Press` of the same body, model and shapes continues from it. It can be pickled and is
/// the same on every machine.
///
/// Args:
///     state: Bytes from `bytes(history)`.
///
/// Raises:
///     ValueError: If the bytes are not those of a history.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct History {
    pub(super) inner: deformation::History,
}

#[pymethods]
impl History {
    #[new]
    fn new(state: &[u8]) -> PyResult<Self> {
        let inner = deformation::History::from_bytes(state).map_err(python_error)?;
        Ok(Self { inner })
    }

    fn __repr__(&self) -> String {
        let (nodes, sticking) = (self.inner.displacement.len(), self.inner.anchors.len());
        format!("<ruffini.History of {nodes} nodes, {sticking} points in contact>")
    }

    fn __bytes__<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.inner.to_bytes())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> (Bound<'py, PyType>, (Bound<'py, PyBytes>,)) {
        (py.get_type::<Self>(), (self.__bytes__(py),))
    }
}
