//! Sensors of environments, from Python, and their readings.

use crate::control::controllers::constants_dict;
use crate::errors::{call, to_python};
use crate::robot::params::Robot;
use crate::values::fields::{Door, load, option};
use crate::values::numbers::real;
use ballbot_core::batch::Batch;
use ballbot_core::sensor::{Onboard, SensorOptions};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Names of the parts of readings, three numbers each.
pub(crate) const PARTS: [&str; 4] = ["gyro", "specific_force", "wheel_angles", "wheel_rates"];

impl Door for SensorOptions {
    const FILES: &'static str = "a TOML file";
}

/// Result of [`crate::batch::PyBatch::readings`].
pub(crate) fn readings<'py>(py: Python<'py>, batch: &Batch, index: Option<usize>) -> PyResult<Bound<'py, PyDict>> {
    if let Some(index) = index {
        batch.check_index(index).map_err(to_python)?;
    }
    let chosen = index.map_or(0..batch.len(), |index| index..index + 1);
    let mut parts = PARTS.map(|_| Vec::with_capacity(3 * chosen.len()));
    for i in chosen.clone() {
        let read = batch.readings(i).map_err(to_python)?;
        let [gyro, force] = [read.gyro, read.specific_force].map(|v| [v.x, v.y, v.z]);
        for (part, numbers) in parts.iter_mut().zip([gyro, force, read.wheel_angles.0, read.wheel_rates.0]) {
            part.extend(numbers);
        }
    }
    let dict = PyDict::new(py);
    for (name, numbers) in PARTS.into_iter().zip(parts) {
        let array = PyArray1::from_vec(py, numbers);
        match index {
            Some(_) => dict.set_item(name, array)?,
            None => dict.set_item(name, array.reshape([chosen.len(), 3])?)?,
        }
    }
    Ok(dict)
}

/// Sensors as an argument, exact ones for None.
pub(crate) fn options(sensors: Option<&Bound<'_, PyAny>>) -> PyResult<SensorOptions> {
    Ok(sensors.map_or(Ok(None), option::<SensorOptions>)?.unwrap_or_default())
}

/// The constants, by name, of the estimator of a robot with these sensors; `ballbot export --estimator` writes them as
/// C.
///
/// Args:
///     robot: the robot; None is the paper's.
///     sensors: as `sensors=` of an environment; None is exact sensors.
///     control_dt: time between two readings, s.
///
/// Raises:
///     ValueError: a number out of range.
#[pyfunction]
#[pyo3(signature = (robot=None, sensors=None, control_dt=0.01))]
pub(crate) fn estimator_constants<'py>(
    py: Python<'py>,
    robot: Option<Robot>,
    sensors: Option<&Bound<'py, PyAny>>,
    #[pyo3(from_py_with = real)] control_dt: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let params = Robot::or_paper(robot);
    let options = options(sensors)?;
    let onboard = call(|| Onboard::new(&options, control_dt, Some(&params)))?;
    let estimator = onboard.estimator().expect("it was made with one");
    constants_dict(py, &estimator.constants())
}

/// Sensors by name (see `SENSORS`), or from the table `[sensors]` of a robot's TOML file.
///
/// ```python
/// noisier = {**bb.load_sensors("kugle"), "gyro_noise": 0.02}
/// batch = bb.Batch(8, robot="kugle", sensors=noisier)
/// ```
///
/// All options with their values, as `sensors=` of an environment takes them. A string that ends in ".toml" is a path.
///
/// Raises:
///     ValueError: an unknown name or option, malformed TOML, or a number out of range; the message has the value and the
///         limit.
///     OSError: the file cannot be read.
#[pyfunction]
pub(crate) fn load_sensors<'py>(py: Python<'py>, name_or_path: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    load::<SensorOptions>(py, name_or_path)
}
