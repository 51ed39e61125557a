//! Models that answer presses.

use std::{
    path::PathBuf,
    sync::{Mutex, MutexGuard, PoisonError},
};

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use ruffini_core::{
    Error, Result, compliance,
    deformation::{self, DeformationModel},
    fem,
};

use super::{
    Deformation, History, Press, SoftBody, TetMesh, arrays::array_of_vectors, pool::pool,
    press::one_or_many,
};
use crate::error::{press_error, python_error};

/// Displacement (V, 3) and stress (T,) of a mesh.
type Fields<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

/// Quasi-static finite elements: a soft body in equilibrium with the rigid shapes that press it.
///
/// Large strains, contact on the faces of the surface with Coulomb friction, Newton's method with a
/// sparse Cholesky factorisation. Shapes sink in by 2 µm x pressure / Young's modulus.
///
/// Args:
///     body: What is pressed.
///     friction: Coefficient of friction between body and shapes, 0 to 100.
///     tolerance: Norm of the unbalanced force at which a frame is done (N); for a body stiffer than
///         1 MPa it grows in proportion.
///     element: "p1" (linear tetrahedra; they lock from a Poisson's ratio of 0.45 on), "p1-bar"
///         (linear, with the dilatation averaged over patches) or "p2" (quadratic: the reference).
///
/// Raises:
///     ValueError: If an option is none of those.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct Fem {
    model: Mutex<fem::Fem>,
    /// What is pressed.
    #[pyo3(get)]
    body: Py<SoftBody>,
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
        let element = element.parse().map_err(python_error)?;
        let options = fem::Options { element, friction, tolerance, ..fem::Options::default() };
        let solid = body.get().inner.clone();
        let model = py.detach(|| fem::Fem::new(solid, options)).map_err(python_error)?;
        Ok(Self { model: Mutex::new(model), body })
    }

    /// Where each press ends.
    ///
    /// Presses are solved in parallel, each on one thread, with the same answer for any number of
    /// threads; RAYON_NUM_THREADS sets it. Other Python threads run meanwhile.
    ///
    /// Args:
    ///     presses: A list of Press, or one.
    ///
    /// Returns:
    ///     A list with a Deformation for each press, or the PressError that says why there is none.
    fn solve<'py>(
        &self,
        py: Python<'py>,
        presses: &Bound<'py, PyAny>,
    ) -> PyResult<Vec<Bound<'py, PyAny>>> {
        solve(py, &self.model, presses)
    }

    /// Every frame of one press, in order.
    ///
    /// Returns:
    ///     A list with a Deformation for each frame of the path, or one for a press with a force. It
    ///     ends early with a PressError at the first frame that is not solved.
    fn solve_path<'py>(&self, py: Python<'py>, press: &Press) -> PyResult<Vec<Bound<'py, PyAny>>> {
        solve_path(py, &self.model, press)
    }

    /// The fields of an answer on another mesh of the body (V' vertices, T' tetrahedra), as exactly
    /// as the element knows them: a quadratic one bends between its nodes.
    ///
    /// Args:
    ///     history: The history of an answer of this model.
    ///     target: The undeformed mesh that they are carried to.
    ///
    /// Returns:
    ///     Displacement of its vertices (V', 3) in m, and the volume average of the von Mises stress
    ///     over its tetrahedra (T',) in Pa.
    ///
    /// Raises:
    ///     ValueError: If the history is of another model, or the mesh of another body.
    fn carry<'py>(
        &self,
        py: Python<'py>,
        history: &History,
        target: &TetMesh,
    ) -> PyResult<Fields<'py>> {
        let model = self.copy();
        let carried = py.detach(|| model.carry(&history.inner, &target.inner));
        let fem::Carried { displacement, von_mises } = carried.map_err(python_error)?;
        Ok((array_of_vectors(py, &displacement), PyArray1::from_vec(py, von_mises)))
    }
}

impl Fem {
    /// The model, for a solution that needs it beside another.
    pub(super) fn copy(&self) -> fem::Fem {
        locked(&self.model).clone()
    }
}

/// Linear elasticity of a bonded body, condensed once to its surface: fast where strains are small.
///
/// Contact is the same as in Fem, with the stiffness of "p1-bar" at rest; a history of either goes on
/// in the other. What is lost is large strain; each sweep, a modified Newton step towards the true
/// forces, buys some of it back, and the residual of the answer says how much is missing.
///
/// Args:
///     body: What is pressed; its fixed nodes must hold it.
///     friction: Coefficient of friction between body and shapes, 0 to 100.
///     sweeps: Most corrections of a load step, 0 to 12.
///     cache: Folder that keeps what is computed in advance, by a hash of the body.
///     contact: "points": felt at many points of every face, as in Fem, and solved by Newton's method.
///         "nodes": at the nodes of the surface, solved by projected Gauss-Seidel; ten to fifty times
///         faster, coarse where few nodes touch, without sweeps, and with histories of its own.
///
/// Raises:
///     ValueError: If an option is none of those, or the body is free.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct Compliance {
    model: Mutex<Linear>,
    /// What is pressed.
    #[pyo3(get)]
    body: Py<SoftBody>,
}

