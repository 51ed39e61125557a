//! Rigid shapes.

use std::{path::PathBuf, sync::Arc};

use nalgebra::Point3;
use numpy::{PyArray1, PyArray2};
use pyo3::{prelude::*, types::PyBytes};
use ruffini_core::geometry::{self, Parameter, StarShaped, Surface, Wave, read_surface};

use super::arrays::{array_of_rows, array_of_vectors, index_rows, ranged, refused, rows, vector};
use crate::error::python_error;

/// Values (P) and normals (P, 3).
type Distances<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

/// Vertices (V, 3) and corners of triangles (F, 3).
pub(super) type Triangles<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<u32>>);

/// Greatest number of edges round a circle of a surface: a ball then has 20,000 triangles.
const MOST_SEGMENTS: i64 = 200;

/// Greatest number of sides of a prism.
const MOST_SIDES: i64 = 256;

/// Rigid solid in its own frame: the origin at its middle, z along its axis of symmetry.
///
/// Create it with one of its static methods. Lengths are in m, from 1e-5 to 1; dimensions that
/// describe no solid raise a ValueError.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct Shape {
    pub(crate) inner: geometry::Shape,
}

#[pymethods]
impl Shape {
    /// Ball of a given radius.
    #[staticmethod]
    fn sphere(radius: f64) -> PyResult<Self> {
        Self::of(geometry::Shape::Sphere { radius })
    }

    /// Box with edges along the axes, of the half-lengths (3,).
    #[staticmethod]
    fn cuboid(half_extents: &Bound<'_, PyAny>) -> PyResult<Self> {
        let half_extents = vector("half_extents", half_extents)?.into();
        Self::of(geometry::Shape::Cuboid { half_extents })
    }

    /// Cylinder about z.
    #[staticmethod]
    fn cylinder(radius: f64, half_height: f64) -> PyResult<Self> {
        Self::of(geometry::Shape::Cylinder { radius, half_height })
    }

    /// Cylinder about z with hemispherical ends; the half height is that of the shaft alone.
    #[staticmethod]
    fn capsule(radius: f64, half_height: f64) -> PyResult<Self> {
        Self::of(geometry::Shape::Capsule { radius, half_height })
    }

    /// Cone about z, apex up; the radius is that of its base.
    #[staticmethod]
    fn cone(radius: f64, half_height: f64) -> PyResult<Self> {
        Self::of(geometry::Shape::Cone { radius, half_height })
    }

    /// Right prism over a regular polygon of 3 or more sides, with a side facing +x; the radius is
    /// that of the polygon's corners.
    #[staticmethod]
    fn prism(sides: i64, radius: f64, half_height: f64) -> PyResult<Self> {
        let sides = ranged("sides", sides, 3..=MOST_SIDES)?;
        Self::of(geometry::Shape::Prism { sides, radius, half_height })
    }

    /// Cylinder about z with a concentric hole, of the radii `outer` and `inner`.
    #[staticmethod]
    fn annulus(outer: f64, inner: f64, half_height: f64) -> PyResult<Self> {
        Self::of(geometry::Shape::Annulus { outer, inner, half_height })
    }

    /// Ellipsoid with semi-axes (3,) along x, y, z.
    #[staticmethod]
    fn ellipsoid(semi_axes: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::of(geometry::Shape::Ellipsoid { semi_axes: vector("semi_axes", semi_axes)?.into() })
    }

    /// Open vessel about z: a conical wall on a flat bottom, both of thickness `wall`; `bottom` and
    /// `rim` are outer radii.
    #[staticmethod]
    fn cup(bottom: f64, rim: f64, half_height: f64, wall: f64) -> PyResult<Self> {
        Self::of(geometry::Shape::Cup { bottom, rim, half_height, wall })
    }

