//! Soft bodies, and the gel pads of known sensors.

use std::hash::{DefaultHasher, Hash, Hasher};

use nalgebra::Point3;
use numpy::PyArray1;
use pyo3::{IntoPyObjectExt, prelude::*};
use ruffini_core::{
    Error, Result,
    deformation::{self, Law, Moduli},
    sensor::Sensor,
};

use super::{
    Press, TetMesh,
    arrays::{count, indices, numbers, read_only, refused, rows},
};
use crate::error::python_error;

/// Default number of nodes of a sensor's pad.
const RESOLUTION: usize = 2000;

/// Meshed elastic solid in its own frame, with some nodes held fixed.
///
/// Args:
///     mesh: The undeformed solid.
///     young: Young's modulus E (Pa): one number, or one for each tetrahedron (T,).
///     poisson: Poisson's ratio, from 0 to just under 0.5.
///     law: Energy density of the material (F deformation gradient, J = det F, I1 = tr F^T F, mu
///         and lambda Lame's parameters):
///         "neo-hookean" mu/2 (I1 - 3) - mu ln J + lambda/2 (ln J)^2;
///         "stable-neo-hookean" mu/2 (I1 - 3) - mu (J - 1) + (lambda + mu)/2 (J - 1)^2;
///         "corotated" mu |F - R|^2 + lambda/2 (J - 1)^2, R the rotation nearest to F;
///         "linear" mu e:e + lambda/2 (tr e)^2, e = sym(F - 1): small strains and rotations only.
///     fixed: Nodes that never move, counted from 0, or booleans (V,) that are true for them; the body
///         is free if there are none.
///
/// Raises:
///     ValueError: If a modulus, the law or a node is not valid.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct SoftBody {
    pub(super) inner: deformation::SoftBody,
    /// The undeformed mesh.
    #[pyo3(get)]
    mesh: Py<TetMesh>,
    /// Nodes that never move, ascending, read-only.
    #[pyo3(get)]
    fixed: Py<PyArray1<u32>>,
    /// Hash of the mesh, by which its answers are known.
    pub(super) mesh_hash: u64,
}

#[pymethods]
impl SoftBody {
    #[new]
    #[pyo3(signature = (mesh, young, poisson, law="neo-hookean", fixed=None))]
    fn new(
        mesh: &Bound<'_, TetMesh>,
        young: &Bound<'_, PyAny>,
        poisson: f64,
        law: &str,
        fixed: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let (nodes, tets) = (mesh.get().inner.vertices.len(), mesh.get().inner.tets.len());
        let moduli = young_moduli(young, tets)?.into_iter().map(|young| Moduli { young, poisson });
        let fixed = fixed.map_or(Ok(Vec::new()), |found| indices("fixed", found, nodes))?;
        let law = law.parse().map_err(python_error)?;
        let solid = mesh.get().inner.clone();
        let inner = deformation::SoftBody::graded(solid, law, moduli.collect(), &fixed);
        Self::of(mesh.clone(), inner.map_err(python_error)?)
    }

    /// Name of the material law.
    #[getter]
    fn law(&self) -> String {
        self.inner.law().to_string()
    }

    /// Young's modulus (Pa): one number, or an array (T,) if it is not the same everywhere.
    #[getter]
    fn young<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let young = || self.inner.moduli().iter().map(|moduli| moduli.young);
        let first = self.inner.moduli()[0].young;
        if young().all(|other| other == first) {
            return first.into_bound_py_any(py);
        }
        Ok(PyArray1::from_iter(py, young()).into_any())
    }

    /// Poisson's ratio.
    #[getter]
    fn poisson(&self) -> f64 {
        self.inner.moduli()[0].poisson
    }

    fn __getnewargs__<'py>(&self, py: Python<'py>) -> PyResult<Arguments<'py>> {
        let (mesh, fixed) = (self.mesh.bind(py).clone(), self.fixed.bind(py).clone());
        Ok((mesh, self.young(py)?, self.poisson(), self.law(), fixed))
    }

    fn __repr__(&self) -> String {
        format!("<ruffini.SoftBody {}>", self.about())
    }
}

