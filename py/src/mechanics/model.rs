//! Models that solve presses.

use std::path::PathBuf;

use nalgebra::Isometry3;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use ruffini_core::{
    Error, Result, compliance,
    deformation::{self, DeformationModel, Drive},
    fem,
    geometry::Shape,
};

use super::{
    Deformation, History, Press, SoftBody, TetMesh,
    arrays::{array_of_vectors, count},
    press::one_or_many,
};
use crate::{
    error::{press_error, python_error},
    pool::in_pool,
};

/// Displacement (V, 3) and stress (T,) of a mesh.
type FieldArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

/// Quasi-static finite element model of a soft body that rigid shapes press.
///
/// Large strains, contact on the faces of the surface with Coulomb friction, Newton's method with a
/// sparse Cholesky factorisation. Contact is compliant: shapes penetrate by 2 µm x pressure /
/// Young's modulus.
///
/// Args:
///     body: Soft body that is pressed.
///     friction: Coefficient of friction between body and shapes, 0 to 100.
///     tolerance: Norm of the residual force at which a frame has converged (N); for a body stiffer
///         than 1 MPa it grows in proportion.
///     element: "p1" (linear tetrahedra; they lock from a Poisson's ratio of 0.45 on), "p1-bar"
///         (linear, with the dilatation averaged over patches) or "p2" (quadratic: the reference).
///
/// Raises:
///     ValueError: If an option is not valid.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct Fem {
    pub(super) model: fem::Fem,
    /// Soft body that is pressed.
    #[pyo3(get)]
    body: Py<SoftBody>,
    /// Coefficient of friction between body and shapes.
    #[pyo3(get)]
    friction: f64,
    /// Norm of the residual force at which a frame has converged (N), as it was given.
    #[pyo3(get)]
    tolerance: f64,
    /// Kind of element.
    #[pyo3(get)]
    element: String,
}

#[pymethods]
impl Fem {
    #[new]
    #[pyo3(signature = (body, friction=0.0, tolerance=1e-7, element="p1-bar"))]
    fn new(
        py: Python<'_>,
        body: Py<SoftBody>,
        friction: f64,
        tolerance: f64,
        element: &str,
    ) -> PyResult<Self> {
        let kind = element.parse().map_err(python_error)?;
        let options =
            fem::FemOptions { element: kind, friction, tolerance, ..fem::FemOptions::default() };
        let solid = body.get().inner.clone();
        let model = py.detach(|| fem::Fem::new(solid, options)).map_err(python_error)?;
        Ok(Self { model, body, friction, tolerance, element: element.to_owned() })
    }

    fn __repr__(&self) -> String {
        let Self { body, friction, element, .. } = self;
        format!("<ruffini.Fem {element}, friction {friction}, {}>", body.get().about())
    }

    /// Solves each press and returns its last frame.
    ///
    /// Presses are solved in parallel, each on one thread; the result does not depend on the number
    /// of threads, which RAYON_NUM_THREADS sets. Other Python threads run meanwhile.
    ///
    /// Args:
    ///     presses: A list of Press, or one.
    ///
    /// Returns:
    ///     A list with a Deformation for each press, or a PressError with the reason if it is not
    ///     solved.
    fn solve<'py>(
        &self,
        py: Python<'py>,
        presses: &Bound<'py, PyAny>,
    ) -> PyResult<Vec<Bound<'py, PyAny>>> {
        solve(py, &self.model, &self.body, presses)
    }

    /// Solves every frame of one press, in order.
    ///
    /// Returns:
    ///     A list with a Deformation for each frame of the path, or one for a press with a force.
    ///     It ends early with a PressError at the first frame that is not solved.
    fn solve_path<'py>(&self, py: Python<'py>, press: &Press) -> PyResult<Vec<Bound<'py, PyAny>>> {
        solve_path(py, &self.model, &self.body, press)
    }

    /// Evaluates the fields of a solution on another mesh of the body (V' vertices, T' tetrahedra),
    /// with the full interpolation of the element: a quadratic one is curved between its nodes.
    ///
    /// Args:
    ///     history: History of a solution of this model.
    ///     target: Undeformed mesh on which the fields are evaluated.
    ///
    /// Returns:
    ///     Displacement of its vertices (V', 3) in m, and the volume average of the von Mises
    ///     stress over its tetrahedra (T',) in Pa.
    ///
    /// Raises:
    ///     ValueError: If the history is of another model, or the mesh of another body.
    fn carry<'py>(
        &self,
        py: Python<'py>,
        history: &History,
        target: &TetMesh,
    ) -> PyResult<FieldArrays<'py>> {
        let carried = py.detach(|| self.model.carry(&history.inner, &target.inner));
        let fem::Carried { displacement, von_mises } = carried.map_err(python_error)?;
        Ok((array_of_vectors(py, &displacement), PyArray1::from_vec(py, von_mises)))
    }

    /// Evaluates the Cauchy stress of a solution; with law "linear" it is that of small strains.
    ///
    /// Args:
    ///     history: History of a solution of this model.
    ///
    /// Returns:
    ///     Volume average of the stress over each tetrahedron (T, 3, 3) in Pa, tension positive, in
    ///     the axes of the body.
    ///
    /// Raises:
    ///     ValueError: If the history is of another model.
    fn stress<'py>(
        &self,
        py: Python<'py>,
        history: &History,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let stress = py.detach(|| self.model.stress(&history.inner)).map_err(python_error)?;
        // By columns or by rows is the same, as the stress is symmetric.
        let numbers = stress.iter().flatten().copied().collect();
        PyArray1::from_vec(py, numbers).reshape([stress.len(), 3, 3])
    }
}

