//! Events of a task's environments, from and to Python.

use crate::errors::{call, to_python};
use crate::values::numbers::real;
use ballbot_core::batch::{Batch, Event, Value, event_sets, load_events as load};
use numpy::{PyArray1, PyArrayMethods, PyUntypedArray};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyInt, PyList, PyMapping, PySequence, PyString};
use std::path::PathBuf;

/// Maximum number of values of a list, and how deep lists may be nested.
const MAX_VALUES: usize = 64;
const MAX_DEPTH: usize = 3;

/// Events: the name of a set, the path of a TOML file, a dict or a list of dicts; None means no events.
pub(crate) fn events(given: &Bound<'_, PyAny>) -> PyResult<Vec<Event>> {
    if given.is_none() {
        return Ok(Vec::new());
    }
    if given.is_instance_of::<PyString>() || given.hasattr("__fspath__")? {
        let path: PathBuf = given.extract()?;
        return call(|| load(&path.to_string_lossy()));
    }
    if let Ok(one) = given.cast::<PyDict>() {
        return Ok(vec![event(0, one.as_mapping())?]);
    }
    let wrong = |found: &Bound<'_, PyAny>| -> PyErr {
        let kind = found.get_type().name().map_or_else(|_| "this".to_owned(), |name| name.to_string());
        PyTypeError::new_err(format!(
            "events must be the name of a set, the path of a TOML file, a dict or a list of dicts, not {kind}"
        ))
    };
    let list = given.cast::<PyList>().map(|list| list.as_sequence().clone());
    let list = list.or_else(|_| given.cast::<pyo3::types::PyTuple>().map(|tuple| tuple.as_sequence().clone()));
    let list: Bound<'_, PySequence> = list.map_err(|_| wrong(given))?;
    let mut events = Vec::new();
    for (place, item) in list.try_iter()?.enumerate() {
        let item = item?;
        let entries = item.cast::<PyMapping>().map_err(|_| wrong(&item))?;
        events.push(event(place, entries)?);
    }
    Ok(events)
}

fn event(place: usize, entries: &Bound<'_, PyMapping>) -> PyResult<Event> {
    let mut read = Vec::new();
    for item in entries.items()?.try_iter()? {
        let (key, item): (String, Bound<'_, PyAny>) =
            item?.extract().map_err(|_| PyTypeError::new_err(format!("events[{place}] has a key that is not text")))?;
        let value = value(&item, MAX_DEPTH).ok_or_else(|| {
            PyTypeError::new_err(format!("events[{place}]: {key} is not a number, text, or a list of them"))
        })?;
        read.push((key, value));
    }
    Event::from_entries(place, &read).map_err(to_python)
}

/// A value of a key; None for a type that no key has.
fn value(given: &Bound<'_, PyAny>, depth: usize) -> Option<Value> {
    if let Ok(flag) = given.cast::<PyBool>() {
        return Some(Value::Flag(flag.is_true()));
    }
    if let Ok(text) = given.cast::<PyString>() {
        return text.extract().ok().map(Value::Text);
    }
    if let Ok(whole) = given.cast::<PyInt>() {
        // A number that does not fit an integer type is out of every range.
        return Some(whole.extract().map_or_else(|_| Value::Other("a number beyond ±2^63".to_owned()), Value::Whole));
    }
    if let Ok(number) = real(given) {
        return Some(Value::Number(number));
    }
    let is_list = given.is_instance_of::<PyList>()
        || given.is_instance_of::<pyo3::types::PyTuple>()
        || given.is_instance_of::<PyUntypedArray>();
    if !is_list || depth == 0 || given.len().ok()? > MAX_VALUES {
        return None;
    }
    let values = given.try_iter().ok()?.map(|item| value(&item.ok()?, depth - 1));
    values.collect::<Option<Vec<_>>>().map(Value::List)
}

fn to_object<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::Whole(number) => number.into_pyobject(py)?.into_any(),
        Value::Number(number) => number.into_pyobject(py)?.into_any(),
        Value::Flag(flag) => flag.into_pyobject(py)?.to_owned().into_any(),
        Value::Text(text) | Value::Other(text) => text.into_pyobject(py)?.into_any(),
        Value::List(values) => {
            PyList::new(py, values.iter().map(|value| to_object(py, value)).collect::<PyResult<Vec<_>>>()?)?.into_any()
        }
    })
}

/// Events as a list of dicts.
pub(crate) fn to_list<'py>(py: Python<'py>, events: &[Event]) -> PyResult<Bound<'py, PyList>> {
    let list = PyList::empty(py);
    for event in events {
        let dict = PyDict::new(py);
        for (key, value) in event.entries() {
            dict.set_item(key, to_object(py, &value)?)?;
        }
        list.append(dict)?;
    }
    Ok(list)
}

/// Result of [`crate::batch::PyBatch::draws`].
pub(crate) fn draws<'py>(py: Python<'py>, batch: &Batch, index: Option<usize>) -> PyResult<Bound<'py, PyDict>> {
    let chosen = match index {
        None => 0..batch.len(),
        Some(index) => {
            batch.check_index(index).map_err(to_python)?;
            index..index + 1
        }
    };
    let dict = PyDict::new(py);
    let mut first = 0;
    for (label, width) in batch.draw_columns() {
        let mut values = Vec::with_capacity(chosen.len() * width);
        for i in chosen.clone() {
            values.extend_from_slice(&batch.draws(i).map_err(to_python)?[first..first + width]);
        }
        match (index, width) {
            (Some(_), 1) => dict.set_item(label, values[0])?,
            (Some(_), _) | (None, 1) => dict.set_item(label, PyArray1::from_vec(py, values))?,
            (None, _) => dict.set_item(label, PyArray1::from_vec(py, values).reshape([chosen.len(), width])?)?,
        }
        first += width;
    }
    Ok(dict)
}

/// Recorded draws of all robots by term, `rows` of each.
pub(crate) fn draw_records<'py>(
    py: Python<'py>,
    batch: &Batch,
    values: &[f64],
    rows: usize,
) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let all: usize = batch.draw_columns().map(|(_, width)| width).sum();
    let mut first = 0;
    for (label, width) in batch.draw_columns() {
        let of_term = values.chunks_exact(all).flat_map(|row| &row[first..first + width]);
        let array = PyArray1::from_iter(py, of_term.copied());
        match width {
            1 => dict.set_item(label, array.reshape([rows, batch.len()])?)?,
            _ => dict.set_item(label, array.reshape([rows, batch.len(), width])?)?,
        }
        first += width;
    }
    Ok(dict)
}

/// Events by name or from a TOML file, as a list of dicts, one per event, as `events=` takes them.
///
/// ```python
/// mild = bb.load_events("mild")
/// batch = bb.Batch(8, events=[*mild, {"term": "gravity", "op": "scale", "range": [0.99, 1.01]}])
/// ```
///
/// Args:
///     name_or_path: "mild", "hard", "wide", or the path of a TOML file with tables `[[events]]`, which ends in ".toml"; also
///         such dicts, which are checked and completed.
///
/// Raises:
///     ValueError: an unknown name, malformed TOML, or an event with an unknown or missing key or a value of the wrong
///         kind; the message has its index and term.
///     TypeError: something else.
///     OSError: the file cannot be read.
#[pyfunction]
pub(crate) fn load_events<'py>(py: Python<'py>, name_or_path: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyList>> {
    to_list(py, &events(name_or_path)?)
}

/// Adds the tables of names.
pub(crate) fn add_to(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("EVENT_SETS", event_sets())?;
    module.add_function(wrap_pyfunction!(load_events, module)?)
}
