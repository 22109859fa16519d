//! Keywords that a class or function does not have.

use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The error about a keyword of `who`, such as `State.at_rest`, which `ballbot_rs._keywords` writes; `more` are names
/// that the signature does not list.
pub(crate) fn unknown(py: Python<'_>, who: &str, name: &str, more: &[&str]) -> PyErr {
    let error = || py.import("ballbot_rs._keywords")?.getattr("of_extension")?.call1((who, name, more.to_vec()));
    error().map_or_else(|error| error, PyErr::from_value)
}

/// Checks that there are no other keywords.
pub(crate) fn no_others(who: &str, others: Option<&Bound<'_, PyDict>>) -> PyResult<()> {
    match others.and_then(|others| others.keys().iter().next()) {
        Some(name) => Err(unknown(name.py(), who, &name.extract::<String>()?, &[])),
        None => Ok(()),
    }
}
