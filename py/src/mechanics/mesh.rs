//! Tetrahedral meshes.

use std::{iter, path::PathBuf};

use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods};
use pyo3::{prelude::*, types::PyMapping};
use ruffini_core::geometry::{self, Field, FieldOn};

use super::{
    Shape,
    arrays::{Shown, array_of_rows, index_rows, numbers, numbers_or_nan, read_only, refused, rows},
};
use crate::error::python_error;

/// Tetrahedral mesh of V vertices and T tetrahedra.
///
/// If a tetrahedron has a negative volume, two of its corners are swapped.
///
/// Args:
///     vertices: Positions (V, 3) in m.
///     tets: Corners (T, 4), counted from 0.
///
/// Raises:
///     ValueError: If a vertex is unused or not finite, an index is too large, a tetrahedron is
///         flat, or tetrahedra overlap or are not connected.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct TetMesh {
    pub(super) inner: geometry::TetMesh,
    /// Vertices (V, 3) in m, read-only.
    #[pyo3(get)]
    vertices: Py<PyArray2<f64>>,
    /// Corners of the tetrahedra (T, 4), read-only: (b - a) x (c - a) . (d - a) > 0.
    #[pyo3(get)]
    tets: Py<PyArray2<u32>>,
}

#[pymethods]
impl TetMesh {
    #[new]
    fn new(py: Python<'_>, vertices: &Bound<'_, PyAny>, tets: &Bound<'_, PyAny>) -> PyResult<Self> {
        let vertices = rows::<3>("vertices", vertices)?.into_iter().map(Into::into).collect();
        let tets = index_rows("tets", tets)?;
        Self::of(py, geometry::TetMesh::new("from arrays", vertices, tets).map_err(python_error)?)
    }

    /// Reads the mesh in a file: .tet (Isaac Gym's text form) or .msh (gmsh, ASCII, 2.2 and 4.1).
    ///
    /// Args:
    ///     path: The file. Vertices that no tetrahedron uses are left out.
    ///     scale: Length of the file's unit (m).
    ///
    /// Raises:
    ///     FileNotFoundError: If there is no such file.
    ///     ValueError: If the file cannot be read or its mesh cannot be used.
    #[staticmethod]
    #[pyo3(signature = (path, scale=1.0))]
    #[allow(clippy::needless_pass_by_value)] // Arguments come owned from Python.
    fn read(py: Python<'_>, path: PathBuf, scale: f64) -> PyResult<Self> {
        let read = py.detach(|| geometry::TetMesh::read(&path, scale));
        Self::of(py, read.map_err(python_error)?)
    }

    /// Meshes the solid inside a shape, in the frame of the shape, by isosurface stuffing.
    ///
    /// Args:
    ///     shape: A solid of finite size. Its sharp edges are cut off within half a spacing.
    ///     spacing: Approximate length of an edge (m).
    ///
    /// Raises:
    ///     ValueError: If the shape is a half-space or the spacing does not suit its size.
    #[staticmethod]
    fn of_shape(py: Python<'_>, shape: &Shape, spacing: f64) -> PyResult<Self> {
        let mesh = py.detach(|| geometry::TetMesh::of_shape(&shape.inner, spacing));
        Self::of(py, mesh.map_err(python_error)?)
    }

