//! Single numbers from Python.

use crate::errors::InvalidInputError;
use crate::values::convert::{OPTION_COUNT, elements, objects, shaped};
use numpy::PyUntypedArray;
use pyo3::exceptions::PyOverflowError;
use pyo3::prelude::*;
use pyo3::types::{PyFloat, PyInt};

/// A real number: an int, a float, or anything that NumPy treats as a number.
pub(crate) fn real(value: &Bound<'_, PyAny>) -> PyResult<f64> {
    if value.is_instance_of::<PyFloat>() || value.is_instance_of::<PyInt>() {
        return value.extract();
    }
    // NumPy's own scalars are identified by their dtype: `float` would accept a time as a number.
    if value.hasattr("dtype")? {
        return Ok(shaped::<f64, 0>("the value", value, [])?[0]);
    }
    value.extract()
}

/// [`real`], or None.
pub(crate) fn optional_real(value: &Bound<'_, PyAny>) -> PyResult<Option<f64>> {
    if value.is_none() { Ok(None) } else { real(value).map(Some) }
}

/// The numbers of an array, or a single number. `name` is for messages.
pub(crate) fn one_or_more(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    let array = value.is_instance_of::<PyUntypedArray>();
    match if array { None } else { real(value).ok() } {
        Some(number) => Ok(vec![number]),
        None if value.hasattr("ndim")? && value.getattr("ndim")?.eq(0)? => shaped(name, value, []),
        None => elements(name, value, &[None], OPTION_COUNT),
    }
}

/// A whole number.
pub(crate) fn whole(value: &Bound<'_, PyAny>) -> PyResult<i64> {
    value.extract::<i64>().map_err(|error| out_of_range(value, &error, "within ±2^63").unwrap_or(error))
}

/// [`whole`], or None.
pub(crate) fn optional_whole(value: &Bound<'_, PyAny>) -> PyResult<Option<i64>> {
    if value.is_none() { Ok(None) } else { whole(value).map(Some) }
}

/// A seed.
pub(crate) fn seed(value: &Bound<'_, PyAny>) -> PyResult<u64> {
    let limit = "from 0 to 2^64 - 1, to be a seed";
    value.extract::<u64>().map_err(|error| out_of_range(value, &error, limit).unwrap_or(error))
}

/// Seeds by environment, None where there is none.
pub(crate) fn seeds(value: &Bound<'_, PyAny>, n: usize) -> PyResult<Vec<Option<u64>>> {
    let one = |value: &Bound<'_, PyAny>| if value.is_none() { Ok(None) } else { seed(value).map(Some) };
    objects("seeds", value, n)?.iter().map(one).collect()
}

/// The index of an environment.
pub(crate) fn index(value: &Bound<'_, PyAny>) -> PyResult<usize> {
    let limit = "from 0 to num_envs - 1, to be the index of an environment";
    value.extract::<usize>().map_err(|error| out_of_range(value, &error, limit).unwrap_or(error))
}

/// [`index`], or None.
pub(crate) fn optional_index(value: &Bound<'_, PyAny>) -> PyResult<Option<usize>> {
    if value.is_none() { Ok(None) } else { index(value).map(Some) }
}

/// The error for a whole number that does not fit an integer type.
fn out_of_range(value: &Bound<'_, PyAny>, error: &PyErr, limit: &str) -> Option<PyErr> {
    error.is_instance_of::<PyOverflowError>(value.py()).then(|| {
        // Python declines to write out the largest numbers.
        let text = value.str().map_or_else(|_| "a number of thousands of digits".to_owned(), |text| text.to_string());
        InvalidInputError::new_err(format!("{text} is out of range: it must be {limit}"))
    })
}

/// A count from Python.
pub(crate) fn count(name: &str, value: i64, least: i64) -> PyResult<usize> {
    usize::try_from(value)
        .ok()
        .filter(|_| value >= least)
        .ok_or_else(|| InvalidInputError::new_err(format!("{name} = {value}, it must be at least {least}")))
}
