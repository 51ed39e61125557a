//! Transfer of fields between meshes of one body.

use nalgebra::Vector3;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use ruffini_core::geometry;

use super::{
    TetMesh,
    arrays::{Shown, array_of_vectors, numbers, refused, rows},
};
use crate::error::python_error;

/// Transfer of fields from one mesh (V vertices, T tetrahedra) to another of the same body (V',
/// T').
///
/// Args:
///     source: Undeformed mesh from which fields are transferred.
///     target: Undeformed mesh to which fields are transferred.
///
/// Raises:
///     ValueError: If a vertex of one mesh lies far off the other.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct Transfer {
    inner: geometry::Transfer,
    vertices: usize,
    tets: usize,
    target_vertices: usize,
}

#[pymethods]
impl Transfer {
    #[new]
    fn new(py: Python<'_>, source: &TetMesh, target: &TetMesh) -> PyResult<Self> {
        let (from, to) = (&source.inner, &target.inner);
        let inner = py.detach(|| geometry::Transfer::new(from, to)).map_err(python_error)?;
        let (vertices, target_vertices) = (from.vertices.len(), to.vertices.len());
        Ok(Self { inner, vertices, tets: from.tets.len(), target_vertices })
    }

    /// Interpolates a nodal field linearly at the vertices of the target.
    ///
    /// Args:
    ///     nodal: Vectors (V, 3).
    ///
    /// Returns:
    ///     Vectors (V', 3) in the same unit.
    fn interpolate<'py>(
        &self,
        py: Python<'py>,
        nodal: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let nodal = self.nodal("nodal", nodal)?;
        Ok(array_of_vectors(py, &self.inner.interpolate(&nodal)))
    }

    /// Distributes nodal forces to the surrounding vertices of the target.
    ///
    /// Args:
    ///     forces: Forces (V, 3).
    ///
    /// Returns:
    ///     Forces (V', 3) of equal sum and torque.
    fn spread<'py>(
        &self,
        py: Python<'py>,
        forces: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let forces = self.nodal("forces", forces)?;
        Ok(array_of_vectors(py, &self.inner.spread(&forces)))
    }

    /// Averages a field on tetrahedra over those of the target, with 35 points in each.
    ///
    /// Args:
    ///     per_tet: Values (T,).
    ///
    /// Returns:
    ///     Values (T',) in the same unit.
    fn average<'py>(
        &self,
        py: Python<'py>,
        per_tet: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let expected = format!("numbers ({},)", self.tets);
        let (values, shape) = numbers("per_tet", per_tet, &expected)?;
        if shape != [self.tets] {
            return Err(refused("per_tet", Shown(&shape), expected));
        }
        Ok(PyArray1::from_vec(py, self.inner.average(&values)))
    }

    fn __repr__(&self) -> String {
        format!("<ruffini.Transfer from {} to {} vertices>", self.vertices, self.target_vertices)
    }
}

impl Transfer {
    /// Extracts one vector for each vertex of the source.
    fn nodal(&self, name: &str, found: &Bound<'_, PyAny>) -> PyResult<Vec<Vector3<f64>>> {
        let vectors = rows::<3>(name, found)?;
        if vectors.len() != self.vertices {
            let expected = format!("numbers ({}, 3)", self.vertices);
            return Err(refused(name, Shown(&[vectors.len(), 3]), expected));
        }
        Ok(vectors.into_iter().map(Into::into).collect())
    }
}
