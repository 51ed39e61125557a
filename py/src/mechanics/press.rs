//! Presses: rigid shapes and their motion.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use numpy::PyArray1;
use pyo3::{IntoPyObjectExt, PyClass, prelude::*, types::PyDict};
use ruffini_core::{
    deformation::{self, Drive},
    geometry,
};

use super::{
    History, Shape, answer,
    arrays::{refused, vector},
};
use crate::error::python_error;

const POSE: &str = "(position (3,), quaternion xyzw (4,))";

/// Press of rigid shapes into one soft body: along a path, or up to a force.
///
/// A pose is (position (3,) in m, unit quaternion (4,) as x, y, z, w): that of a shape in the frame
/// of the body. A frame is a list with one pose for each shape; for a single shape it may be the
/// pose itself.
///
/// Args:
///     shapes: One Shape, or a list of S.
///     path: A list of frames through which the shapes move, or one pose; the first is approached
///         from a place without contact. With `force`, the one frame where the push begins, as
///         `pose`.
///     pose: Frame where the push begins.
///     force: Force of the shapes on the body along `direction` (N), at which the push ends, to
///         within 0.1 %. The shapes keep their positions relative to each other.
///     direction: Direction of the push (3,), of any length.
///     history: History of another press of the same body, model and shapes, from whose end this
///         one continues; it starts from rest if not given.
///
/// Raises:
///     ValueError: If a frame does not fit the shapes, a number is not finite, or a path and a
///         force are given together.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct Press {
    pub(super) inner: deformation::Press,
    pub(super) shapes: Vec<Py<Shape>>,
    /// `true` if a single shape was given without a list; its pose is then returned without a list.
    pub(super) single: bool,
    /// Direction of the push (3,), as it was given.
    direction: Option<[f64; 3]>,
    /// The history from whose end it continues; None if it starts from rest.
    #[pyo3(get)]
    history: Option<Py<History>>,
}

#[pymethods]
impl Press {
    #[new]
    #[pyo3(signature = (shapes, path=None, *, pose=None, force=None, direction=None, history=None))]
    fn new(
        shapes: &Bound<'_, PyAny>,
        path: Option<&Bound<'_, PyAny>>,
        pose: Option<&Bound<'_, PyAny>>,
        force: Option<f64>,
        direction: Option<&Bound<'_, PyAny>>,
        history: Option<Py<History>>,
    ) -> PyResult<Self> {
        let (given, single) = one_or_many::<Shape>("shapes", "Shape", shapes)?;
        let shapes = given.iter().map(|shape| shape.get().inner.clone()).collect();
        let direction = direction.map(|found| vector("direction", found)).transpose()?;
        let press = match (path, pose, force, direction) {
            (Some(path), None, None, None) => deformation::Press::along(shapes, frames(path)?),
            (Some(start), None, Some(force), Some(direction))
            | (None, Some(start), Some(force), Some(direction)) => {
                let start = frame("pose", start)?;
                deformation::Press::with_force(shapes, start, force, direction.into())
            }
            _ => {
                let given = [path.is_some(), pose.is_some(), force.is_some(), direction.is_some()];
                let names = ["path", "pose", "force", "direction"].into_iter().zip(given);
                let found: Vec<_> = names.filter(|(_, given)| *given).map(|(n, _)| n).collect();
                let expected = "a path alone, or a pose with force and direction";
                return Err(refused("press", format!("[{}]", found.join(", ")), expected));
            }
        };
        let press = match &history {
            Some(history) => press.and_then(|press| {
                let press = press.after(history.get().inner.clone())?;
                history.get().inner.check_shapes(press.shapes())?;
                Ok(press)
            }),
            None => press,
        };
        let inner = press.map_err(python_error)?;
        let shapes = given.into_iter().map(Bound::unbind).collect();
        Ok(Self { inner, shapes, single, direction, history })
    }

    /// The shapes: one if it was given without a list, else a list.
    #[getter]
    fn shapes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        as_given(py, self.shapes.iter().map(|shape| shape.clone_ref(py)).collect(), self.single)
    }

    /// List of frames through which the shapes move; None of a press with a force.
    #[getter]
    fn path<'py>(&self, py: Python<'py>) -> PyResult<Option<Vec<Bound<'py, PyAny>>>> {
        let Drive::Translation { path } = self.inner.drive() else { return Ok(None) };
        path.iter()
            .map(|poses| frame_as_given(py, poses, self.single))
            .collect::<PyResult<_>>()
            .map(Some)
    }

    /// Frame where the push begins; None of a press along a path.
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Drive::Force { poses, .. } = self.inner.drive() else { return Ok(None) };
        frame_as_given(py, poses, self.single).map(Some)
    }

    /// Force at which the push ends (N); None of a press along a path.
    #[getter]
    fn force(&self) -> Option<f64> {
        let Drive::Force { force, .. } = self.inner.drive() else { return None };
        Some(*force)
    }

    /// Direction of the push (3,), as it was given; None of a press along a path.
    #[getter]
    fn direction<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.direction.map(|direction| PyArray1::from_slice(py, &direction))
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<Arguments<'py>> {
        let named = PyDict::new(py);
        named.set_item("path", self.path(py)?)?;
        named.set_item("pose", self.pose(py)?)?;
        named.set_item("force", self.force())?;
        named.set_item("direction", self.direction(py))?;
        named.set_item("history", &self.history)?;
        Ok(((self.shapes(py)?,), named))
    }

    fn __repr__(&self) -> String {
        let names: Vec<_> = self.inner.shapes().iter().map(geometry::Shape::name).collect();
        let drive = match self.inner.drive() {
            Drive::Translation { path } => format!("{} frames", path.len()),
            Drive::Force { force, direction, .. } => {
                let [x, y, z] = direction.into_inner().into();
                format!("{force} N along ({x:.3}, {y:.3}, {z:.3})")
            }
        };
        let after = if self.history.is_some() { ", after a history" } else { "" };
        format!("<ruffini.Press of {}, {drive}{after}>", names.join(" and "))
    }
}

