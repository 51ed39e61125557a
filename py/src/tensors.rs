//! Named arrays and a text, the card, as the bytes of a safetensors file.

use std::collections::{BTreeMap, HashMap};

use numpy::{Element, PyArray1, PyArrayDyn, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::{
    exceptions::PyValueError,
    prelude::*,
    types::{PyBytes, PyDict},
};
use safetensors::{Dtype, SafeTensorError, SafeTensors, tensor::TensorView};

use crate::mechanics::arrays::refused;

/// Key of the card in the file's metadata. It is the only key, so that the bytes do not depend on
/// the order of keys.
const CARD: &str = "card";

/// Reads the arrays (float32 or float64) by name, and the card, from the bytes of a safetensors
/// file.
#[pyfunction]
pub(crate) fn read_tensors<'py>(
    py: Python<'py>,
    data: &[u8],
) -> PyResult<(Bound<'py, PyDict>, String)> {
    let damaged = |error: SafeTensorError| {
        let found = format!("bytes of something else, or not all ({error})");
        refused("data", found, "the whole bytes of a safetensors file")
    };
    let (_, metadata) = SafeTensors::read_metadata(data).map_err(damaged)?;
    let card = metadata.metadata().as_ref().and_then(|texts| texts.get(CARD)).cloned();
    let card = card.ok_or_else(|| refused("data", "no card", "one in the file's metadata"))?;
    let arrays = PyDict::new(py);
    for (name, view) in SafeTensors::deserialize(data).map_err(damaged)?.iter() {
        match view.dtype() {
            Dtype::F32 => arrays.set_item(name, array(py, &view, f32::from_le_bytes)?)?,
            Dtype::F64 => arrays.set_item(name, array(py, &view, f64::from_le_bytes)?)?,
            other => return Err(refused(name, format!("{other:?}"), "F32 or F64")),
        }
    }
    Ok((arrays, card))
}

/// Bytes of a safetensors file with these arrays (float32 or float64) and `card`.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)] // Arguments come owned from Python.
pub(crate) fn write_tensors<'py>(
    py: Python<'py>,
    tensors: BTreeMap<String, Bound<'py, PyUntypedArray>>,
    card: String,
) -> PyResult<Bound<'py, PyBytes>> {
    let mut parts = BTreeMap::new();
    for (name, array) in &tensors {
        let (dtype, bytes) = if let Ok(values) = array.cast::<PyArrayDyn<f32>>() {
            (Dtype::F32, bytes(values, f32::to_le_bytes))
        } else if let Ok(values) = array.cast::<PyArrayDyn<f64>>() {
            (Dtype::F64, bytes(values, f64::to_le_bytes))
        } else {
            return Err(refused(name, array.dtype(), "float32 or float64"));
        };
        parts.insert(name, (dtype, array.shape().to_vec(), bytes));
    }
    let views = parts.iter().map(|(name, (dtype, shape, bytes))| {
        let view = TensorView::new(*dtype, shape.clone(), bytes);
        (name, view.expect("as many bytes as the shape says"))
    });
    let metadata = HashMap::from([(CARD.to_owned(), card)]);
    let whole = safetensors::serialize(views, Some(metadata));
    let whole = whole.map_err(|error| PyValueError::new_err(error.to_string()))?;
    Ok(PyBytes::new(py, &whole))
}

fn array<'py, T: Element, const N: usize>(
    py: Python<'py>,
    view: &TensorView,
    number: fn([u8; N]) -> T,
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let values = view.data().as_chunks().0.iter().map(|&bytes| number(bytes));
    PyArray1::from_iter(py, values).reshape(view.shape().to_vec())
}

fn bytes<T: Element + Copy, const N: usize>(
    array: &Bound<'_, PyArrayDyn<T>>,
    bytes: fn(T) -> [u8; N],
) -> Vec<u8> {
    array.readonly().as_array().iter().flat_map(|&value| bytes(value)).collect()
}
