//! Long computations without the GIL that Python's signals (Ctrl-C) can interrupt.

use crate::errors::call;
use pyo3::prelude::*;
use std::cell::RefCell;
use std::rc::Rc;

/// Runs a call into the core without the GIL. About every 50 ms it lets Python handle its signals; an exception of a
/// handler, such as KeyboardInterrupt, ends the call.
pub(crate) fn interruptible<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> ballbot_core::Result<T> + Send,
) -> PyResult<T> {
    py.detach(|| {
        let raised: Rc<RefCell<Option<PyErr>>> = Rc::default();
        let handler = Rc::clone(&raised);
        let stop = move || {
            let signals = Python::attach(|py| py.check_signals());
            signals.map_err(|error| *handler.borrow_mut() = Some(error)).is_err()
        };
        let result = call(|| ballbot_core::stoppable(stop, work));
        match raised.take() {
            Some(error) => Err(error),
            None => result,
        }
    })
}
