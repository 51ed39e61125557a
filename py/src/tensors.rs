//! Named arrays and a text, the card, as the bytes of a [`TensorFile`].

use std::collections::BTreeMap;

use numpy::{Element, PyArray1, PyArrayDyn, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::{
    prelude::*,
    types::{PyBytes, PyDict},
};
use ruffini_core::tensor_file::{Dtype, TensorFile, TensorView};

use crate::mechanics::arrays::refused;

/// Reads the arrays (float32 or float64) by name, and the card, from the bytes of a safetensors
/// file.
#[pyfunction]
pub(crate) fn read_tensors<'py>(
    py: Python<'py>,
    data: &[u8],
) -> PyResult<(Bound<'py, PyDict>, String)> {
    let file = TensorFile::read(data)
        .map_err(|found| refused("data", found, "a whole file of tensors with their card"))?;
    let arrays = PyDict::new(py);
    for (name, view) in file.tensors {
        match view.dtype() {
            Dtype::F32 => arrays.set_item(name, array(py, &view, f32::from_le_bytes)?)?,
            Dtype::F64 => arrays.set_item(name, array(py, &view, f64::from_le_bytes)?)?,
            other => return Err(refused(&name, format!("{other:?}"), "F32 or F64")),
        }
    }
    Ok((arrays, file.card))
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
        parts.insert(name.clone(), (dtype, array.shape().to_vec(), bytes));
    }
    Ok(PyBytes::new(py, &TensorFile::to_bytes(parts, card)))
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
