//! Options that are structs of named numbers, from and to Python.

use crate::errors::{call, to_python};
use crate::robot::params::toml_path;
use crate::values::numbers::one_or_more;
use ballbot_core::fields::Fields;
use ballbot_core::options::PublishedOptions;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping};
use std::path::Path;

/// Options with presets, from Python.
pub(crate) trait Door: PublishedOptions {
    /// The files that have them, in messages.
    const FILES: &'static str;

    /// Options from a file other than TOML; `None` for a path of no such file.
    fn of_other_file(_path: &Path) -> Option<PyResult<Self>> {
        None
    }
}

/// Options from None, a mapping of options, a name or the path of a file.
pub(crate) fn option<O: Door>(value: &Bound<'_, PyAny>) -> PyResult<Option<O>> {
    if value.is_none() {
        return Ok(None);
    }
    if let Ok(options) = value.cast::<PyMapping>() {
        let fields = named_numbers(O::NAME, options)?;
        let fields = fields.iter().map(|(name, values)| (name.as_str(), values.as_slice()));
        return O::from_fields(fields).map(Some).map_err(to_python);
    }
    named(value, O::NAME, &format!("a dict of options, a name, the path of {}, or None", O::FILES)).map(Some)
}

/// All options by name, of a name or the path of a file.
pub(crate) fn load<'py, O: Door>(py: Python<'py>, value: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    field_dict(py, &named::<O>(value, "name_or_path", &format!("a name or the path of {}", O::FILES))?)
}

/// Options from a name or the path of a file; messages have the argument's name and what is `expected`.
fn named<O: Door>(value: &Bound<'_, PyAny>, argument: &str, expected: &str) -> PyResult<O> {
    if let Some(path) = toml_path(value) {
        return O::of_other_file(&path).unwrap_or_else(|| call(|| O::from_toml_file(&path)));
    }
    let Ok(name) = value.extract::<String>() else {
        let kind = value.get_type().name()?;
        return Err(PyTypeError::new_err(format!("{argument} must be {expected}, not {kind}")));
    };
    O::of_other_file(Path::new(&name)).unwrap_or_else(|| O::preset(&name).map_err(to_python))
}

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
    dict_of(py, F::FIELDS.iter().map(|field| field.name).zip(fields.slices()))
}

/// Named values as a dict: a number or a list each.
pub(crate) fn dict_of<'py, 'v>(
    py: Python<'py>,
    fields: impl IntoIterator<Item = (&'static str, &'v [f64])>,
) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (name, values) in fields {
        match values {
            [number] => dict.set_item(name, number)?,
            numbers => dict.set_item(name, numbers)?,
        }
    }
    Ok(dict)
}

/// All fields by name, or None.
pub(crate) fn optional_dict<F: Fields>(py: Python<'_>, fields: Option<&F>) -> PyResult<Option<Py<PyDict>>> {
    fields.map(|fields| field_dict(py, fields).map(Bound::unbind)).transpose()
}
