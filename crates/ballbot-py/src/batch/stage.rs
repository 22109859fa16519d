//! Stages of a batch that are Python objects: custom tasks, and custom terms of tasks of the core.

use crate::values::convert::{elements, finite_elements};
use ballbot_core::batch::{BatchStage, CustomStage, RobotRows, StageLayout, StageResults};
use ballbot_core::task::{Row, Term};
use ballbot_core::{Error, Result};
use numpy::{Element, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use pyo3::{PyTraverseError, PyVisit};
use std::collections::HashSet;
use std::sync::{Arc, Mutex, PoisonError};

/// Python's stage: an object with the attributes and methods of `ballbot_rs.envs.own.stage.Stage`.
pub(crate) struct PyStage {
    object: Py<PyAny>,
    layout: StageLayout,
    /// The exception that ended the last call.
    raised: Mutex<Option<PyErr>>,
}

/// Names in descriptions live as long as the process; each is kept once.
fn interned(name: String) -> &'static str {
    static NAMES: Mutex<Option<HashSet<&'static str>>> = Mutex::new(None);
    let mut names = NAMES.lock().unwrap_or_else(PoisonError::into_inner);
    let names = names.get_or_insert_default();
    if let Some(known) = names.get(name.as_str()) {
        return known;
    }
    let kept: &'static str = Box::leak(name.into_boxed_str());
    names.insert(kept);
    kept
}

impl PyStage {
    /// The stage of an object.
    pub(crate) fn new(object: &Bound<'_, PyAny>) -> PyResult<Arc<Self>> {
        let terms: Vec<(String, f64)> = object.getattr("terms")?.extract()?;
        let rows: Vec<(String, String, f32, f64)> = object.getattr("rows")?.extract()?;
        let terminations: Vec<(String, String)> = object.getattr("terminations")?.extract()?;
        let name: Option<String> = object.getattr("name")?.extract()?;
        let layout = StageLayout {
            name: name.map(interned),
            terms: terms.into_iter().map(|(name, scale)| Term::reward(interned(name), scale, "custom")).collect(),
            rows: rows
                .into_iter()
                .map(|(name, unit, bound, typical)| Row::new(interned(name), interned(unit), bound, typical))
                .collect(),
            terminations: terminations.into_iter().map(|(name, when)| (interned(name), interned(when))).collect(),
            decides_success: object.getattr("decides_success")?.extract()?,
        };
        Ok(Arc::new(Self { object: object.clone().unbind(), layout, raised: Mutex::default() }))
    }

    /// The same as the core takes it.
    pub(crate) fn shared(self: &Arc<Self>) -> CustomStage {
        CustomStage(Arc::clone(self) as Arc<dyn BatchStage>)
    }

    /// The exception that ended the last call, in place of the error that it caused.
    pub(crate) fn error(&self, error: PyErr) -> PyErr {
        self.raised.lock().unwrap_or_else(PoisonError::into_inner).take().unwrap_or(error)
    }

    /// The object.
    pub(crate) fn object(&self, py: Python<'_>) -> Py<PyAny> {
        self.object.clone_ref(py)
    }

    /// Visits the object for the garbage collector.
    pub(crate) fn traverse(&self, visit: &PyVisit<'_>) -> std::result::Result<(), PyTraverseError> {
        visit.call(&self.object)
    }

    /// Calls a method of the object with the robots, and reads its result.
    fn call(
        &self,
        method: &str,
        robots: &RobotRows<'_>,
        read: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<()>,
    ) -> Result<()> {
        let called = Python::attach(|py| {
            let result = self.object.bind(py).call_method1(method, arguments(py, robots)?)?;
            read(&result)
        });
        called.map_err(|error| {
            *self.raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
            Error::Interrupted
        })
    }
}

/// A fresh array of rows that owns its numbers.
fn rows<'py, T: Element + Copy>(py: Python<'py>, n: usize, values: &[T]) -> PyResult<Bound<'py, PyArray2<T>>> {
    let array = PyArray2::zeros(py, [n, values.len().checked_div(n).unwrap_or(0)], false);
    array.readwrite().as_slice_mut()?.copy_from_slice(values);
    Ok(array)
}

/// Arrays of the robots: true rows, observed rows (the same array where the task observes the true state), commands,
/// steps, indices and keys.
fn arguments<'py>(py: Python<'py>, robots: &RobotRows<'_>) -> PyResult<Bound<'py, PyTuple>> {
    let n = robots.indices.len();
    let truth = rows(py, n, robots.truth)?;
    let observed = if robots.observed.is_empty() { truth.clone() } else { rows(py, n, robots.observed)? };
    let commands = rows(py, n, robots.commands)?;
    let steps = PyArray1::from_slice(py, robots.steps);
    let indices: Vec<i64> = robots.indices.iter().map(|index| *index as i64).collect();
    let indices = PyArray1::from_slice(py, &indices);
    let keys = rows(py, n, robots.keys.as_flattened())?;
    (truth, observed, commands, steps, indices, keys).into_pyobject(py)
}

/// Writes the finite rows of an array of shape (n, width).
fn fill(name: &str, value: &Bound<'_, PyAny>, n: usize, out: &mut [f64]) -> PyResult<()> {
    let width = out.len().checked_div(n).unwrap_or(0);
    out.copy_from_slice(&finite_elements(name, value, &[Some(n), Some(width)], out.len())?);
    Ok(())
}

impl BatchStage for PyStage {
    fn layout(&self) -> &StageLayout {
        &self.layout
    }

    fn begin(&self, robots: &RobotRows<'_>, rows: &mut [f64]) -> Result<()> {
        self.call("begin", robots, |found| fill("rows", found, robots.indices.len(), rows))
    }

    fn step(&self, robots: &RobotRows<'_>, results: &mut StageResults<'_>) -> Result<()> {
        let n = robots.indices.len();
        self.call("step", robots, |found| {
            let (terms, terminations, success, rows): (
                Bound<'_, PyAny>,
                Bound<'_, PyAny>,
                Bound<'_, PyAny>,
                Bound<'_, PyAny>,
            ) = found.extract()?;
            fill("terms", &terms, n, results.terms)?;
            let codes = finite_elements("terminations", &terminations, &[Some(n)], n)?;
            for (out, code) in results.terminations.iter_mut().zip(codes) {
                *out = code.clamp(0.0, self.layout.terminations.len() as f64) as u32;
            }
            results.success.copy_from_slice(&elements::<bool>("success", &success, &[Some(n)], n)?);
            fill("rows", &rows, n, results.rows)
        })
    }

    fn observe(&self, robots: &RobotRows<'_>, rows: &mut [f64]) -> Result<()> {
        self.call("observe", robots, |found| fill("rows", found, robots.indices.len(), rows))
    }
}
