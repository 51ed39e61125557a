//! Presses: rigid shapes and their motion.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use pyo3::{PyClass, prelude::*};
use ruffini_core::deformation;

use super::{
    History, Shape,
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
///     path: A list of frames through which the shapes move; the first is approached from a place
///         without contact. With `force`, the one frame where the push begins, as `pose`.
///     pose: Frame where the push begins.
///     force: Force of the shapes on the body along `direction` (N), at which the push ends. The
///         shapes keep their positions relative to each other.
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
    /// `true` if a single shape was given without a list; its pose is then returned without a list.
    pub(super) single: bool,
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
        history: Option<&History>,
    ) -> PyResult<Self> {
        let (shapes, single) = one_or_many::<Shape>("shapes", "Shape", shapes)?;
        let shapes = shapes.iter().map(|shape| shape.get().inner.clone()).collect();
        let press = match (path, pose, force, direction) {
            (Some(path), None, None, None) => deformation::Press::along(shapes, frames(path)?),
            (Some(start), None, Some(force), Some(direction))
            | (None, Some(start), Some(force), Some(direction)) => {
                let direction = vector("direction", direction)?.into();
                deformation::Press::with_force(shapes, frame("pose", start)?, force, direction)
            }
            _ => {
                let given = [path.is_some(), pose.is_some(), force.is_some(), direction.is_some()];
                let names = ["path", "pose", "force", "direction"].into_iter().zip(given);
                let found: Vec<_> = names.filter(|(_, given)| *given).map(|(n, _)| n).collect();
                let expected = "a path alone, or a pose with force and direction";
                return Err(refused("press", format!("[{}]", found.join(", ")), expected));
            }
        };
        let press = match history {
            Some(history) => press.and_then(|press| press.after(history.inner.clone())),
            None => press,
        };
        Ok(Self { inner: press.map_err(python_error)?, single })
    }
}

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

/// Poses (F, S) of a list of frames.
fn frames(path: &Bound<'_, PyAny>) -> PyResult<Vec<Vec<Isometry3<f64>>>> {
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
    if (norm - 1.0).abs() > ROUNDING {
        let found = format!("length {norm}");
        return Err(refused(&format!("{name}: quaternion"), found, "length 1"));
    }
    let rotation = UnitQuaternion::new_normalize(quaternion);
    Ok(Isometry3::from_parts(Translation3::from(position), rotation))
}

/// Largest deviation of a quaternion's length from 1, which allows for single precision.
const ROUNDING: f64 = 1e-6;