/// Linear elastic model of a bonded body, condensed once to its surface: fast, for small strains.
///
/// Contact is the same as in Fem, with the stiffness of "p1-bar" at rest, and a history of one
/// model can be continued in the other. Large strain is neglected; each correction, a modified Newton
/// step towards the nonlinear forces, recovers part of it, and the residual of the solution
/// measures the rest.
///
/// Args:
///     body: Soft body that is pressed; its fixed nodes must prevent rigid motion.
///     friction: Coefficient of friction between body and shapes, 0 to 100.
///     corrections: Greatest number of corrections of a load step, 0 to 12.
///     cache: Folder in which precomputed data are kept, by a hash of the body.
///     contact: "points": evaluated at many points of every face, as in Fem, and solved by
///         Newton's method. "nodes": evaluated at the nodes of the surface, solved by projected
///         Gauss-Seidel; ten to fifty times faster, coarse where few nodes touch, without corrections,
///         and with histories that only this option can continue.
///
/// Raises:
///     ValueError: If an option is not valid, or the body is free.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct Compliance {
    model: LinearModel,
    /// Soft body that is pressed.
    #[pyo3(get)]
    body: Py<SoftBody>,
    /// Coefficient of friction between body and shapes.
    #[pyo3(get)]
    friction: f64,
    /// Greatest number of corrections of a load step.
    #[pyo3(get)]
    corrections: usize,
    /// Places where contact is evaluated.
    #[pyo3(get)]
    contact: String,
}

/// Linear elastic model with contact at points or at nodes.
enum LinearModel {
    Points(compliance::Compliance),
    Nodes(compliance::nodal::Nodal),
}

impl DeformationModel for LinearModel {
    fn solve(&self, presses: &[deformation::Press]) -> Vec<Result<deformation::Deformation>> {
        match self {
            Self::Points(model) => model.solve(presses),
            Self::Nodes(model) => model.solve(presses),
        }
    }

    fn solve_path(&self, press: &deformation::Press) -> Vec<Result<deformation::Deformation>> {
        match self {
            Self::Points(model) => model.solve_path(press),
            Self::Nodes(model) => model.solve_path(press),
        }
    }
}

impl LinearModel {
    fn new(model: compliance::Compliance, contact: &str, corrections: usize) -> Result<Self> {
        match contact {
            "points" => Ok(Self::Points(model)),
            "nodes" if corrections == 0 => model.at_nodes().map(Self::Nodes),
            "nodes" => Err(Error::invalid("corrections", corrections, "0 with contact at nodes")),
            _ => Err(Error::invalid("contact", contact, "points or nodes")),
        }
    }
}

#[pymethods]
impl Compliance {
    #[new]
    #[pyo3(signature = (body, friction=0.0, corrections=0, cache=None, contact="points"))]
    fn new(
        py: Python<'_>,
        body: Py<SoftBody>,
        friction: f64,
        corrections: i64,
        cache: Option<PathBuf>,
        contact: &str,
    ) -> PyResult<Self> {
        let corrections = count("corrections", corrections, "0 to 12")?;
        let options = compliance::ComplianceOptions { friction, corrections };
        let solid = body.get().inner.clone();
        let model = in_pool(py, || {
            let model = match cache {
                Some(folder) => compliance::Compliance::cached(solid, options, &folder),
                None => compliance::Compliance::new(solid, options),
            }?;
            LinearModel::new(model, contact, corrections)
        })?;
        let model = model.map_err(python_error)?;
        Ok(Self { model, body, friction, corrections, contact: contact.to_owned() })
    }

