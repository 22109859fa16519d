//! Python bindings of `ballbot-core`: conversions and names, no physics and no rewards.
//!
//! A crate with custom tasks or controllers registers them and calls [`fill`] from its own module.

#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]
#![allow(clippy::needless_pass_by_value, reason = "arguments are extracted from Python objects")]

mod batch;
mod control;
mod dynamics;
mod errors;
mod exclusive;
mod render;
mod robot;
mod signals;
mod values;

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
    batch::tasks::add_to(module)?;
    batch::events::add_to(module)?;
    robot::params::add_to(module)?;
    module.add_class::<robot::state::PyState>()?;
    module.add_class::<robot::state::PyContacts>()?;
    module.add_class::<robot::terrain::PyTerrain>()?;
    module.add_class::<dynamics::ballbot::PyBallbot>()?;
    module.add_class::<dynamics::crowd::PyCrowd>()?;
    module.add_class::<dynamics::jacobian::PyJacobian>()?;
    module.add_class::<dynamics::jacobian::PyJacobians>()?;
    module.add_class::<dynamics::jacobian::PyMotionJacobians>()?;
    module.add_class::<dynamics::models::PyLinearModel>()?;
    module.add_class::<dynamics::models::PySpatialModel>()?;
    module.add_class::<dynamics::models::PyPlanarModel>()?;
    module.add_class::<control::controllers::PyController>()?;
    module.add_class::<control::controllers::PyPid>()?;
    module.add_class::<control::controllers::PyLqr>()?;
    module.add_class::<control::reference::PyReference>()?;
    module.add_class::<batch::PyBatch>()?;
    module.add_class::<control::estimator::PyEstimator>()?;
    module.add_class::<render::PyRenderer>()?;
    module.add_function(wrap_pyfunction!(robot::terrain::terrain_kinds, module)?)?;
    module.add_function(wrap_pyfunction!(robot::terrain::obstacle_kinds, module)?)?;
    module.add("MOST_HEIGHTS", ballbot_core::terrain::MOST_NODES)?;
    module.add_function(wrap_pyfunction!(robot::params::_params_of, module)?)?;
    module.add_function(wrap_pyfunction!(batch::networks::_policy_controller, module)?)?;
    module.add_function(wrap_pyfunction!(values::toml_table::_toml_table, module)?)?;
    module.add_function(wrap_pyfunction!(robot::terrain::_terrain_of, module)?)?;
    module.add_function(wrap_pyfunction!(robot::state::_contacts_of, module)?)?;
    module.add_function(wrap_pyfunction!(robot::actuators::load_actuators, module)?)?;
    module.add_function(wrap_pyfunction!(robot::sensors::load_sensors, module)?)?;
    module.add_function(wrap_pyfunction!(robot::sensors::estimator_constants, module)?)?;
    module.add_function(wrap_pyfunction!(batch::perception::reading_bounds, module)?)?;
    module.add_function(wrap_pyfunction!(dynamics::models::virtual_to_wheel_torques, module)?)?;
    module.add_function(wrap_pyfunction!(dynamics::models::wheel_to_virtual_torques, module)?)?;
    Ok(())
}