/// Arguments of `SoftBody`.
type Arguments<'py> =
    (Bound<'py, TetMesh>, Bound<'py, PyAny>, f64, String, Bound<'py, PyArray1<u32>>);

impl SoftBody {
    /// Wraps a body of the Rust crate.
    pub(super) fn from_core(py: Python<'_>, inner: deformation::SoftBody) -> PyResult<Self> {
        Self::of(Bound::new(py, TetMesh::of(py, inner.mesh().clone())?)?, inner)
    }

    /// Material and size, in words.
    pub(super) fn about(&self) -> String {
        let (mesh, fixed, law) = (self.inner.mesh(), self.inner.fixed().len(), self.inner.law());
        let (nodes, tets) = (mesh.vertices.len(), mesh.tets.len());
        let young = || self.inner.moduli().iter().map(|moduli| moduli.young);
        let [low, high] = [young().fold(f64::INFINITY, f64::min), young().fold(0.0, f64::max)];
        let young = if low == high { format!("{low:e}") } else { format!("{low:e} to {high:e}") };
        let poisson = self.poisson();
        format!(
            "{law}, young {young} Pa, poisson {poisson}, {nodes} nodes ({fixed} fixed), \
             {tets} tetrahedra"
        )
    }

    fn of(mesh: Bound<'_, TetMesh>, inner: deformation::SoftBody) -> PyResult<Self> {
        let fixed = read_only(PyArray1::from_vec(mesh.py(), inner.fixed().to_vec()))?;
        let mut hasher = DefaultHasher::new();
        for place in &inner.mesh().vertices {
            place.coords.iter().for_each(|x| x.to_bits().hash(&mut hasher));
        }
        inner.mesh().tets.hash(&mut hasher);
        Ok(Self { inner, mesh: mesh.unbind(), fixed, mesh_hash: hasher.finish() })
    }
}

/// Young's modulus of each tetrahedron (T), from one number or T of them.
fn young_moduli(young: &Bound<'_, PyAny>, tets: usize) -> PyResult<Vec<f64>> {
    let expected = format!("one modulus, or one for each of {tets} tetrahedra");
    let (values, shape) = numbers("young", young, &expected)?;
    match shape[..] {
        [] => Ok(vec![values[0]; tets]),
        [count] if count == tets => Ok(values),
        _ => Err(refused("young", format!("{} of them", values.len()), expected)),
    }
}

/// Gel pad of a tactile sensor as a soft body bonded to its base.
///
/// Frame of the pad: z out of the gel, x across, y along; the origin is the apex, the centre of the
/// undeformed face.
///
/// Args:
///     name: "gelsight-mini", "digit", or the path of a .toml file of the same form.
///     calibration: Name of the material, "tacflex" or "feats" for the GelSight Mini; the first of
///         the sensor if not given.
///     resolution: Approximate number of nodes, which is never exceeded; 2,000 if not given.
///     around: A Press along a path, in the frame of the pad: the mesh is fine where its shapes
///         would cover the undeformed face. Or points (K, 3) in m near which it is fine. Its
///         spacing grows with the distance from the nearest. Nodes go to the points first, down to
///         a spacing of a thousandth of the thickness; further ones make the mesh finer
///         everywhere. The middle of the face if not given.
///
/// Raises:
///     FileNotFoundError: If there is no such file.
///     ValueError: If the sensor or the calibration is not known, or the resolution is not 100 to
///         200,000.
#[pyfunction]
#[pyo3(signature = (name, calibration=None, resolution=None, around=None))]
pub(crate) fn sensor(
    py: Python<'_>,
    name: &str,
    calibration: Option<&str>,
    resolution: Option<i64>,
    around: Option<&Bound<'_, PyAny>>,
) -> PyResult<SoftBody> {
    let nodes = resolution.map_or(Ok(RESOLUTION), nodes_of)?;
    let around = around.map(Around::from_python).transpose()?;
    let inner = || pad(name, calibration, nodes, around.as_ref());
    let inner = py.detach(inner).map_err(pad_error)?;
    SoftBody::from_core(py, inner)
}

/// Number of nodes that a `resolution` asks for.
pub(super) fn nodes_of(resolution: i64) -> PyResult<usize> {
    count("resolution", resolution, "100 to 200000")
}

/// Converts an error of a pad's mesh, whose `nodes` are the `resolution` in Python.
pub(super) fn pad_error(error: Error) -> PyErr {
    python_error(match &error {
        Error::Invalid { name, .. } if name == "nodes" => error.renamed("resolution"),
        _ => error,
    })
}

/// Points around which a mesh is to be fine.
enum Around {
    Points(Vec<Point3<f64>>),
    Press(Box<deformation::Press>),
}

impl Around {
    fn from_python(found: &Bound<'_, PyAny>) -> PyResult<Self> {
        if let Ok(press) = found.cast::<Press>() {
            return Ok(Self::Press(Box::new(press.get().inner.clone())));
        }
        let points = rows::<3>("around", found)?;
        Ok(Self::Points(points.into_iter().map(Into::into).collect()))
    }
}

fn pad(
    name: &str,
    calibration: Option<&str>,
    nodes: usize,
    around: Option<&Around>,
) -> Result<deformation::SoftBody> {
    let sensor = Sensor::open(name)?;
    let gel = sensor.calibration(calibration)?;
    let outline = &sensor.outline;
    let graded = match around {
        Some(Around::Points(points)) => Some(outline.graded(points, nodes)?),
        Some(Around::Press(press)) => Some(outline.graded(&press.footprint(outline)?, nodes)?),
        None => None,
    };
    let (mesh, base) = if let Some(pad) = graded {
        (pad.mesh, pad.base)
    } else {
        let pad = sensor.pad(nodes)?;
        (pad.mesh, pad.base)
    };
    deformation::SoftBody::new(mesh, gel.law.parse::<Law>()?, gel.into(), &base)
}
