//! A pool of info dicts for steps that end no episode; it avoids a thousand allocations per step.

use ballbot_core::batch::Outcome;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyInt, PyList};
use pyo3::{PyTraverseError, PyVisit};

/// Number of steps whose dicts are kept. The caller still refers to the dicts of the last step while the next one runs,
/// and a callback may refer to one more step.
const DICT_POOL_SIZE: usize = 3;

/// Entries of the info of every step.
const ENTRIES: usize = 3;

/// Pool of info dicts with what Stable-Baselines3 gets at every step. A dict is reused only if it has no other entry
/// and no other reference. A dict that the caller still references is replaced by a new dict.
#[derive(Default)]
pub(crate) struct StepInfos {
    pools: [Vec<Py<PyDict>>; DICT_POOL_SIZE],
    next: usize,
}

impl StepInfos {
    /// Visits the dicts for the garbage collector: reference cycles can pass through them.
    pub(crate) fn traverse(&self, visit: &PyVisit<'_>) -> Result<(), PyTraverseError> {
        self.pools.iter().flatten().try_for_each(|dict| visit.call(dict))
    }

    /// Releases all dicts.
    pub(crate) fn clear(&mut self) {
        self.pools.iter_mut().for_each(Vec::clear);
    }

    /// A new list of dicts without other references, each with [`ENTRIES`] of an environment whose episode continues.
    pub(crate) fn list<'py>(&mut self, py: Python<'py>, outcomes: &[Outcome]) -> PyResult<Bound<'py, PyList>> {
        let truncated = intern!(py, "TimeLimit.truncated");
        let is_success = intern!(py, "is_success");
        let termination = intern!(py, "termination");
        let [no, yes] = [false, true].map(|flag| PyBool::new(py, flag));
        let none = PyInt::new(py, 0);
        let dicts = &mut self.pools[self.next];
        self.next = (self.next + 1) % DICT_POOL_SIZE;
        dicts.resize_with(outcomes.len(), || PyDict::new(py).unbind());
        for (dict, outcome) in dicts.iter_mut().zip(outcomes) {
            // SAFETY: the pointer belongs to a live object, and the GIL is held.
            #[expect(unsafe_code, reason = "PyO3 has no safe reader of reference counts")]
            let owners = unsafe { pyo3::ffi::Py_REFCNT(dict.as_ptr()) };
            let fill = |dict: &Bound<'py, PyDict>| {
                // The caller may have changed the values.
                dict.set_item(truncated, no)?;
                dict.set_item(is_success, if outcome.success { &yes } else { &no })?;
                dict.set_item(termination, &none)
            };
            if owners == 1 {
                fill(dict.bind(py))?;
            }
            if owners > 1 || dict.bind(py).len() != ENTRIES {
                *dict = PyDict::new(py).unbind();
                fill(dict.bind(py))?;
            }
        }
        PyList::new(py, dicts.iter().map(|dict| dict.bind(py)))
    }
}
