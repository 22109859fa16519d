//! `Ballbot`.

use crate::convert::{numbers, vector};
use crate::errors::{call, to_python};
use crate::params::{PyParams, or_paper};
use crate::state::{PyContacts, PyState, tilted};
use ballbot_core::{Ballbot, JointDynamics, Params};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

/// A simulated robot: sense, actuate, push, set joint dynamics.
#[pyclass(name = "Ballbot", module = "ballbot_rs", subclass)]
pub(crate) struct PyBallbot(Ballbot);

/// Joint dynamics with the given values changed.
pub(crate) fn changed(
    dynamics: JointDynamics,
    viscous_friction: Option<f64>,
    coulomb_friction: Option<f64>,
) -> JointDynamics {
    JointDynamics {
        viscous_friction: viscous_friction.unwrap_or(dynamics.viscous_friction),
        coulomb_friction: coulomb_friction.unwrap_or(dynamics.coulomb_friction),
    }
}

#[pymethods]
impl PyBallbot {
    #[new]
    #[pyo3(signature = (params=None, model="rigid", sim_dt=0.001))]
    fn new(params: Option<&PyParams>, model: &str, sim_dt: f64) -> PyResult<Self> {
        let kind = model.parse().map_err(to_python)?;
        call(|| Ballbot::new(&or_paper(params), kind, sim_dt)).map(Self)
    }

    #[pyo3(signature = (state=None, tilt=None, yaw=None))]
    fn reset(&mut self, state: Option<&PyState>, tilt: Option<&Bound<'_, PyAny>>, yaw: Option<f64>) -> PyResult<()> {
        if state.is_some() && (tilt.is_some() || yaw.is_some()) {
            return Err(PyTypeError::new_err("reset takes a state, or a tilt and a yaw, not both"));
        }
        let start = match state {
            Some(state) => state.0.clone(),
            None => tilted(self.0.params(), tilt, yaw.unwrap_or(0.0))?,
        };
        call(|| self.0.reset(&start))
    }

    #[pyo3(signature = (wheel_torques, steps=1))]
    fn step(&mut self, py: Python<'_>, wheel_torques: &Bound<'_, PyAny>, steps: i64) -> PyResult<()> {
        let steps = usize::try_from(steps)
            .map_err(|_| PyValueError::new_err(format!("steps = {steps} is out of range: it must be at least 0")))?;
        let torques = numbers::<3>("wheel_torques", wheel_torques)?;
        let robot = &mut self.0;
        py.detach(|| call(|| robot.step(&torques, steps)))
    }

    #[pyo3(signature = (impulse, point=None))]
    fn push(&mut self, impulse: &Bound<'_, PyAny>, point: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let impulse = vector("impulse", impulse)?;
        let point = point.map(|p| vector("point", p)).transpose()?;
        call(|| self.0.push(&impulse, point.as_ref()))
    }

    #[pyo3(signature = (viscous_friction=None, coulomb_friction=None))]
    fn set_joint_dynamics(&mut self, viscous_friction: Option<f64>, coulomb_friction: Option<f64>) -> PyResult<()> {
        let dynamics = changed(self.0.joint_dynamics(), viscous_friction, coulomb_friction);
        call(|| self.0.set_joint_dynamics(dynamics))
    }

    #[getter]
    fn joint_dynamics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dynamics = self.0.joint_dynamics();
        let dict = PyDict::new(py);
        dict.set_item("viscous_friction", dynamics.viscous_friction)?;
        dict.set_item("coulomb_friction", dynamics.coulomb_friction)?;
        Ok(dict)
    }

    #[getter]
    fn state(&self) -> PyState {
        PyState(self.0.state())
    }

    #[getter]
    fn contacts(&self) -> PyContacts {
        PyContacts { contacts: self.0.contacts(), params: self.0.params().clone() }
    }

    #[getter]
    fn energy(&self) -> f64 {
        self.0.energy()
    }

    #[getter]
    fn time(&self) -> f64 {
        self.0.time()
    }

    #[getter]
    fn params(&self) -> PyParams {
        PyParams(self.0.params().clone())
    }

    #[getter]
    fn model(&self) -> &'static str {
        self.0.kind().name()
    }

    #[getter]
    fn sim_dt(&self) -> f64 {
        self.0.sim_dt()
    }

    fn snapshot<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.0.save())
    }

    fn restore(&mut self, snapshot: &[u8]) -> PyResult<()> {
        call(|| self.0.load(snapshot))
    }

    fn __repr__(&self) -> String {
        format!("Ballbot(model='{}', sim_dt={}, time={:.4})", self.0.kind(), self.0.sim_dt(), self.0.time())
    }

    fn __getnewargs__(&self) -> (PyParams, &'static str, f64) {
        let params: &Params = self.0.params();
        (PyParams(params.clone()), self.0.kind().name(), self.0.sim_dt())
    }

    fn __getstate__<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        self.snapshot(py)
    }

    fn __setstate__(&mut self, snapshot: &[u8]) -> PyResult<()> {
        self.restore(snapshot)
    }
}
