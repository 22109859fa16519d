//! Options that are structs of named numbers, from and to Python.

use crate::numbers::one_or_more;
use ballbot_core::fields::Fields;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping};

/// The numbers of a mapping by name; `kind` names the mapping in messages.
pub(crate) fn named_numbers(kind: &str, options: &Bound<'_, PyMapping>) -> PyResult<Vec<(String, Vec<f64>)>> {
    let mut fields = Vec::new();
    for item in options.items()? {
        let (name, value): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item.extract()?;
        let Ok(name) = name.extract::<String>() else {
            return Err(PyTypeError::new_err(format!("{kind} has the key {}, expected names", name.repr()?)));
        };
        let values = one_or_more(&format!("{kind}.{name}"), &value).map_err(|error| {
            if !error.is_instance_of::<PyTypeError>(value.py()) {
                return error;
            }
            let found = value.get_type().name().map_or_else(|_| "this".to_owned(), |name| name.to_string());
            PyTypeError::new_err(format!("{kind}.{name} must be a number, or an array of numbers, not {found}"))
        })?;
        fields.push((name, values));
    }
    Ok(fields)
}

/// All fields by name: a number or a list each.
pub(crate) fn field_dict<'py, F: Fields>(py: Python<'py>, fields: &F) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (field, values) in F::FIELDS.iter().zip(fields.slices()) {
        match values {
            [number] => dict.set_item(field.name, number)?,
            numbers => dict.set_item(field.name, numbers)?,
        }
    }
    Ok(dict)
}
