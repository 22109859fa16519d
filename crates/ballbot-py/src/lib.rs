//! Python bindings of `ballbot-core`: conversions and names, no physics and no rewards.
//!
//! A crate with custom tasks or controllers registers them and calls [`fill`] from its own module.

#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]
#![allow(clippy::needless_pass_by_value, reason = "arguments are extracted from Python objects")]

mod actuators;
mod batch;
mod control;
mod convert;
mod crowd;
mod errors;
mod estimator;
mod events;
mod exclusive;
mod fields;
mod infos;
mod jacobian;
mod keywords;
mod models;
mod networks;
mod numbers;
mod options;
mod params;
mod payloads;
mod perception;
mod reference;
mod render;
mod robot;
mod rollout;
mod sensors;
mod short;
mod signals;
mod stage;
mod state;
mod tasks;
mod terrain;
mod toml_table;

use pyo3::prelude::*;

/// The extension module `ballbot_rs._core`.
#[cfg(feature = "module")]
#[pymodule(gil_used = true)]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    fill(module)
}

/// Adds all classes, functions and tables to an extension module.
///
/// # Errors
/// Exceptions of Python.
pub fn fill(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("PAPER_BALL_VISCOUS_FRICTION", ballbot_core::PAPER_BALL_VISCOUS_FRICTION)?;
    module.add("LABELS", ballbot_core::render::Label::NAMES)?;
    tasks::add_to(module)?;
    events::add_to(module)?;
    params::add_to(module)?;
    module.add_class::<state::PyState>()?;
    module.add_class::<state::PyContacts>()?;
    module.add_class::<terrain::PyTerrain>()?;
    module.add_class::<robot::PyBallbot>()?;
    module.add_class::<crowd::PyCrowd>()?;
    module.add_class::<jacobian::PyJacobian>()?;
    module.add_class::<jacobian::PyJacobians>()?;
    module.add_class::<jacobian::PyMotionJacobians>()?;
    module.add_class::<models::PyLinearModel>()?;
    module.add_class::<models::PySpatialModel>()?;
    module.add_class::<models::PyPlanarModel>()?;
    module.add_class::<control::PyController>()?;
    module.add_class::<control::PyPid>()?;
    module.add_class::<control::PyLqr>()?;
    module.add_class::<reference::PyReference>()?;
    module.add_class::<batch::PyBatch>()?;
    module.add_class::<estimator::PyEstimator>()?;
    module.add_class::<render::PyRenderer>()?;
    module.add_function(wrap_pyfunction!(terrain::terrain_kinds, module)?)?;
    module.add_function(wrap_pyfunction!(terrain::obstacle_kinds, module)?)?;
    module.add("MOST_HEIGHTS", ballbot_core::terrain::MOST_NODES)?;
    module.add_function(wrap_pyfunction!(params::_params_of, module)?)?;
    module.add_function(wrap_pyfunction!(networks::_policy_controller, module)?)?;
    module.add_function(wrap_pyfunction!(toml_table::_toml_table, module)?)?;
    module.add_function(wrap_pyfunction!(terrain::_terrain_of, module)?)?;
    module.add_function(wrap_pyfunction!(state::_contacts_of, module)?)?;
    module.add_function(wrap_pyfunction!(actuators::load_actuators, module)?)?;
    module.add_function(wrap_pyfunction!(sensors::load_sensors, module)?)?;
    module.add_function(wrap_pyfunction!(sensors::estimator_constants, module)?)?;
    module.add_function(wrap_pyfunction!(perception::reading_bounds, module)?)?;
    module.add_function(wrap_pyfunction!(models::virtual_to_wheel_torques, module)?)?;
    module.add_function(wrap_pyfunction!(models::wheel_to_virtual_torques, module)?)?;
    Ok(())
}
