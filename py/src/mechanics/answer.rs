//! Python classes of deformations and histories.

use nalgebra::Isometry3;
use numpy::{PyArray1, PyArray2};
use pyo3::{
    prelude::*,
    sync::PyOnceLock,
    types::{PyBytes, PyType},
};
use ruffini_core::deformation::{self, Wrench};

use super::{
    Shape,
    arrays::{array_of_vectors, read_only},
    press,
};
use crate::error::python_error;

/// Equilibrium of a soft body with the shapes that press it, in the frame of the body.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct Deformation {
    pub(super) inner: deformation::Deformation,
    /// Shapes that pressed.
    pub(super) shapes: Vec<Py<Shape>>,
    /// Hash of the body's mesh, if it is known.
    pub(super) mesh_hash: Option<u64>,
    /// Whether the pose of the only shape stands alone and in no list.
    single: bool,
    displacement: Lazy<PyArray2<f64>>,
    von_mises: Lazy<PyArray1<f64>>,
    contact_force: Lazy<PyArray2<f64>>,
}

/// Array that is made when it is first asked for, and is read-only.
type Lazy<A> = PyOnceLock<Py<A>>;

impl Deformation {
    /// Converts the solution of a press by `shapes`; with `single`, the pose of the only shape is
    /// not put in a list.
    pub(super) fn of(
        inner: deformation::Deformation,
        shapes: Vec<Py<Shape>>,
        single: bool,
        mesh_hash: Option<u64>,
    ) -> Self {
        let [displacement, contact_force] = [Lazy::new(), Lazy::new()];
        let von_mises = Lazy::new();
        Self { inner, shapes, mesh_hash, single, displacement, von_mises, contact_force }
    }
}

/// What restores a [`Deformation`], and with what.
type Reduced<'py> = (Bound<'py, PyAny>, (Bound<'py, PyBytes>, Vec<Py<Shape>>, bool, Option<u64>));

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
    /// Displacement of the nodes (V, 3) in m.
    #[getter]
    fn displacement(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        let make = || read_only(array_of_vectors(py, &self.inner.displacement));
        Ok(self.displacement.get_or_try_init(py, make)?.clone_ref(py))
    }

    /// Von Mises equivalent of the Cauchy stress in the tetrahedra (T,) in Pa.
    #[getter]
    fn von_mises(&self, py: Python<'_>) -> PyResult<Py<PyArray1<f64>>> {
        let make = || read_only(PyArray1::from_slice(py, &self.inner.von_mises));
        Ok(self.von_mises.get_or_try_init(py, make)?.clone_ref(py))
    }

    /// Contact force on the nodes (V, 3) in N.
    #[getter]
    fn contact_force(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        let make = || read_only(array_of_vectors(py, &self.inner.contact_force));
        Ok(self.contact_force.get_or_try_init(py, make)?.clone_ref(py))
    }

    /// Force (N) and torque about the origin (N m) of all contact on the body (6,).
    #[getter]
    fn wrench<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let Wrench { force, torque } = &self.inner.wrench;
        PyArray1::from_iter(py, force.iter().chain(torque).copied())
    }

    /// Share of the normal force that the sliding part of the contact bears.
    #[getter]
    fn sliding(&self) -> f64 {
        self.inner.sliding
    }

    /// Poses of the shapes, in the form that `Press` takes: one pose (position (3,), quaternion
    /// (4,) xyzw) if a single shape was given without a list, else a list with one for each shape.
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        press::frame_as_given(py, &self.inner.poses, self.single)
    }

    /// State from which another press can continue.
    #[getter]
    fn history(&self) -> History {
        History { inner: self.inner.history.clone() }
    }

    /// Newton steps, or sweeps of Gauss-Seidel, since the last frame.
    #[getter]
    fn iterations(&self) -> usize {
        self.inner.iterations
    }

    /// Norm of the residual force (N); 0 with `LinearPad`, which leaves it out.
    #[getter]
    fn residual(&self) -> f64 {
        self.inner.residual
    }

    /// Wall time (s).
    #[getter]
    fn seconds(&self) -> f64 {
        self.inner.seconds
    }

    /// Relative errors against fine finite elements that 19 of 20 answers like this one stay below:
    /// displacement, stress and net force; None for models that do not predict their errors.
    #[getter]
    fn predicted_error(&self) -> Option<(f64, f64, f64)> {
        self.inner.predicted_error.map(|e| (e.displacement, e.stress, e.force))
    }

    /// Restores an answer as it is pickled.
    #[staticmethod]
    fn _restore(
        state: &[u8],
        shapes: Vec<Py<Shape>>,
        single: bool,
        mesh_hash: Option<u64>,
    ) -> PyResult<Self> {
        let inner = deformation::Deformation::from_bytes(state).map_err(python_error)?;
        Ok(Self::of(inner, shapes, single, mesh_hash))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py>> {
        let state = PyBytes::new(py, &self.inner.to_bytes());
        let shapes = self.shapes.iter().map(|shape| shape.clone_ref(py)).collect();
        let restore = py.get_type::<Self>().getattr("_restore")?;
        Ok((restore, (state, shapes, self.single, self.mesh_hash)))
    }

    fn __repr__(&self) -> String {
        let [x, y, z] = self.inner.wrench.force.into();
        let (iterations, residual) = (self.inner.iterations, self.inner.residual);
        format!(
            "<ruffini.Deformation force ({x:.4}, {y:.4}, {z:.4}) N, {iterations} iterations, \
             residual {residual:.1e} N>"
        )
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
