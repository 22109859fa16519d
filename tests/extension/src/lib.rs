//! `ballbot_rs._core` with a task and a controller that the library does not have, from the tests of the core.

#[path = "../../rust/own/own_task/feedback.rs"]
mod feedback;
#[path = "../../rust/own/own_task/shuttle.rs"]
mod shuttle;

use ballbot_core::batch::register_task;
use ballbot_core::control::{NamedLaw, register_controller};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// Registers the task and the controller, then fills the module as the library does.
#[pymodule(name = "_core", gil_used = true)]
fn extended(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let registered = register_task::<shuttle::Shuttle>().and_then(|()| register_controller(feedback::Feedback::KIND));
    registered.map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    _core::fill(module)
}
