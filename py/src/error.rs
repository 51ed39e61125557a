//! Conversion of the Rust crate's errors to Python exceptions with the same text.

use pyo3::{
    exceptions::{PyFileNotFoundError, PyRuntimeError, PyValueError},
    prelude::*,
};
use ruffini_core::Error;

pyo3::create_exception!(
    ruffini,
    SimulationError,
    PyRuntimeError,
    "A computation that failed: an engine error, a press without a solution."
);

pyo3::create_exception!(
    ruffini,
    PressError,
    SimulationError,
    "A press that was not solved, as it stands in the list of answers.\n\n\
     `kind` names the reason, one of those in its annotation; mostly it is \"not-converged\" (no\n\
     equilibrium, however small the load step), \"step-too-long\" (a shape passes through the\n\
     surface, however small the load step), \"penetrated\" (a shape was led deep into the body,\n\
     past nodes that are held), \"on-walls\" (contact is mostly on the upright sides of a pad, where\n\
     LinearPad and Surrogate feel nothing), \"inverted\" (a linear solution turned part of the body\n\
     inside out), \"unreachable\" (the shapes never press with the force asked for) or \"invalid\" (a history\n\
     of another body). The text has the figures.\n\n\
     Of the attributes of an answer it has none: asked for one, it raises a PressError with the\n\
     reason."
);

/// Converts an error: a missing file or folder becomes a `FileNotFoundError`, as `open` raises it,
/// bad arguments a `ValueError`, all others a `SimulationError`.
#[allow(clippy::needless_pass_by_value)] // For `map_err`.
pub(crate) fn python_error(error: Error) -> PyErr {
    if let Some(path) = error.missing_file() {
        let path = path.to_owned();
        return PyFileNotFoundError::new_err((NOT_FOUND, "No such file or directory", path));
    }
    match error {
        Error::Invalid { .. }
        | Error::Setting { .. }
        | Error::BadState { .. }
        | Error::BadMesh { .. }
        | Error::File { .. } => value_error(error.to_string()),
        _ => SimulationError::new_err(error.to_string()),
    }
}

/// Creates a `ValueError` with the nearest known word beside an unknown one, and no words of serde.
pub(crate) fn value_error(message: String) -> PyErr {
    let plain = |py: Python<'_>| {
        py.import("ruffini._words")?.getattr("plain_words")?.call1((&message,))?.extract::<String>()
    };
    let text = Python::attach(plain).unwrap_or(message);
    PyValueError::new_err(text)
}

/// `errno.ENOENT`.
const NOT_FOUND: i32 = 2;

/// Creates the `PressError` that takes the place of an unsolved press in the list of solutions,
/// with a `hint` after its text.
pub(crate) fn press_error<'py>(
    py: Python<'py>,
    error: &Error,
    hint: Option<&str>,
) -> PyResult<Bound<'py, PyAny>> {
    let text = hint.map_or_else(|| error.to_string(), |hint| format!("{error}: {hint}"));
    let value = PressError::new_err(text).into_value(py).into_bound(py);
    value.setattr("kind", error.kind())?;
    Ok(value.into_any())
}