/// Linear elasticity with contact at points or at nodes.
enum Linear {
    Points(compliance::Compliance),
    Nodes(compliance::nodal::Nodal),
}

impl DeformationModel for Linear {
    fn solve(&mut self, presses: &[deformation::Press]) -> Vec<Result<deformation::Deformation>> {
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

impl Linear {
    fn new(model: compliance::Compliance, contact: &str, sweeps: usize) -> Result<Self> {
        match contact {
            "points" => Ok(Self::Points(model)),
            "nodes" if sweeps == 0 => Ok(Self::Nodes(model.at_nodes())),
            "nodes" => Err(Error::invalid("sweeps", sweeps, "0 with contact at nodes")),
            _ => Err(Error::invalid("contact", contact, "points or nodes")),
        }
    }
}

#[pymethods]
impl Compliance {
    #[new]
    #[pyo3(signature = (body, friction=0.0, sweeps=0, cache=None, contact="points"))]
    fn new(
        py: Python<'_>,
        body: Py<SoftBody>,
        friction: f64,
        sweeps: usize,
        cache: Option<PathBuf>,
        contact: &str,
    ) -> PyResult<Self> {
        let options = compliance::Options { friction, sweeps };
        let solid = body.get().inner.clone();
        let model = py.detach(|| {
            let model = match cache {
                Some(folder) => compliance::Compliance::cached(solid, options, &folder),
                None => compliance::Compliance::new(solid, options),
            }?;
            Linear::new(model, contact, sweeps)
        });
        Ok(Self { model: Mutex::new(model.map_err(python_error)?), body })
    }

    /// Where each press ends, as Fem.solve.
    ///
    /// Args:
    ///     presses: A list of Press, or one.
    ///
    /// Returns:
    ///     A list with a Deformation for each press, or the PressError that says why there is none.
    fn solve<'py>(
        &self,
        py: Python<'py>,
        presses: &Bound<'py, PyAny>,
    ) -> PyResult<Vec<Bound<'py, PyAny>>> {
        solve(py, &self.model, presses)
    }

    /// Every frame of one press, in order, as Fem.solve_path.
    ///
    /// Returns:
    ///     A list with a Deformation for each frame. It ends early with a PressError at the first
    ///     frame that is not solved.
    fn solve_path<'py>(&self, py: Python<'py>, press: &Press) -> PyResult<Vec<Bound<'py, PyAny>>> {
        solve_path(py, &self.model, press)
    }
}

/// What `model` answers to `presses`, one or a list.
pub(super) fn solve<'py, M: DeformationModel>(
    py: Python<'py>,
    model: &Mutex<M>,
    presses: &Bound<'py, PyAny>,
) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let (presses, _) = one_or_many::<Press>("presses", "Press", presses)?;
    let questions: Vec<_> = presses.iter().map(|press| press.get().inner.clone()).collect();
    let pool = pool()?;
    let answers = py.detach(|| {
        // Locked here: a thread of the pool that waits could take the work of another caller.
        let model = &mut *locked(model);
        pool.install(|| model.solve(&questions))
    });
    let slots = answers.into_iter().zip(&presses);
    slots.map(|(found, press)| answer(py, found, press.get())).collect()
}

/// What `model` answers to every frame of `press`.
fn solve_path<'py, M: DeformationModel>(
    py: Python<'py>,
    model: &Mutex<M>,
    press: &Press,
) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let frames = py.detach(|| locked(model).solve_path(&press.inner));
    frames.into_iter().map(|frame| answer(py, frame, press)).collect()
}

/// The model, even after a panic: no model keeps anything between presses.
pub(super) fn locked<M>(model: &Mutex<M>) -> MutexGuard<'_, M> {
    model.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A deformation under `press`, or the error in its place.
pub(super) fn answer<'py>(
    py: Python<'py>,
    found: Result<deformation::Deformation>,
    press: &Press,
) -> PyResult<Bound<'py, PyAny>> {
    match found {
        Ok(found) => {
            let shapes = press.inner.shapes().to_vec();
            Ok(Bound::new(py, Deformation::of(py, found, shapes, press.single)?)?.into_any())
        }
        Err(error) => press_error(py, &error),
    }
}