    fn __repr__(&self) -> String {
        let Self { body, friction, corrections, contact, .. } = self;
        let body = body.get().about();
        format!(
            "<ruffini.Compliance contact at {contact}, friction {friction}, \
             {corrections} corrections, {body}>"
        )
    }

    /// Solves each press and returns its last frame, as Fem.solve.
    ///
    /// Args:
    ///     presses: A list of Press, or one.
    ///
    /// Returns:
    ///     A list with a Deformation for each press, or a PressError with the reason if it is not
    ///     solved.
    fn solve<'py>(
        &self,
        py: Python<'py>,
        presses: &Bound<'py, PyAny>,
    ) -> PyResult<Vec<Bound<'py, PyAny>>> {
        solve(py, &self.model, &self.body, presses)
    }

    /// Solves every frame of one press, in order, as Fem.solve_path.
    ///
    /// Returns:
    ///     A list with a Deformation for each frame. It ends early with a PressError at the first
    ///     frame that is not solved.
    fn solve_path<'py>(&self, py: Python<'py>, press: &Press) -> PyResult<Vec<Bound<'py, PyAny>>> {
        solve_path(py, &self.model, &self.body, press)
    }
}

/// Solves `presses`, one or a list, by `model`.
pub(super) fn solve<'py, M: DeformationModel>(
    py: Python<'py>,
    model: &M,
    body: &Py<SoftBody>,
    presses: &Bound<'py, PyAny>,
) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let (presses, _) = one_or_many::<Press>("presses", "Press", presses)?;
    let inputs: Vec<_> = presses.iter().map(|press| press.get().inner.clone()).collect();
    let answers = in_pool(py, || model.solve(&inputs))?;
    let slots = answers.into_iter().zip(&presses);
    slots.map(|(found, press)| answer(py, found, press.get(), body)).collect()
}

/// Solves every frame of `press` by `model`.
pub(super) fn solve_path<'py, M: DeformationModel>(
    py: Python<'py>,
    model: &M,
    body: &Py<SoftBody>,
    press: &Press,
) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let frames = in_pool(py, || model.solve_path(&press.inner))?;
    frames.into_iter().map(|frame| answer(py, frame, press, body)).collect()
}

/// Converts the solution of `press` of `body`, or the error in its place.
pub(super) fn answer<'py>(
    py: Python<'py>,
    found: Result<deformation::Deformation>,
    press: &Press,
    body: &Py<SoftBody>,
) -> PyResult<Bound<'py, PyAny>> {
    match found {
        Ok(found) => {
            let shapes = press.shapes.iter().map(|shape| shape.clone_ref(py)).collect();
            let hash = Some(body.get().mesh_hash);
            Ok(Bound::new(py, Deformation::of(found, shapes, press.single, hash))?.into_any())
        }
        Err(error) => {
            let unsolved = matches!(
                error,
                Error::Penetrated { .. }
                    | Error::Inverted
                    | Error::NotConverged { .. }
                    | Error::StepTooLong { .. }
            );
            let hint = if unsolved { too_deep(&press.inner, &body.get().inner) } else { None };
            press_error(py, &error, hint.as_deref())
        }
    }
}

/// Hint on the depth at which the path of `press` ends, if that is past the held nodes of `body`.
fn too_deep(press: &deformation::Press, body: &deformation::SoftBody) -> Option<String> {
    let Drive::Translation { path } = press.drive() else { return None };
    let vertices = &body.mesh().vertices;
    let held = || body.fixed().iter().map(|&node| &vertices[node as usize]);
    let depth = |(shape, pose): (&Shape, &Isometry3<f64>)| {
        let depths =
            held().map(|place| -shape.distance(&pose.inverse_transform_point(place)).value);
        depths.fold(0.0, f64::max)
    };
    let past = press.shapes().iter().zip(path.last()?).map(depth).fold(0.0, f64::max);
    if past < PAST {
        return None;
    }
    // The base of a pad is flat and at its bottom.
    let ends = |heights: &mut dyn Iterator<Item = f64>| {
        heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], z| [a.min(z), b.max(z)])
    };
    let [bottom, top] = ends(&mut vertices.iter().map(|place| place.z));
    let [low, high] = ends(&mut held().map(|place| place.z));
    let thick = top - bottom;
    let (past, deep, thick) = (1e3 * past, 1e3 * (thick + past), 1e3 * thick);
    Some(if high - low < PAST && low - bottom < PAST {
        format!("the path ends {deep:.2} mm deep in a gel of {thick:.2} mm")
    } else {
        format!("the path ends {past:.2} mm inside what holds the body")
    })
}

/// Depth of a shape at the held nodes from which the hint is given (m).
const PAST: f64 = 1e-5;
