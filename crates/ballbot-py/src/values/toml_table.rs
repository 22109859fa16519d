//! TOML as Python objects.

use crate::errors::to_python;
use ballbot_core::Error;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use toml::{Table, Value};

fn to_object<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::String(text) => text.into_pyobject(py)?.into_any(),
        Value::Integer(whole) => whole.into_pyobject(py)?.into_any(),
        Value::Float(number) => number.into_pyobject(py)?.into_any(),
        Value::Boolean(flag) => flag.into_pyobject(py)?.to_owned().into_any(),
        Value::Datetime(time) => time.to_string().into_pyobject(py)?.into_any(),
        Value::Array(values) => {
            PyList::new(py, values.iter().map(|value| to_object(py, value)).collect::<PyResult<Vec<_>>>()?)?.into_any()
        }
        Value::Table(table) => to_dict(py, table)?.into_any(),
    })
}

fn to_dict<'py>(py: Python<'py>, table: &Table) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (name, value) in table {
        dict.set_item(name, to_object(py, value)?)?;
    }
    Ok(dict)
}

/// The table of a TOML text. The parser limits how deep it nests.
#[pyfunction]
pub(crate) fn _toml_table<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyDict>> {
    let table: Table = text.parse().map_err(|error: toml::de::Error| {
        to_python(Error::Decode { what: "TOML".into(), reason: error.to_string().trim_end().to_owned() })
    })?;
    to_dict(py, &table)
}
