//! Tactile channels of a pad's answers.

use nalgebra::{Point3, Vector3};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods};
use pyo3::{
    prelude::*,
    types::{PyDict, PyList},
};
use ruffini_core::{
    sensor::Sensor,
    tactile::{self, Channel, Resolution},
};

use super::{Deformation, SoftBody, arrays::refused};
use crate::error::python_error;

/// What a sensor reports of an answer: the channels of the environments, for presses of one's own.
///
/// Args:
///     body: The pad, as of Surrogate.body, LinearPad.body or `ruffini.sensor`.
///     sensor: Name of the sensor, or the path of its .toml file, for its markers and its camera.
///     resolution: Counts across and along by name: "markers", "grid" (of stress and traction),
///         "depth", "image". Those left out are as in the environments.
///
/// Raises:
///     ValueError: If the body is no pad of this sensor, or a count is out of range.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct Skin {
    inner: tactile::Skin,
    nodes: usize,
    tets: usize,
    mesh_hash: u64,
    sensor: String,
}

#[pymethods]
impl Skin {
    #[new]
    #[pyo3(signature = (body, sensor="gelsight-mini", resolution=None))]
    fn new(
        py: Python<'_>,
        body: &SoftBody,
        sensor: &str,
        resolution: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let resolution = match resolution {
            Some(given) => {
                if given.contains("nodes")? {
                    return Err(refused("resolution", "nodes", "none: they are the body's"));
                }
                let named = PyDict::new(py);
                named.set_item("default", py.import("ruffini._settings")?.getattr("plain")?)?;
                let text = py.import("json")?.call_method("dumps", (given,), Some(&named));
                let text: String = text
                    .and_then(|text| text.extract())
                    .map_err(|_| refused("resolution", given, "counts across and along by name"))?;
                serde_json::from_str(&text).map_err(|error| {
                    let expected = format!("counts across and along by name ({error})");
                    refused("resolution", text, expected)
                })?
            }
            None => Resolution::default(),
        };
        resolution.validate().map_err(python_error)?;
        let make = || {
            let file = Sensor::open(sensor)?;
            tactile::Skin::new(&body.inner, &file, &resolution)
        };
        let inner = py.detach(make).map_err(python_error)?;
        let mesh = body.inner.mesh();
        let (nodes, tets) = (mesh.vertices.len(), mesh.tets.len());
        Ok(Self { inner, nodes, tets, mesh_hash: body.mesh_hash, sensor: sensor.to_owned() })
    }

    /// Reads a channel.
    ///
    /// Args:
    ///     channel: Name, as in the environments: "markers", "stress", "wrench", "image", ...
    ///     answer: A Deformation of the body; without one, the pad is at rest.
    ///
    /// Returns:
    ///     Numbers in the shape of the channel of one finger, in SI units.
    ///
    /// Raises:
    ///     ValueError: If the channel is not known, the sensor has no such channel, or the answer is of
    ///         another mesh.
    ///     PressError: If `answer` is a PressError.
    #[pyo3(signature = (channel, answer=None))]
    fn read<'py>(
        &self,
        py: Python<'py>,
        channel: &str,
        answer: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let Some(known) = Channel::named(channel) else {
            let names = Channel::ALL.map(Channel::name).join(", ");
            return Err(refused("channel", channel, format!("one of {names}")));
        };
        if known == Channel::Image && !self.inner.has_image() {
            return Err(refused("channel", channel, "another: the sensor's colours are not known"));
        }
        let answer = answer.map(|answer| self.checked(answer)).transpose()?.map(Bound::get);
        let predicts = |answer: &Deformation| {
            let Deformation { inner, .. } = answer;
            inner.predicted_error.is_some() || inner.wrench.force == Vector3::zeros()
        };
        if known == Channel::PredictedError && !answer.is_none_or(predicts) {
            return Err(refused("channel", channel, "another: the answer's model predicts none"));
        }
        let entries = py.detach(|| {
            let shapes = answer.map_or(&[][..], |answer| &answer.shapes).iter();
            let shapes: Vec<_> = shapes.map(|shape| &shape.get().inner).collect();
            known.read(&self.inner, answer.map(|answer| &answer.inner), &shapes)
        });
        let shape = match &known.specs(&self.inner)[..] {
            [spec] => spec.shape.clone(),
            _ => vec![entries.len()],
        };
        PyArray1::from_vec(py, entries).reshape(shape)
    }

    /// Places at rest in m, as of an environment's `skin()`: of the `markers` and nodes of the free
    /// `surface` (N, 3), and in plan of the cells of the `grid` (`traction`), of the pixels of
    /// `depth` and of those of the `image` (N, 2). Across (x) runs fastest, as in the channels,
    /// whose rows and columns `reshape` brings back.
    #[getter]
    fn places<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        places(py, &self.inner)
    }

    fn __repr__(&self) -> String {
        format!("<ruffini.Skin of {}, {} nodes>", self.sensor, self.nodes)
    }
}

impl Skin {
    /// The answer, or its error, or the error that it is of another body.
    fn checked<'a, 'py>(
        &self,
        answer: &'a Bound<'py, PyAny>,
    ) -> PyResult<&'a Bound<'py, Deformation>> {
        if answer.is_instance_of::<crate::PressError>() {
            return Err(PyErr::from_value(answer.clone()));
        }
        let Ok(answer) = answer.cast::<Deformation>() else {
            let kind = answer.get_type().name().map_or_else(|_| "?".into(), |n| n.to_string());
            let list = if answer.is_instance_of::<PyList>() { "; one of the list" } else { "" };
            return Err(refused("answer", kind, format!("a Deformation{list}")));
        };
        let found = &answer.get().inner;
        let sizes = [&found.displacement, &found.contact_force].map(Vec::len);
        if sizes != [self.nodes; 2] || found.von_mises.len() != self.tets {
            let expected = format!("{} and {}, the body's", self.nodes, self.tets);
            let found = format!("{} nodes and {} tetrahedra", sizes[0], found.von_mises.len());
            return Err(refused("answer", found, expected));
        }
        if answer.get().mesh_hash.is_some_and(|hash| hash != self.mesh_hash) {
            let expected = "one on the mesh of this skin's body";
            return Err(refused("answer", "one on another mesh", expected));
        }
        Ok(answer)
    }
}

/// Places of markers and free surface nodes (…, 3), and in plan of cells and pixels (…, 2), in m.
pub(crate) fn places<'py>(py: Python<'py>, skin: &tactile::Skin) -> PyResult<Bound<'py, PyDict>> {
    let points = |points: Vec<Point3<f64>>| {
        let count = points.len();
        let numbers = points.iter().flat_map(|p| p.coords.iter().copied());
        PyArray1::from_iter(py, numbers).reshape([count, 3])
    };
    let plan = |places: Vec<[f64; 2]>| {
        let count = places.len();
        PyArray1::from_iter(py, places.into_flattened()).reshape([count, 2])
    };
    let dict = PyDict::new(py);
    dict.set_item("markers", points(skin.markers())?)?;
    dict.set_item("surface", points(skin.surface())?)?;
    dict.set_item("grid", plan(skin.cells())?)?;
    dict.set_item("depth", plan(skin.pixels())?)?;
    dict.set_item("image", plan(skin.image_pixels())?)?;
    Ok(dict)
}
