//! Rigid objects held between two soft pads.

use nalgebra::{Isometry3, Vector3};
use numpy::PyArray1;
use pyo3::{IntoPyObjectExt, prelude::*};
use ruffini_core::{Result, deformation::Wrench, fem};

use super::{
    Deformation, Fem, Shape,
    answer::{self, Pose},
    arrays::{refused, vector},
    press,
};
use crate::{error::press_error, pool::in_pool};

const PAIR: &str = "poses of two pads, each (position (3,), quaternion xyzw (4,))";

/// Grasp of a free rigid object by two soft pads; the pose of the object is solved for.
///
/// Poses are (position (3,) in m, unit quaternion (4,) as x, y, z, w) in the frame of the world.
/// Only the pads and the load act on the object, so with a load the pads must touch it in the first
/// frame.
///
/// Args:
///     object: The object.
///     path: Poses of the left and the right pad, a pair for each of F frames. Points in contact in
///         the first frame stick where they are.
///     start: Pose of the object where the grasp begins; the origin of the world if not given.
///     load: Further load on the object (6,), such as its weight: force (N) and torque about the
///         origin of the object (N m), in the frame of the world; zero if not given.
///
/// Raises:
///     ValueError: If there is no frame, or a pose or the load is not valid.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct Grasp {
    inner: fem::Grasp,
}

#[pymethods]
impl Grasp {
    #[new]
    #[pyo3(signature = (object, path, start=None, load=None))]
    fn new(
        object: &Shape,
        path: &Bound<'_, PyAny>,
        start: Option<&Bound<'_, PyAny>>,
        load: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let object = object.inner.clone();
        let start = start.map_or(Ok(Isometry3::identity()), |found| press::pose("start", found))?;
        let load = load.map_or(Ok(Wrench::default()), wrench)?;
        let path = frames(path)?;
        if path.is_empty() {
            return Err(refused("path", "no frames", "at least one"));
        }
        Ok(Self { inner: fem::Grasp { object, start, path, load } })
    }

    /// Solves every frame, in order, on one thread; other Python threads run meanwhile.
    ///
    /// Args:
    ///     pads: The models of the left and the right pad, which may be the same.
    ///
    /// Returns:
    ///     A list with a Grasped for each frame of the path. It ends early with a PressError at the
    ///     first frame that is not solved.
    #[allow(clippy::needless_pass_by_value)] // What pyo3 extracts is owned.
    fn solve<'py>(
        &self,
        py: Python<'py>,
        pads: [Bound<'py, Fem>; 2],
    ) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let models = pads.each_ref().map(|pad| &pad.get().model);
        let frames = in_pool(py, || self.inner.solve(models))?;
        frames.into_iter().map(|frame| slot(py, frame)).collect()
    }

    /// The object.
    #[getter]
    fn object(&self) -> Shape {
        Shape { inner: self.inner.object.clone() }
    }

    /// Poses of the left and the right pad, a pair for each frame.
    #[getter]
    fn path<'py>(&self, py: Python<'py>) -> Vec<(Pose<'py>, Pose<'py>)> {
        let pair =
            |[left, right]: &[Isometry3<f64>; 2]| (answer::pose(py, left), answer::pose(py, right));
        self.inner.path.iter().map(pair).collect()
    }

    /// Pose of the object where the grasp begins.
    #[getter]
    fn start<'py>(&self, py: Python<'py>) -> Pose<'py> {
        answer::pose(py, &self.inner.start)
    }

    /// Further load on the object (6,) in N and N m.
    #[getter]
    fn load<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let Wrench { force, torque } = &self.inner.load;
        PyArray1::from_iter(py, force.iter().chain(torque).copied())
    }

    fn __getnewargs__<'py>(&self, py: Python<'py>) -> Arguments<'py> {
        (self.object(), self.path(py), self.start(py), self.load(py))
    }

    fn __repr__(&self) -> String {
        format!("<ruffini.Grasp of {}, {} frames>", self.inner.object.name(), self.inner.path.len())
    }
}

/// Arguments of `Grasp`.
type Arguments<'py> = (Shape, Vec<(Pose<'py>, Pose<'py>)>, Pose<'py>, Bound<'py, PyArray1<f64>>);

/// One frame of a `Grasp`: object and pads in equilibrium.
#[pyclass(frozen, get_all, module = "ruffini")]
pub(crate) struct Grasped {
    /// The deformations of the left and the right pad, each in the frame of its pad, with the pose
    /// of the object there.
    pads: (Py<Deformation>, Py<Deformation>),
    /// Pose of the object in the world: position (3,) in m, quaternion (4,) xyzw.
    object: Py<PyAny>,
    /// Residual force on the object (N); torque counts divided by the object's size.
    residual: f64,
    /// Wall time (s).
    seconds: f64,
}

#[pymethods]
impl Grasped {
    /// Restores a frame from its fields, as they are pickled.
    #[staticmethod]
    fn _restore(fields: Fields) -> Self {
        let (pads, object, residual, seconds) = fields;
        Self { pads, object, residual, seconds }
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Fields,))> {
        let pads = (self.pads.0.clone_ref(py), self.pads.1.clone_ref(py));
        let fields = (pads, self.object.clone_ref(py), self.residual, self.seconds);
        Ok((py.get_type::<Self>().getattr("_restore")?, (fields,)))
    }

    fn __repr__(&self) -> String {
        let Self { residual, seconds, .. } = self;
        format!("<ruffini.Grasped residual {residual:.1e} N, {seconds:.2} s>")
    }
}

/// Fields of a `Grasped`, in order.
type Fields = ((Py<Deformation>, Py<Deformation>), Py<PyAny>, f64, f64);

/// Converts a frame, or the error in its place.
fn slot(py: Python<'_>, frame: Result<fem::Grasped>) -> PyResult<Bound<'_, PyAny>> {
    let fem::Grasped { pads: [left, right], object, residual, seconds } = match frame {
        Ok(grasped) => grasped,
        Err(error) => return press_error(py, &error, None),
    };
    let pad = |found| Py::new(py, Deformation::of(found, Vec::new(), true, None));
    let pads = (pad(left)?, pad(right)?);
    let object = answer::pose(py, &object).into_py_any(py)?;
    Ok(Bound::new(py, Grasped { pads, object, residual, seconds })?.into_any())
}

fn wrench(found: &Bound<'_, PyAny>) -> PyResult<Wrench> {
    let [fx, fy, fz, tx, ty, tz] = vector("load", found)?;
    Ok(Wrench { force: Vector3::new(fx, fy, fz), torque: Vector3::new(tx, ty, tz) })
}

/// Poses of two pads (F, 2).
fn frames(path: &Bound<'_, PyAny>) -> PyResult<Vec<[Isometry3<f64>; 2]>> {
    let wrong = |_| refused("path", path.get_type(), format!("a list of {PAIR}"));
    let frames = path.try_iter().map_err(wrong)?;
    frames.enumerate().map(|(i, found)| pair(&format!("path[{i}]"), &found?)).collect()
}

fn pair(name: &str, found: &Bound<'_, PyAny>) -> PyResult<[Isometry3<f64>; 2]> {
    let (left, right) = found
        .extract::<(Bound<'_, PyAny>, Bound<'_, PyAny>)>()
        .map_err(|_| refused(name, found.get_type(), PAIR))?;
    Ok([press::pose(&format!("{name}[0]"), &left)?, press::pose(&format!("{name}[1]"), &right)?])
}
