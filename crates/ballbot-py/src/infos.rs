//! Empty info dicts, one for each environment and step, without making a thousand objects a step.

use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use pyo3::{PyTraverseError, PyVisit};

/// How many steps a caller may look back at before dicts are made anew: the step before the last is still in the caller's
/// hands while the next one runs, and a callback may hold one more.
const DICT_POOL_SIZE: usize = 3;

/// Dicts that were handed out and came back: a dict is handed out again only if nobody else refers to it any more and
/// nothing was written into it. Otherwise it is the caller's for good, and a new one takes its place.
#[derive(Default)]
pub(crate) struct EmptyInfos {
    generations: [Vec<Py<PyDict>>; DICT_POOL_SIZE],
    next: usize,
}

impl EmptyInfos {
    /// Shows the garbage collector what callers may have tied to us.
    pub(crate) fn traverse(&self, visit: &PyVisit<'_>) -> Result<(), PyTraverseError> {
        self.generations.iter().flatten().try_for_each(|dict| visit.call(dict))
    }

    /// Lets go of all dicts.
    pub(crate) fn clear(&mut self) {
        self.generations.iter_mut().for_each(Vec::clear);
    }

    /// `n` empty dicts that nobody else refers to, in a new list.
    pub(crate) fn list<'py>(&mut self, py: Python<'py>, n: usize) -> PyResult<Bound<'py, PyList>> {
        let dicts = &mut self.generations[self.next];
        self.next = (self.next + 1) % DICT_POOL_SIZE;
        dicts.resize_with(n, || PyDict::new(py).unbind());
        for dict in dicts.iter_mut() {
            // SAFETY: the pointer is that of a live object, and the GIL is held.
            #[expect(unsafe_code, reason = "PyO3 has no safe reader of reference counts")]
            let owners = unsafe { pyo3::ffi::Py_REFCNT(dict.as_ptr()) };
            if owners > 1 || !dict.bind(py).is_empty() {
                *dict = PyDict::new(py).unbind();
            }
        }
        PyList::new(py, dicts.iter().map(|dict| dict.bind(py)))
    }
}
