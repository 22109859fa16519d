//! Instruments that observe the ground, and levels of terrains, from and to Python.

use crate::errors::to_python;
use crate::fields::{field_dict, named_numbers};
use ballbot_core::batch::{Batch, Levels};
use ballbot_core::perception::Instrument;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping, PyString};

/// Options of an instrument from None (none) or a mapping.
pub(crate) fn instrument<I: Instrument>(value: &Bound<'_, PyAny>) -> PyResult<Option<I>> {
    if value.is_none() {
        return Ok(None);
    }
    let Ok(options) = value.cast::<PyMapping>() else {
        let kind = value.get_type().name()?;
        return Err(PyTypeError::new_err(format!("{} must be a dict of options or None, not {kind}", I::NAME)));
    };
    let fields = named_numbers(I::NAME, options)?;
    let fields = fields.iter().map(|(name, values)| (name.as_str(), values.as_slice()));
    I::from_fields(fields).map(Some).map_err(to_python)
}

/// All options of an instrument by name; None for robots without it.
pub(crate) fn instrument_object<I: Instrument>(py: Python<'_>, options: Option<&I>) -> PyResult<Option<Py<PyDict>>> {
    options.map(|options| field_dict(py, options).map(Bound::unbind)).transpose()
}

/// The name of the curriculum of levels.
const CURRICULUM: &str = "curriculum";

/// Levels from None (any), a number or "curriculum".
pub(crate) fn levels(value: &Bound<'_, PyAny>) -> PyResult<Levels> {
    if value.is_none() {
        return Ok(Levels::Any);
    }
    if let Ok(name) = value.cast::<PyString>() {
        return match name.to_str()? {
            CURRICULUM => Ok(Levels::Curriculum),
            other => {
                Err(PyValueError::new_err(format!("level = '{other}', expected a number, \"{CURRICULUM}\" or None")))
            }
        };
    }
    let number: i64 = value.extract().map_err(|_| {
        let kind = value.get_type().name().map_or_else(|_| "this".to_owned(), |name| name.to_string());
        PyTypeError::new_err(format!("level must be a whole number, \"{CURRICULUM}\" or None, not {kind}"))
    })?;
    let level = usize::try_from(number)
        .map_err(|_| PyValueError::new_err(format!("level = {number}, it must be at least 0")))?;
    Ok(Levels::One(level))
}

/// Levels in the form of an option.
pub(crate) fn levels_object(py: Python<'_>, levels: Levels) -> PyResult<Bound<'_, PyAny>> {
    Ok(match levels {
        Levels::Any => py.None().into_bound(py),
        Levels::One(level) => level.into_pyobject(py)?.into_any(),
        Levels::Curriculum => PyString::new(py, CURRICULUM).into_any(),
    })
}

/// The error for reading an instrument that the robots do not have.
pub(crate) fn missing(name: &str) -> PyErr {
    PyValueError::new_err(format!(
        "the robots have no {name}: make the environments with {name}={{}}, or options in it"
    ))
}

/// Readings of an instrument, one array per robot, or the array of robot `index`; `shape` is the shape of one reading.
pub(crate) fn perceived<'py>(
    py: Python<'py>,
    batch: &Batch,
    index: Option<usize>,
    which: usize,
    [rows, columns]: [usize; 2],
) -> PyResult<Bound<'py, PyAny>> {
    if let Some(index) = index {
        batch.check_index(index).map_err(to_python)?;
    }
    let chosen = index.map_or(0..batch.len(), |index| index..index + 1);
    let mut values = Vec::with_capacity(chosen.len() * rows * columns);
    for i in chosen.clone() {
        values.extend_from_slice(batch.perceived(i).map_err(to_python)?[which]);
    }
    let array = PyArray1::from_vec(py, values);
    Ok(match index {
        Some(_) => array.reshape([rows, columns])?.into_any(),
        None => array.reshape([chosen.len(), rows, columns])?.into_any(),
    })
}