    /// Writes the mesh with fields to a .vtu file (ParaView) or a .npz file (numpy).
    ///
    /// Args:
    ///     path: The file; an existing one is replaced.
    ///     fields: Numbers by name, finite or NaN: an array (V,) or (V, ...) on the vertices, or (T,) or
    ///         (T, ...) on the tetrahedra; on the vertices where V = T. Names have letters, digits,
    ///         spaces and underscores. Axes after the first are merged into one.
    ///
    /// Raises:
    ///     FileNotFoundError: If there is no such folder.
    ///     ValueError: If a field does not fit the mesh or the file cannot be written.
    #[pyo3(signature = (path, fields=None))]
    #[allow(clippy::needless_pass_by_value)] // Arguments come owned from Python.
    fn write(&self, path: PathBuf, fields: Option<&Bound<'_, PyMapping>>) -> PyResult<()> {
        let mut named = Vec::new();
        for item in fields.map_or(Ok(Vec::new()), |fields| fields.items()?.extract())? {
            let (name, values): (String, Bound<'_, PyAny>) = item;
            let (values, shape) = {
                let name = format!("field {name}");
                numbers_or_nan(&name, &values, "numbers (V, …)")?
            };
            let (on, components) = self.place(&format!("field {name}"), &shape)?;
            named.push((name, on, components, values));
        }
        let field = |(name, on, components, values)| Field { name, on, components, values };
        let fields: Vec<_> =
            named.iter().map(|(n, on, components, v)| field((n, *on, *components, v))).collect();
        self.inner.write(&path, &fields).map_err(python_error)
    }

    /// Values of a field at points, as for a section through a body.
    ///
    /// Args:
    ///     points: Positions (P, 3) in m, in the undeformed mesh.
    ///     field: Finite numbers (V,) or (V, ...) on the vertices, interpolated linearly, or (T,) or
    ///         (T, ...) on the tetrahedra; on the vertices where V = T.
    ///
    /// Returns:
    ///     Values (P,) or (P, ...); NaN outside of the mesh.
    ///
    /// Raises:
    ///     ValueError: If the field does not fit the mesh.
    fn at<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
        field: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let points: Vec<_> = rows::<3>("points", points)?.into_iter().map(Into::into).collect();
        let (values, mut shape) = numbers("field", field, "numbers (V, …)")?;
        let (on, components) = self.place("field", &shape)?;
        let row = |of: u32| &values[of as usize * components..][..components];
        let mut found = Vec::with_capacity(points.len() * components);
        for site in py.detach(|| self.inner.locate(&points)) {
            let Some((tet, shares)) = site else {
                found.extend(iter::repeat_n(f64::NAN, components));
                continue;
            };
            match on {
                FieldOn::Tets => found.extend(row(tet)),
                FieldOn::Vertices => {
                    let corners = self.inner.tets[tet as usize].map(row);
                    found.extend((0..components).map(|c| {
                        corners
                            .iter()
                            .zip(shares)
                            .map(|(corner, share)| corner[c] * share)
                            .sum::<f64>()
                    }));
                }
            }
        }
        shape[0] = points.len();
        PyArray1::from_vec(py, found).reshape(shape)
    }

    fn __getnewargs__(&self, py: Python<'_>) -> (Py<PyArray2<f64>>, Py<PyArray2<u32>>) {
        (self.vertices.clone_ref(py), self.tets.clone_ref(py))
    }

    fn __repr__(&self) -> String {
        let (vertices, tets) = (self.inner.vertices.len(), self.inner.tets.len());
        format!("<ruffini.TetMesh of {vertices} vertices, {tets} tetrahedra>")
    }
}

impl TetMesh {
    pub(super) fn of(py: Python<'_>, mesh: geometry::TetMesh) -> PyResult<Self> {
        let vertices = array_of_rows(py, mesh.vertices.iter().map(|&p| p.into()));
        let tets = array_of_rows(py, mesh.tets.iter().copied());
        Ok(Self { vertices: read_only(vertices)?, tets: read_only(tets)?, inner: mesh })
    }

    /// Elements to which a field of that array shape belongs, and its number of components.
    fn place(&self, name: &str, shape: &[usize]) -> PyResult<(FieldOn, usize)> {
        let (vertices, tets) = (self.inner.vertices.len(), self.inner.tets.len());
        let on = match shape.first() {
            Some(&count) if count == vertices => FieldOn::Vertices,
            Some(&count) if count == tets => FieldOn::Tets,
            _ => {
                let expected =
                    format!("({vertices}, …) for vertices or ({tets}, …) for tetrahedra");
                return Err(refused(name, Shown(shape), expected));
            }
        };
        Ok((on, shape[1..].iter().product()))
    }
}