impl Press {
    /// Wraps a press along a path of the Rust crate, which begins from rest.
    pub(crate) fn of(py: Python<'_>, inner: deformation::Press) -> PyResult<Self> {
        let shapes = inner.shapes().iter().cloned().map(|inner| Py::new(py, Shape { inner }));
        let shapes: Vec<_> = shapes.collect::<PyResult<_>>()?;
        let single = shapes.len() == 1;
        Ok(Self { inner, shapes, single, direction: None, history: None })
    }
}

/// Arguments of `Press`, by place and by name.
type Arguments<'py> = ((Bound<'py, PyAny>,), Bound<'py, PyDict>);

/// Items of a list and `false`, or a single item given in place of a list and `true`.
pub(super) fn one_or_many<'py, T: PyClass>(
    name: &str,
    kind: &str,
    found: &Bound<'py, PyAny>,
) -> PyResult<(Vec<Bound<'py, T>>, bool)> {
    if let Ok(one) = found.cast::<T>() {
        return Ok((vec![one.clone()], true));
    }
    let wrong = |found: &Bound<'_, PyAny>| {
        refused(name, found.get_type(), format!("ruffini.{kind}, or a list of them"))
    };
    let items = found.try_iter().map_err(|_| wrong(found))?;
    let item = |item: PyResult<Bound<'py, PyAny>>| {
        item?.cast_into::<T>().map_err(|e| wrong(&e.into_inner()))
    };
    Ok((items.map(item).collect::<PyResult<_>>()?, false))
}

/// Reverse of `one_or_many`: a list of the items, or the only one if it was given without a list.
fn as_given<'py, T: IntoPyObject<'py>>(
    py: Python<'py>,
    mut items: Vec<T>,
    single: bool,
) -> PyResult<Bound<'py, PyAny>> {
    match items.pop() {
        Some(one) if single => one.into_bound_py_any(py),
        last => {
            items.extend(last);
            items.into_bound_py_any(py)
        }
    }
}

/// Poses (S) of a frame, in the form that `Press` takes.
pub(super) fn frame_as_given<'py>(
    py: Python<'py>,
    poses: &[Isometry3<f64>],
    single: bool,
) -> PyResult<Bound<'py, PyAny>> {
    as_given(py, poses.iter().map(|pose| answer::pose(py, pose)).collect(), single)
}

/// Poses (F, S) of a list of frames, or of one pose.
fn frames(path: &Bound<'_, PyAny>) -> PyResult<Vec<Vec<Isometry3<f64>>>> {
    if is_pose(path) {
        return Ok(vec![vec![pose("path", path)?]]);
    }
    let expected = format!("a list of poses {POSE}, or of lists of them");
    let frames = path.try_iter().map_err(|_| refused("path", path.get_type(), expected))?;
    frames.enumerate().map(|(i, found)| frame(&format!("path[{i}]"), &found?)).collect()
}

/// Poses (S) of one frame: a list of them, or a single one without a list.
fn frame(name: &str, found: &Bound<'_, PyAny>) -> PyResult<Vec<Isometry3<f64>>> {
    if is_pose(found) {
        return Ok(vec![pose(name, found)?]);
    }
    let wrong = || refused(name, found.get_type(), format!("a pose {POSE}, or a list of them"));
    let poses = found.try_iter().map_err(|_| wrong())?;
    poses.enumerate().map(|(i, found)| pose(&format!("{name}[{i}]"), &found?)).collect()
}

/// Returns whether `found` is a pose and not a list of poses: the first item of its first item is
/// then a number.
fn is_pose(found: &Bound<'_, PyAny>) -> bool {
    let position = found.get_item(0).and_then(|position| position.get_item(0));
    position.is_ok_and(|x| x.extract::<f64>().is_ok())
}

pub(crate) fn pose(name: &str, found: &Bound<'_, PyAny>) -> PyResult<Isometry3<f64>> {
    let (position, quaternion) = found
        .extract::<(Bound<'_, PyAny>, Bound<'_, PyAny>)>()
        .map_err(|_| refused(name, found.get_type(), POSE))?;
    let position: [f64; 3] = vector(&format!("{name}: position"), &position)?;
    let [x, y, z, w] = vector(&format!("{name}: quaternion"), &quaternion)?;
    let quaternion = Quaternion::new(w, x, y, z);
    let norm = quaternion.norm();
    let off = (norm - 1.0).abs();
    if off.is_nan() || off > SINGLE_PRECISION {
        let (found, expected) =
            (format!("length {norm}"), format!("length 1 ± {SINGLE_PRECISION}"));
        return Err(refused(&format!("{name}: quaternion"), found, expected));
    }
    let rotation = if off < DOUBLE_PRECISION {
        UnitQuaternion::new_unchecked(quaternion)
    } else {
        UnitQuaternion::new_normalize(quaternion)
    };
    Ok(Isometry3::from_parts(Translation3::from(position), rotation))
}

/// Largest deviation of a quaternion's length from 1: that of a chain of a thousand rotations in
/// single precision. It is normalised then.
const SINGLE_PRECISION: f64 = 1e-4;
/// Deviation below which it stays as it is, so that a pose that is given again is the same to the bit.
const DOUBLE_PRECISION: f64 = 1e-14;
