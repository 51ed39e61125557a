//! Conversion of numbers between Python and Rust. Inputs are anything that numpy converts to an
//! array, and are checked; outputs are numpy arrays of float64 and uint32.

use std::{fmt::Display, ops::RangeInclusive};

use nalgebra::Vector3;
use numpy::{
    Element, PyArray2, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyUntypedArray,
    PyUntypedArrayMethods, ndarray::Array2,
};
use pyo3::prelude::*;
use ruffini_core::Error;

use crate::error::python_error;

/// `ValueError` that states what was found and what was expected.
pub(crate) fn refused(name: &str, found: impl Display, expected: impl Into<String>) -> PyErr {
    python_error(Error::invalid(name, found, expected))
}

/// Returns `value` if it is in `range`, else an error.
pub(crate) fn ranged(name: &str, value: i64, range: RangeInclusive<i64>) -> PyResult<u32> {
    let expected = format!("{} to {}", range.start(), range.end());
    let within = u32::try_from(value).ok().filter(|_| range.contains(&value));
    within.ok_or_else(|| refused(name, value, expected))
}

/// Returns `value` as a count, or an error if it is negative. What else is `expected`, the crate
/// checks.
pub(crate) fn count(name: &str, value: i64, expected: &str) -> PyResult<usize> {
    usize::try_from(value).map_err(|_| refused(name, value, expected))
}

/// Finite numbers in C order, and the shape of the array that held them.
pub(crate) fn numbers(
    name: &str,
    found: &Bound<'_, PyAny>,
    expected: &str,
) -> PyResult<(Vec<f64>, Vec<usize>)> {
    let (values, shape) = numbers_or_nan(name, found, expected)?;
    match values.iter().find(|x| x.is_nan()) {
        Some(x) => Err(refused(name, x, "finite numbers")),
        None => Ok((values, shape)),
    }
}

/// As `numbers`, of which some may be NaN.
pub(crate) fn numbers_or_nan(
    name: &str,
    found: &Bound<'_, PyAny>,
    expected: &str,
) -> PyResult<(Vec<f64>, Vec<usize>)> {
    let (values, shape) = array::<f64>(name, found, expected, b"fiu")?;
    match values.iter().find(|x| x.is_infinite()) {
        Some(x) => Err(refused(name, x, "finite numbers")),
        None => Ok((values, shape)),
    }
}

/// Rows of N numbers, from an array (…, N).
pub(crate) fn rows<const N: usize>(
    name: &str,
    found: &Bound<'_, PyAny>,
) -> PyResult<Vec<[f64; N]>> {
    let expected = format!("numbers (…, {N})");
    let (values, shape) = numbers(name, found, &expected)?;
    if shape.len() != 2 || shape[1] != N {
        return Err(refused(name, Shown(&shape), expected));
    }
    Ok(values.as_chunks().0.to_vec())
}

/// N numbers, from an array (N).
pub(crate) fn vector<const N: usize>(name: &str, found: &Bound<'_, PyAny>) -> PyResult<[f64; N]> {
    let expected = format!("numbers ({N},)");
    let (values, shape) = numbers(name, found, &expected)?;
    values
        .try_into()
        .ok()
        .filter(|_| shape.len() == 1)
        .ok_or_else(|| refused(name, Shown(&shape), expected))
}

/// Rows of N indices, from an array (…, N).
pub(crate) fn index_rows<const N: usize>(
    name: &str,
    found: &Bound<'_, PyAny>,
) -> PyResult<Vec<[u32; N]>> {
    let expected = format!("integers (…, {N})");
    let (values, shape) = array::<i64>(name, found, &expected, b"iu")?;
    if shape.len() != 2 || shape[1] != N {
        return Err(refused(name, Shown(&shape), expected));
    }
    Ok(unsigned(name, values)?.as_chunks().0.to_vec())
}