    /// Lumpy ellipsoid, r(d) = r0(d) (1 + sum a cos(k . d + phi)) along the unit vector d.
    ///
    /// Args:
    ///     semi_axes: Semi-axes (3,) of the ellipsoid, whose radius along d is r0(d).
    ///     waves: Relative amplitude a, vector k (3,) and phase phi (rad) of each wave; the
    ///         amplitudes add up to less than 0.5.
    #[staticmethod]
    fn star_shaped(
        semi_axes: &Bound<'_, PyAny>,
        waves: Vec<(f64, Bound<'_, PyAny>, f64)>,
    ) -> PyResult<Self> {
        let wave = |(amplitude, k, phase): (f64, Bound<'_, PyAny>, f64)| -> PyResult<Wave> {
            Ok(Wave { amplitude, vector: vector("wave vector", &k)?.into(), phase })
        };
        let waves = waves.into_iter().map(wave).collect::<PyResult<_>>()?;
        let axes = vector("semi_axes", semi_axes)?.into();
        Self::of(geometry::Shape::StarShaped(StarShaped::new(axes, waves)))
    }

    /// Half-space under the plane z = 0.
    #[staticmethod]
    fn half_space() -> Self {
        Self { inner: geometry::Shape::HalfSpace }
    }

    /// Solid inside a watertight surface of triangles.
    ///
    /// Args:
    ///     vertices: Positions (V, 3) in m; those that coincide are merged.
    ///     faces: Corners of the triangles (F, 3), all counter-clockwise seen from outside or all
    ///         clockwise.
    #[staticmethod]
    fn mesh(vertices: &Bound<'_, PyAny>, faces: &Bound<'_, PyAny>) -> PyResult<Self> {
        let vertices: Vec<_> =
            rows::<3>("vertices", vertices)?.into_iter().map(Point3::from).collect();
        let faces = index_rows("faces", faces)?;
        let surface = Surface::of_solid("from arrays", &vertices, &faces).map_err(python_error)?;
        Self::of(geometry::Shape::Mesh(Arc::new(surface)))
    }

    /// Solid inside the watertight surface of an .obj or .stl file, whose unit is `scale` (m) long.
    ///
    /// Raises:
    ///     FileNotFoundError: If there is no such file.
    ///     ValueError: If it cannot be read, or its surface is not that of a solid.
    #[staticmethod]
    #[pyo3(signature = (path, scale=1.0))]
    #[allow(clippy::needless_pass_by_value)] // Arguments come owned from Python.
    fn read(py: Python<'_>, path: PathBuf, scale: f64) -> PyResult<Self> {
        let surface = py.detach(|| read_surface(&path, scale)).map_err(python_error)?;
        Self::of(geometry::Shape::Mesh(Arc::new(surface)))
    }

    /// Shape with the name of an object of the tasks, such as "cup", in its size there.
    #[staticmethod]
    fn named(name: &str) -> PyResult<Self> {
        Self::of(ruffini_core::scene::named(name).map_err(python_error)?)
    }

    /// Returns the shape with its convex edges rounded, as those of real parts are.
    ///
    /// Its faces stay where they are; the tip of a cone becomes shorter. What results is the union
    /// of all balls of that radius that fit into the shape.
    ///
    /// Args:
    ///     radius: Radius of the edges in m, less than half of the thinnest wall.
    ///
    /// Raises:
    ///     ValueError: If the radius is too large, or the shape is not a cuboid, cylinder, cone,
    ///         prism, annulus or cup with sharp edges.
    fn rounded(&self, radius: f64) -> PyResult<Self> {
        Ok(Self { inner: self.inner.rounded(radius).map_err(python_error)? })
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
    ///     ValueError: If the number of segments is out of range, or for a half-space, which has no
    ///         surface of finite size.
    #[pyo3(signature = (segments=64))]
    pub(super) fn surface<'py>(&self, py: Python<'py>, segments: i64) -> PyResult<Triangles<'py>> {
        let segments = ranged("segments", segments, 8..=MOST_SEGMENTS)?;
        let surface = py.detach(|| self.inner.surface(segments));
        let surface =
            surface.ok_or_else(|| refused("shape", "a half-space", "a shape of finite size"))?;
        let vertices = array_of_rows(py, surface.vertices().iter().map(|&p| p.into()));
        Ok((vertices, array_of_rows(py, surface.triangles().iter().copied())))
    }

    /// Signed distances of points to the surface, and their gradients.
    ///
    /// Args:
    ///     points: Positions (P, 3) in the frame of the shape, in m.
    ///
    /// Returns:
    ///     Distances (P,) in m, negative inside, and outward unit normals (P, 3) at the nearest
    ///     points of the surface.
    fn distance<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
    ) -> PyResult<Distances<'py>> {
        let points = rows::<3>("points", points)?;
        let (values, normals): (Vec<_>, Vec<_>) = py.detach(|| {
            let distances = points.into_iter().map(|p| self.inner.distance(&p.into()));
            distances.map(|distance| (distance.value, distance.normal)).unzip()
        });
        Ok((PyArray1::from_vec(py, values), array_of_vectors(py, &normals)))
    }

    /// Restores a shape from its bytes, as it is pickled.
    #[staticmethod]
    fn _restore(bytes: &[u8]) -> PyResult<Self> {
        Ok(Self { inner: geometry::Shape::from_bytes(bytes).map_err(python_error)? })
    }

    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let bytes = PyBytes::new(py, &self.inner.to_bytes());
        Ok((py.get_type::<Self>().getattr("_restore")?, (bytes,)))
    }

    fn __repr__(&self) -> String {
        let mut sharp = self.inner.sharp().clone();
        let mut words = vec![sharp.name().to_owned()];
        words.extend(sharp.parameters().into_iter().map(|(name, parameter)| match parameter {
            Parameter::Count(count) => format!("{name} {count}"),
            Parameter::Lengths([length]) => format!("{name} {length} m"),
            Parameter::Lengths(lengths) => format!("{name} {lengths:?} m"),
        }));
        match &self.inner {
            geometry::Shape::Rounded(rounded) => {
                words.push(format!("edges rounded by {} m", rounded.radius()));
            }
            geometry::Shape::Mesh(surface) => {
                let (count, size) = (surface.triangles().len(), surface.size());
                words.push(format!("{count} triangles, {size:.4} m long"));
            }
            geometry::Shape::StarShaped(star) => {
                words.push(format!("semi_axes {:?} m", star.semi_axes().as_slice()));
            }
            _ => {}
        }
        format!("<ruffini.Shape {}>", words.join(", "))
    }
}

impl Shape {
    fn of(shape: geometry::Shape) -> PyResult<Self> {
        Ok(Self { inner: shape.validated().map_err(python_error)? })
    }
}
