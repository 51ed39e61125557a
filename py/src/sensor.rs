//! Python functions about sensors' files.

use pyo3::prelude::*;
use ruffini_core::{Result, scene, sensor::Sensor};
use serde_json::json;

use crate::{error::python_error, pool::in_pool};

/// Names of the built-in sensors.
#[pyfunction]
pub(crate) fn sensor_names() -> Vec<&'static str> {
    Sensor::names().collect()
}

/// A sensor's file with every key explained.
#[pyfunction]
pub(crate) fn sensor_template() -> String {
    ruffini_core::sensor::template()
}

/// Contents of a sensor's file, as JSON; numbers that are not finite are null. Given the `text` of
/// the file, it is not opened.
#[pyfunction]
#[pyo3(signature = (name, text = None))]
pub(crate) fn read_sensor(name: &str, text: Option<&str>) -> PyResult<String> {
    let sensor = text.map_or_else(|| Sensor::open(name), |text| Sensor::parse(name, text));
    Ok(json!(sensor.map_err(python_error)?).to_string())
}

/// Coefficients of the elastic foundation that fit the gel of a sensor with a calibration best, and
/// their relative errors, as JSON.
#[pyfunction]
pub(crate) fn fit_foundation(
    py: Python<'_>,
    name: &str,
    calibration: &str,
    nodes: usize,
) -> PyResult<String> {
    let fit = || -> Result<_> {
        let sensor = Sensor::open(name)?;
        scene::fit_foundation(&sensor, sensor.calibration(Some(calibration))?, nodes)
    };
    let fitted = in_pool(py, fit)?.map_err(python_error)?;
    let errors = fitted.errors.iter().map(|error| {
        let scene::FoundationError { indenter, normal, tangential } = error;
        json!({"indenter": indenter, "normal": normal, "tangential": tangential})
    });
    let errors: Vec<_> = errors.collect();
    Ok(json!({"foundation": fitted.foundation, "errors": errors}).to_string())
}
