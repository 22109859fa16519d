//! Instruments that observe the ground, and levels of terrains, from and to Python.

use crate::errors::to_python;
use crate::values::fields::{dict_of, named_numbers};
use ballbot_core::batch::{Batch, Levels};
use ballbot_core::perception::{AnyInstrument, Instruments, instrument_kind, instrument_kinds};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping, PyString};
use std::sync::Arc;

/// An instrument by its name, from None (none) or a mapping of its options.
pub(crate) fn instrument(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Option<Arc<dyn AnyInstrument>>> {
    if value.is_none() {
        return Ok(None);
    }
    let Ok(options) = value.cast::<PyMapping>() else {
        let kind = value.get_type().name()?;
        return Err(PyTypeError::new_err(format!("{name} must be a dict of options or None, not {kind}")));
    };
    let numbers = named_numbers(name, options)?;
    let options: Vec<_> = numbers.iter().map(|(name, values)| (name.as_str(), values.as_slice())).collect();
    let kind = instrument_kind(name).map_err(to_python)?;
    (kind.make)(&options).map(Some).map_err(to_python)
}

/// Sets every instrument by its name in a dict of options: its options, or None.
pub(crate) fn set_instruments(resolved: &Bound<'_, PyDict>, instruments: &Instruments) -> PyResult<()> {
    for kind in instrument_kinds() {
        let options = instruments.get(kind.name).map(|instrument| dict_of(resolved.py(), instrument.options()));
        resolved.set_item(kind.name, options.transpose()?)?;
    }
    Ok(())
}

type Bounds<'py> = (Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<f32>>);

/// Least and largest numbers, float32, of the readings of the instruments in options of an environment, in the order of an observation.
#[pyfunction]
pub(crate) fn reading_bounds<'py>(
    py: Python<'py>,
    options: &Bound<'py, PyMapping>,
    scaled: bool,
) -> PyResult<Bounds<'py>> {
    let (mut low, mut high) = (Vec::new(), Vec::new());
    for kind in instrument_kinds() {
        if !options.contains(kind.name)? {
            continue;
        }
        if let Some(instrument) = instrument(kind.name, &options.get_item(kind.name)?)? {
            let count = instrument.shape().iter().product::<usize>();
            let [least, largest] = instrument.bounds(scaled);
            low.resize(low.len() + count, least);
            high.resize(high.len() + count, largest);
        }
    }
    Ok((PyArray1::from_vec(py, low), PyArray1::from_vec(py, high)))
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

/// Readings of an instrument, one array per robot, or the array of robot `index`.
pub(crate) fn perceived<'py>(
    py: Python<'py>,
    batch: &Batch,
    name: &str,
    index: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    if let Some(index) = index {
        batch.check_index(index).map_err(to_python)?;
    }
    let shape = batch.instrument(name).map_err(to_python)?.shape();
    let chosen = index.map_or(0..batch.len(), |index| index..index + 1);
    let mut values = Vec::with_capacity(chosen.len() * shape.iter().product::<usize>());
    let leading = index.is_none().then_some(chosen.len());
    for i in chosen {
        values.extend_from_slice(batch.perceived(i, name).map_err(to_python)?);
    }
    let shape: Vec<_> = leading.into_iter().chain(shape.iter().copied()).collect();
    Ok(PyArray1::from_vec(py, values).reshape(shape)?.into_any())
}
