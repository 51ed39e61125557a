//! Objects of the dataset, and grasps of them.

use pyo3::prelude::*;
use ruffini_core::objects::GraspSampler;

use super::{
    Shape, TetMesh,
    answer::{self, Pose},
    arrays::{ranged, refused},
    shape::Triangles,
};
use crate::error::python_error;

/// Greatest number of grasps of one object that are drawn at once.
const MOST_GRASPS: i64 = 10_000;

/// The 64 objects of the catalogue: 49 for training, 14 novel ones and a soft one.
///
/// Args:
///     seed: Seed of the sizes; the same seed gives the same objects on every machine.
#[pyfunction]
#[pyo3(signature = (seed=None), text_signature = "(seed=0)")]
pub(crate) fn objects(seed: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<Object>> {
    let seed = seed.map_or(Ok(0), whole)?;
    Ok(ruffini_core::objects::catalogue(seed).into_iter().map(|inner| Object { inner }).collect())
}

/// Object of the catalogue: a solid of hand size in its own frame, z along its axis if it has one.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct Object {
    inner: ruffini_core::objects::Object,
}

#[pymethods]
impl Object {
    /// Family and number, such as "cup-2".
    #[getter]
    fn name(&self) -> &str {
        &self.inner.name
    }

    /// Kind of thing, such as "cup".
    #[getter]
    fn family(&self) -> String {
        self.inner.family.expect("an object of the catalogue has one").to_string()
    }

    /// Set to which the object belongs: "train", "novel" or "soft".
    #[getter]
    fn split(&self) -> String {
        self.inner.split.to_string()
    }

    /// Seed of the object's sizes.
    #[getter]
    fn seed(&self) -> u64 {
        self.inner.seed
    }

    /// Exact shape of the object.
    #[getter]
    fn shape(&self) -> Shape {
        Shape { inner: self.inner.shape.clone() }
    }

    /// Meshes the surface with watertight triangles.
    ///
    /// Args:
    ///     segments: Approximate number of edges round a circle, 8 to 200.
    ///
    /// Returns:
    ///     Vertices (V, 3) in m and corners of the triangles (F, 3), counter-clockwise seen from
    ///     outside.
    ///
    /// Raises:
    ///     ValueError: If the number of segments is out of range.
    #[pyo3(signature = (segments=64))]
    fn surface<'py>(&self, py: Python<'py>, segments: i64) -> PyResult<Triangles<'py>> {
        self.shape().surface(py, segments)
    }

    /// Meshes the solid with tetrahedra.
    ///
    /// Args:
    ///     spacing: Approximate length of an edge (m).
    ///
    /// Raises:
    ///     ValueError: If the spacing does not suit the size of the object.
    fn tets(&self, py: Python<'_>, spacing: f64) -> PyResult<TetMesh> {
        let mesh = py.detach(|| self.inner.tets(spacing)).map_err(python_error)?;
        TetMesh::of(py, mesh)
    }

    /// Draws grasps that hold the object between two opposite contacts and that the hand can reach.
    ///
    /// Args:
    ///     count: Number of grasps, up to 10,000; fewer are returned if 200 draws for each do not
    ///         yield them.
    ///     seed: Seed of the draws.
    ///     friction: Coulomb coefficient between pads and object, above 0 and up to 10.
    ///
    /// Raises:
    ///     ValueError: If an argument is out of range.
    #[pyo3(signature = (count, seed, friction=0.5))]
    fn grasps(
        &self,
        py: Python<'_>,
        count: i64,
        seed: &Bound<'_, PyAny>,
        friction: f64,
    ) -> PyResult<Vec<Antipodal>> {
        let (count, seed) = (ranged("count", count, 0..=MOST_GRASPS)?, whole(seed)?);
        let sampler = GraspSampler { friction, ..GraspSampler::default() };
        let sample = || sampler.sample(&self.inner.shape, count as usize, seed);
        let sampling = py.detach(sample).map_err(python_error)?;
        Ok(sampling.grasps.into_iter().map(|inner| Antipodal { inner }).collect())
    }

    fn __repr__(&self) -> String {
        let ruffini_core::objects::Object { name, split, shape, .. } = &self.inner;
        format!("<ruffini.Object {name}, {split}, {}>", shape.name())
    }
}

/// Grasp between two opposite contacts, in the frame of the object.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct Antipodal {
    inner: ruffini_core::objects::Antipodal,
}

#[pymethods]
impl Antipodal {
    /// Pose of the tool in the frame of the object, (position (3,) in m, quaternion (4,) xyzw): its
    /// origin midway between the contacts, x from the first to the second, z towards the wrist.
    #[getter]
    fn tool<'py>(&self, py: Python<'py>) -> Pose<'py> {
        answer::pose(py, &self.inner.tool)
    }

    /// Distance between the contacts (m).
    #[getter]
    fn width(&self) -> f64 {
        self.inner.width
    }

    /// Angle between x of the tool and the outward normal at the second contact (rad).
    #[getter]
    fn angle(&self) -> f64 {
        self.inner.angle
    }

    /// Margin of force closure: 1 in the middle of the friction cone, 0 on its surface.
    #[getter]
    fn quality(&self) -> f64 {
        self.inner.quality
    }

    /// Poses of the two pads in the frame of the object, the pad at the first contact first, with
    /// the apexes `apart` (m).
    fn pads<'py>(&self, py: Python<'py>, apart: f64) -> PyResult<(Pose<'py>, Pose<'py>)> {
        if !apart.is_finite() {
            return Err(refused("apart", apart, "a finite length (m)"));
        }
        let [first, second] = self.inner.pads(apart);
        Ok((answer::pose(py, &first), answer::pose(py, &second)))
    }

    fn __repr__(&self) -> String {
        let ruffini_core::objects::Antipodal { width, quality, .. } = self.inner;
        format!("<ruffini.Antipodal {:.1} mm wide, quality {quality:.2}>", 1e3 * width)
    }
}

/// Extracts a seed.
fn whole(found: &Bound<'_, PyAny>) -> PyResult<u64> {
    found.extract().map_err(|_| refused("seed", found, "a whole number from 0 below 2**64"))
}
