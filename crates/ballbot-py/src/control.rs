//! `Pid` and `Lqr`.

use crate::convert::{array, matrix, numbers};
use crate::errors::{call, to_python};
use crate::params::or_paper;
use crate::state::PyState;
use ballbot_core::control::{Controller, Lqr, LqrWeights, Pid, PidGains, Setpoint, default_max_torque};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

type Argument<'a, 'py> = Option<&'a Bound<'py, PyAny>>;

/// A setpoint from keyword arguments.
fn setpoint(
    position: Argument<'_, '_>,
    velocity: Argument<'_, '_>,
    yaw: f64,
    tilt: Argument<'_, '_>,
) -> PyResult<Setpoint> {
    let pair = |name: &str, value: Argument<'_, '_>| value.map_or(Ok([0.0; 2]), |v| numbers::<2>(name, v));
    let setpoint = Setpoint {
        position: pair("position", position)?.into(),
        velocity: pair("velocity", velocity)?.into(),
        yaw,
        tilt: pair("tilt", tilt)?.into(),
    };
    let p = &setpoint;
    let numbers = [p.position.x, p.position.y, p.velocity.x, p.velocity.y, p.yaw, p.tilt.x, p.tilt.y];
    ballbot_core::check_finite("setpoint", &numbers).map_err(to_python)?;
    Ok(setpoint)
}

/// The paper's PID with filtered derivative, on both tilt components; it holds neither position nor heading.
///
/// Torques are scaled down together to within `max_torque` (None: 0.9 of the
/// torque at which a wheel of the upright robot slips).
#[pyclass(name = "Pid", module = "ballbot_rs", subclass)]
pub(crate) struct PyPid(Pid);

#[pymethods]
impl PyPid {
    #[new]
    #[pyo3(signature = (
        params=None, control_dt=0.01, *, proportional=20.39, integral=56.57, derivative=1.34, filter_coefficient=327.0,
        mapping="consistent", max_torque=None
    ))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of a constructor")]
    fn new(
        params: Option<&Bound<'_, PyAny>>,
        control_dt: f64,
        proportional: f64,
        integral: f64,
        derivative: f64,
        filter_coefficient: f64,
        mapping: &str,
        max_torque: Option<f64>,
    ) -> PyResult<Self> {
        let map = mapping.parse().map_err(to_python)?;
        let gains = PidGains { proportional, integral, derivative, filter_coefficient };
        let params = or_paper(params)?;
        call(|| {
            let pid = Pid::new(&params, control_dt, gains, map)?;
            match max_torque {
                Some(limit) => pid.with_max_torque(limit),
                None => Ok(pid),
            }
        })
        .map(Self)
    }

    /// Wheel torques for the next `control_dt`, N·m; `tilt` is the setpoint in the heading frame.
    #[pyo3(signature = (state, *, position=None, velocity=None, yaw=0.0, tilt=None))]
    fn __call__<'py>(
        &mut self,
        py: Python<'py>,
        state: &PyState,
        position: Argument<'_, 'py>,
        velocity: Argument<'_, 'py>,
        yaw: f64,
        tilt: Argument<'_, 'py>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let setpoint = setpoint(position, velocity, yaw, tilt)?;
        Ok(array(py, &self.0.wheel_torques(&state.0, &setpoint)))
    }

    /// Forgets the past.
    fn reset(&mut self) {
        self.0.reset();
    }

    /// Time between two calls, in seconds.
    #[getter]
    fn control_dt(&self) -> f64 {
        self.0.control_dt()
    }
}

/// A discrete linear-quadratic regulator of position, tilt and heading, from the linear model of any robot.
///
/// Weights are deviations that cost the same: `position` (0.15 m), `velocity` (0.4 m/s), `tilt` (0.1 rad),
/// `tilt_rate` (1 rad/s), `yaw` (0.5 rad), `yaw_rate` (2 rad/s), `torque` (0.2 N·m). Torques as in `Pid`.
#[pyclass(name = "Lqr", module = "ballbot_rs", subclass)]
pub(crate) struct PyLqr(Lqr);

#[pymethods]
impl PyLqr {
    #[new]
    #[pyo3(signature = (params=None, control_dt=0.01, *, max_torque=None, **weights))]
    fn new(
        params: Option<&Bound<'_, PyAny>>,
        control_dt: f64,
        max_torque: Option<f64>,
        weights: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let mut w = LqrWeights::default();
        for (name, value) in weights.into_iter().flatten() {
            let name: String = name.extract()?;
            let target = match name.as_str() {
                "position" => &mut w.position,
                "velocity" => &mut w.velocity,
                "tilt" => &mut w.tilt,
                "tilt_rate" => &mut w.tilt_rate,
                "yaw" => &mut w.yaw,
                "yaw_rate" => &mut w.yaw_rate,
                "torque" => &mut w.torque,
                _ => {
                    return Err(PyTypeError::new_err(format!(
                        "unknown weight '{name}': expected one of position, velocity, tilt, tilt_rate, yaw, \
                         yaw_rate, torque"
                    )));
                }
            };
            *target = value.extract()?;
        }
        let params = or_paper(params)?;
        let max_torque = max_torque.unwrap_or_else(|| default_max_torque(&params));
        call(|| Lqr::with_weights(&params, control_dt, &w, max_torque)).map(Self)
    }

    /// Wheel torques for the next `control_dt`, N·m.
    #[pyo3(signature = (state, *, position=None, velocity=None, yaw=0.0, tilt=None))]
    fn __call__<'py>(
        &mut self,
        py: Python<'py>,
        state: &PyState,
        position: Argument<'_, 'py>,
        velocity: Argument<'_, 'py>,
        yaw: f64,
        tilt: Argument<'_, 'py>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let setpoint = setpoint(position, velocity, yaw, tilt)?;
        Ok(array(py, &self.0.wheel_torques(&state.0, &setpoint)))
    }

    /// Does nothing: the regulator has no memory.
    fn reset(&mut self) {
        self.0.reset();
    }

    /// Time between two calls, in seconds.
    #[getter]
    fn control_dt(&self) -> f64 {
        self.0.control_dt()
    }

    /// What the regulator multiplies and weighs (10), in the heading frame, m, rad, m/s, rad/s.
    ///
    /// Position error (x, y), tilt (x, y), yaw error, then their rates.
    #[pyo3(signature = (state, *, position=None, velocity=None, yaw=0.0))]
    fn deviation<'py>(
        &self,
        py: Python<'py>,
        state: &PyState,
        position: Argument<'_, 'py>,
        velocity: Argument<'_, 'py>,
        yaw: f64,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let setpoint = setpoint(position, velocity, yaw, None)?;
        Ok(array(py, Lqr::deviation(&state.0, &setpoint).as_slice()))
    }

    /// K (3×10): the torques are −K x of the deviation x, before they are limited.
    #[getter]
    fn gain<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        matrix(py, &self.0.regulator().gain)
    }

    /// P (10×10): the sum of xᵀQx + uᵀRu over all steps from the deviation x is xᵀPx.
    #[getter]
    fn cost<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        matrix(py, &self.0.regulator().cost)
    }

    /// Relative residual of the Riccati equation.
    #[getter]
    fn residual(&self) -> f64 {
        self.0.regulator().residual
    }
}
