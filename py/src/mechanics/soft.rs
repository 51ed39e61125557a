//! Trained network for soft objects as a model of presses.

use std::path::PathBuf;

use pyo3::prelude::*;
use ruffini_core::{deformation::Moduli, surrogate::soft};

use super::{
    Deformation, Press, Shape, SoftBody,
    model::{solve, solve_path},
};
use crate::{error::python_error, pool::in_pool};

/// Graph network that corrects a linear solution of a soft object between two rigid fingers.
///
/// The linear solution of the free object, with friction, is computed first; the network corrects
/// it on the mesh of `body`. The same network serves all objects. Without contact the solution is
/// exactly zero.
///
/// A press has two equal cuboids, ``Press([box, box], poses)``: the fingers, whose sides at +z face
/// the object, in the object's frame.
///
/// Args:
///     shape: The object, a solid.
///     young: Young's modulus (Pa).
///     poisson: Poisson's ratio.
///     friction: Coefficient of friction between object and fingers.
///     weights: "soft", the shipped weights, or the path of a .safetensors file.
///
/// Raises:
///     FileNotFoundError: If there is no file of these weights.
///     ValueError: If the weights are not known or damaged, a number is out of its range, or the
///         shape has no mesh.
#[pyclass(frozen, module = "ruffini")]
pub(crate) struct SoftSurrogate {
    model: soft::SoftSurrogate,
    /// Object's body, with mesh and material, to which solutions refer.
    #[pyo3(get)]
    body: Py<SoftBody>,
    /// Coefficient of friction between object and fingers.
    #[pyo3(get)]
    friction: f64,
}

#[pymethods]
impl SoftSurrogate {
    #[new]
    #[pyo3(signature = (shape, young=1e5, poisson=0.45, friction=0.8, weights="soft"))]
    fn new(
        py: Python<'_>,
        shape: &Shape,
        young: f64,
        poisson: f64,
        friction: f64,
        weights: &str,
    ) -> PyResult<Self> {
        let (shape, moduli) = (shape.inner.clone(), Moduli { young, poisson });
        let path = PathBuf::from(weights);
        let model = in_pool(py, || {
            if path.extension().is_some_and(|extension| extension == "safetensors") {
                soft::SoftSurrogate::load(&path, &shape, moduli, friction)
            } else {
                soft::SoftSurrogate::named(weights, &shape, moduli, friction)
            }
        })?;
        let model = model.map_err(python_error)?;
        let body = SoftBody::from_core(py, model.body().clone())?;
        Ok(Self { model, body: Py::new(py, body)?, friction })
    }

    fn __repr__(&self) -> String {
        format!("<ruffini.SoftSurrogate {}>", self.body.get().about())
    }

    /// Description of the weights as JSON: form, training, data, errors on unseen data.
    #[getter]
    fn card(&self) -> String {
        serde_json::to_string(self.model.card()).expect("plain data")
    }

    /// Solves each press and returns its last frame, as Fem.solve.
    ///
    /// Args:
    ///     presses: A list of Press, or one.
    ///
    /// Returns:
    ///     A list with a Deformation for each press, or a PressError with the reason if it is not
    ///     solved. `residual` is that of the linear solution.
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

    /// Returns whether displacement, Poisson's ratio and friction of a solution of this network lie
    /// within its training data.
    fn is_in_distribution(&self, answer: &Deformation) -> bool {
        self.model.is_in_distribution(&answer.inner.displacement)
    }
}
