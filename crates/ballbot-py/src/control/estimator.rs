//! `Estimator`.

use crate::errors::{InvalidInputError, call};
use crate::exclusive::Exclusive;
use crate::robot::params::Robot;
use crate::robot::sensors::{PARTS, options};
use crate::robot::state::PyState;
use crate::values::convert::{array, matrix, vector};
use crate::values::keywords::no_others;
use crate::values::numbers::real;
use ballbot_core::sensor::Readings;
use ballbot_core::sensor::estimator::{Estimate, Tracker};
use ballbot_core::{Wheels, one_of};
use nalgebra::{DMatrix, Vector3};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping};

/// The estimator of one robot's state from gyroscope, accelerometer and encoders.
///
/// ```python
/// batch = bb.Batch(1, sensors="kugle", observation="sensors")
/// batch.reset()
/// estimator = bb.Estimator(sensors="kugle", control_dt=batch.control_dt)
/// estimator.reset()
/// print(estimator.update(batch.readings(0)))
/// ```
///
/// As in environments with `observation="sensors"`, bit for bit. docs/estimator.md has its equations and errors.
///
/// An error-state Kalman filter on level ground, without a model of motors: torques are not among its readings. Call it
/// every `control_dt`. Position and yaw are not measured: they drift. Attributes are fresh float64 arrays. Copies have their
/// own memory.
///
/// Args:
///     robot: the robot; None is the paper's.
///     sensors: as `sensors=` of an environment: the errors to expect, where the IMU is, and the latency; None is exact
///         sensors.
///     control_dt: time between two readings, s, at most 1.
///
/// Raises:
///     ValueError: a number out of range, a latency that is not a whole number of steps, or a sensor slower than
///         `control_dt`.
#[pyclass(name = "Estimator", module = "ballbot_rs", frozen)]
pub(crate) struct PyEstimator(Exclusive<Tracker>);

impl PyEstimator {
    fn of(tracker: Tracker) -> Self {
        Self(Exclusive::new("Estimator", tracker))
    }

    fn estimate(&self) -> PyResult<Estimate<f64>> {
        Ok(self.0.write()?.estimate())
    }
}

#[pymethods]
impl PyEstimator {
    #[new]
    #[pyo3(
        signature = (robot=None, sensors=None, control_dt=0.01, **others),
        text_signature = "(robot=None, sensors=None, control_dt=0.01)"
    )]
    fn new(
        robot: Option<Robot>,
        sensors: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = real)] control_dt: f64,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        no_others("Estimator", others)?;
        let (params, sensors) = (Robot::or_paper(robot), options(sensors)?);
        call(|| Tracker::new(&params, &sensors, control_dt)).map(Self::of)
    }

    /// Begins an episode in `state`, where the robot is assumed to be. None is at rest at the origin with yaw 0, in the
    /// attitude that the accelerometer measures in the first readings.
    #[pyo3(signature = (state=None))]
    fn reset(&self, state: Option<&PyState>) -> PyResult<()> {
        self.0.write()?.reset(state.map(|state| &state.0));
        Ok(())
    }

    /// The state after the first readings of an episode, or after readings `control_dt` later.
    ///
    /// Args:
    ///     readings: by name, shape (3,), as `Batch.readings(i)`: `gyro`, body frame, rad/s; `specific_force`, body frame,
    ///         m/s², the mean since the last readings; `wheel_angles`, rad. `wheel_rates`, rad/s, are the change of the
    ///         angles over `control_dt` unless they are given.
    ///
    /// Raises:
    ///     ValueError: readings that are missing, unknown, not finite or far beyond any robot's, or first readings from
    ///         which no attitude at rest follows: no specific force, or straight down. Nothing has changed then.
    fn update(&self, readings: &Bound<'_, PyMapping>) -> PyResult<PyState> {
        let mut parts = [None; PARTS.len()];
        for item in readings.items()? {
            let (name, value): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item.extract()?;
            let Some(part) = PARTS.iter().position(|part| name.eq(part).unwrap_or(false)) else {
                let name = name.str()?.to_string();
                let known = one_of(&name, &PARTS);
                return Err(InvalidInputError::new_err(format!("unknown readings '{name}': expected one of {known}")));
            };
            parts[part] = Some(vector(PARTS[part], &value)?);
        }
        let [Some(gyro), Some(force), Some(angles), rates] = parts else {
            let missing = PARTS.iter().zip(&parts).find(|(_, value)| value.is_none()).map_or("", |(name, _)| *name);
            return Err(InvalidInputError::new_err(format!(
                "readings have no {missing}: expected {}",
                PARTS.join(", ")
            )));
        };
        let mut tracker = self.0.write()?;
        let wheel_angles = Wheels::of_column(angles);
        let readings = Readings {
            gyro: lanes(gyro),
            specific_force: lanes(force),
            wheel_angles,
            wheel_rates: rates.map_or_else(|| tracker.wheel_rates(wheel_angles), Wheels::of_column),
        };
        call(|| tracker.update(&readings).cloned()).map(PyState)
    }

    /// The state after the last readings; before them, where the robot is believed to begin.
    #[getter]
    fn state(&self) -> PyResult<PyState> {
        Ok(PyState(self.0.read()?.state().clone()))
    }

    /// The last state with its attitude turned back by `lean_bias`, within ±0.1 rad: a controller without an integrator then
    /// holds the equilibrium of the actual robot, not of its nominal parameters.
    #[getter]
    fn balanced_state(&self) -> PyResult<PyState> {
        Ok(PyState(self.0.write()?.balanced()))
    }

    /// Bias of the gyroscope, body frame, rad/s, shape (3,).
    #[getter]
    fn gyro_bias<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let bias = self.estimate()?.gyro_bias;
        Ok(array(py, &[bias.x, bias.y, bias.z]))
    }

    /// Actual minus nominal lean of the robot in equilibrium, towards x and y of the heading frame, rad, shape
    /// (2,).
    #[getter]
    fn lean_bias<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(array(py, &self.estimate()?.lean_bias))
    }

    /// Whether each wheel slipped in the last step, and was therefore not used, shape (3,), bool.
    #[getter]
    fn slipping<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<bool>>> {
        Ok(PyArray1::from_slice(py, self.estimate()?.slipping.map(|slips| slips > 0.0).as_slice()))
    }

    /// Covariance of the attitude's error, a rotation vector in the inertial frame, rad², shape (3, 3).
    #[getter]
    fn attitude_covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.estimate()?.attitude_covariance.rows.map(|row| [row.x, row.y, row.z]);
        Ok(matrix(py, &DMatrix::from_row_slice(3, 3, rows.as_flattened())))
    }

    /// Covariance of the error of the IMU's horizontal velocity, inertial frame, (m/s)², shape (2, 2). It excludes the
    /// part that follows from the error of the yaw.
    #[getter]
    fn velocity_covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let [xx, xy, yy] = self.estimate()?.velocity_covariance;
        Ok(matrix(py, &DMatrix::from_row_slice(2, 2, &[xx, xy, xy, yy])))
    }

    fn __copy__(&self) -> PyResult<Self> {
        Ok(Self::of(self.0.read()?.clone()))
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyDict>) -> PyResult<Self> {
        self.__copy__()
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(PyTypeError::new_err("Estimator objects cannot be pickled: make another of the same robot and sensors"))
    }
}

fn lanes(v: Vector3<f64>) -> ballbot_core::lanes::Vec3<f64> {
    ballbot_core::lanes::Vec3::new(v.x, v.y, v.z)
}