/// List of indices, from an array of them (…,), or of `length` booleans that are true for them.
pub(crate) fn indices(name: &str, found: &Bound<'_, PyAny>, length: usize) -> PyResult<Vec<u32>> {
    // numpy converts an empty list to an array of floats.
    if found.len().is_ok_and(|length| length == 0) {
        return Ok(Vec::new());
    }
    let expected = format!("integers (…,), or booleans ({length},)");
    if let Ok((chosen, shape)) = array::<bool>(name, found, &expected, b"b") {
        if shape != [length] {
            let found = format!("{} of bool", Shown(&shape));
            return Err(refused(name, found, expected));
        }
        return Ok((0..).zip(chosen).filter_map(|(i, chosen)| chosen.then_some(i)).collect());
    }
    let (values, shape) = array::<i64>(name, found, &expected, b"iu")?;
    if shape.len() != 1 {
        return Err(refused(name, Shown(&shape), expected));
    }
    unsigned(name, values)
}

fn unsigned(name: &str, values: Vec<i64>) -> PyResult<Vec<u32>> {
    let convert = |i: i64| {
        u32::try_from(i).map_err(|_| refused(name, i, format!("indices from 0 to {}", u32::MAX)))
    };
    values.into_iter().map(convert).collect()
}

/// Values of an array as `T`, and its shape; an error if its kind of numbers is not among `kinds`
/// (numpy's letters).
fn array<T: Element + Copy>(
    name: &str,
    found: &Bound<'_, PyAny>,
    expected: &str,
    kinds: &[u8],
) -> PyResult<(Vec<T>, Vec<usize>)> {
    let py = found.py();
    let made = py.import("numpy")?.call_method1("asarray", (found,));
    let made = made.map_err(|error| refused(name, error.value(py), expected))?;
    let untyped = made.cast::<PyUntypedArray>()?;
    if !kinds.contains(&untyped.dtype().kind()) {
        let found = format!("{} of {}", Shown(untyped.shape()), untyped.dtype());
        return Err(refused(name, found, expected));
    }
    let typed = made.call_method1("astype", (numpy::dtype::<T>(py),))?;
    let typed = typed.cast_into::<PyArrayDyn<T>>()?.readonly();
    Ok((typed.as_array().iter().copied().collect(), untyped.shape().to_vec()))
}

/// Array shape as in error messages: `array (3, 2)`.
pub(crate) struct Shown<'a>(pub(crate) &'a [usize]);

impl Display for Shown<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            [] => f.write_str("one number"),
            [one] => write!(f, "array ({one},)"),
            many => {
                let sizes: Vec<_> = many.iter().map(usize::to_string).collect();
                write!(f, "array ({})", sizes.join(", "))
            }
        }
    }
}

/// Array (…, N) of the given rows.
pub(crate) fn array_of_rows<T: Element + Copy, const N: usize>(
    py: Python<'_>,
    rows: impl ExactSizeIterator<Item = [T; N]>,
) -> Bound<'_, PyArray2<T>> {
    let count = rows.len();
    let values = Array2::from_shape_vec((count, N), rows.flatten().collect());
    PyArray2::from_owned_array(py, values.expect("every row has N values"))
}

/// Array (…, 3) of vectors.
pub(crate) fn array_of_vectors<'py>(
    py: Python<'py>,
    vectors: &[Vector3<f64>],
) -> Bound<'py, PyArray2<f64>> {
    array_of_rows(py, vectors.iter().map(|&v| v.into()))
}

/// Makes the array read-only: it is a copy, so changes to it would have no effect on the original.
pub(crate) fn read_only<T>(array: Bound<'_, T>) -> PyResult<Py<T>> {
    array.as_any().call_method1("setflags", (false,))?;
    Ok(array.unbind())
}

/// Rows of an array (V, 3) as vectors.
pub(super) fn vectors(array: &Bound<'_, PyArray2<f64>>) -> PyResult<Vec<Vector3<f64>>> {
    let numbers: Vec<f64> = array.try_readonly()?.as_array().iter().copied().collect();
    Ok(numbers.as_chunks::<3>().0.iter().map(|&v| v.into()).collect())
}
