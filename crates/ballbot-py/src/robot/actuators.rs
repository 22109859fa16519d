//! Motors of environments, from Python.

use crate::errors::call;
use crate::values::fields::{Door, load};
use ballbot_core::actuator::MotorOptions;
use ballbot_core::urdf;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::Path;

impl Door for MotorOptions {
    const FILES: &'static str = "a TOML file or a URDF";

    fn of_other_file(path: &Path) -> Option<PyResult<Self>> {
        let is_urdf = path.extension().is_some_and(|extension| extension == "urdf");
        is_urdf.then(|| call(|| urdf::motors_from_urdf(path)))
    }
}

/// Motors by name (see `ACTUATORS`), from the table `[actuators]` of a robot's TOML file, or from the bot's URDF.
///
/// ```python
/// slower = {**bb.load_actuators("kugle"), "delay": 0.01}
/// batch = bb.Batch(8, robot="kugle", actuators=slower)
/// ```
///
/// The joint `velocity` of a URDF is `speed_limit`. All options with their values, as `actuators=` of an environment
/// takes them. A string that ends in ".toml" or ".urdf" is a path.
///
/// Raises:
///     ValueError: an unknown name or option, malformed TOML, or a number out of range; the message has the value and the
///         limit.
///     UrdfError: a URDF that is malformed or not a ballbot's.
///     OSError: the file cannot be read.
#[pyfunction]
pub(crate) fn load_actuators<'py>(py: Python<'py>, name_or_path: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    load::<MotorOptions>(py, name_or_path)
}
