//! Motors of environments, from and to Python.

use crate::errors::{call, to_python};
use crate::fields::{field_dict, named_numbers};
use crate::params::toml_path;
use ballbot_core::actuator::MotorOptions;
use ballbot_core::urdf;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping};
use std::path::Path;

/// Motors from None (ideal motors), a mapping of options, a name or the path of a TOML file.
pub(crate) fn actuators(value: &Bound<'_, PyAny>) -> PyResult<MotorOptions> {
    if value.is_none() {
        return Ok(MotorOptions::default());
    }
    if let Ok(options) = value.cast::<PyMapping>() {
        return from_mapping(options);
    }
    named(value).unwrap_or_else(|| {
        let kind = value.get_type().name()?;
        Err(PyTypeError::new_err(format!(
            "actuators must be a dict of options, a name, the path of a TOML file or a URDF, or None, not {kind}"
        )))
    })
}

/// Motors from a name or the path of a TOML file or a URDF; `None` for anything else.
fn named(value: &Bound<'_, PyAny>) -> Option<PyResult<MotorOptions>> {
    if let Some(path) = toml_path(value) {
        // A path object of either format reaches this point.
        return Some(if is_urdf(&path) { from_urdf(&path) } else { call(|| MotorOptions::from_toml_file(&path)) });
    }
    let name = value.extract::<String>().ok()?;
    if is_urdf(Path::new(&name)) {
        return Some(from_urdf(Path::new(&name)));
    }
    Some(MotorOptions::preset(&name).map_err(to_python))
}

fn is_urdf(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "urdf")
}

fn from_urdf(path: &Path) -> PyResult<MotorOptions> {
    call(|| urdf::motors_from_urdf(path))
}

fn from_mapping(options: &Bound<'_, PyMapping>) -> PyResult<MotorOptions> {
    let fields = named_numbers("actuators", options)?;
    MotorOptions::from_fields(fields.iter().map(|(name, values)| (name.as_str(), values.as_slice()))).map_err(to_python)
}

/// All options of motors by name; None for ideal motors.
pub(crate) fn to_object(py: Python<'_>, options: &MotorOptions) -> PyResult<Option<Py<PyDict>>> {
    if options.is_ideal() { Ok(None) } else { to_dict(py, options).map(|dict| Some(dict.unbind())) }
}

/// All options of motors by name.
pub(crate) fn to_dict<'py>(py: Python<'py>, options: &MotorOptions) -> PyResult<Bound<'py, PyDict>> {
    field_dict(py, options)
}

/// Motors by name (see `ACTUATORS`), from the table `[actuators]` of a robot's TOML file, or from the bot's URDF, whose
/// joint `velocity` is `speed_limit`.
///
/// All options with their values, as `actuators=` of an environment takes them. A string that ends in ".toml" or ".urdf" is
/// a path.
///
/// Raises:
///     ValueError: an unknown name or option, malformed TOML, or a number out of range; the message has the value and the
///         limit.
///     UrdfError: a URDF that is malformed or not a ballbot's.
///     OSError: the file cannot be read.
#[pyfunction]
pub(crate) fn load_actuators<'py>(py: Python<'py>, name_or_path: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    let options = named(name_or_path).unwrap_or_else(|| {
        let kind = name_or_path.get_type().name()?;
        Err(PyTypeError::new_err(format!(
            "name_or_path must be a name or the path of a TOML file or a URDF, not {kind}"
        )))
    })?;
    to_dict(py, &options)
}
