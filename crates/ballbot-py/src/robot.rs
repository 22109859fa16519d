//! `Ballbot`.

use crate::convert::{numbers, vector};
use crate::errors::{call, to_python};
use crate::params::{PyParams, or_paper};
use crate::state::{PyContacts, PyState, tilted};
use ballbot_core::{Ballbot, JointDynamics, Params};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

/// A simulated robot: sense (`state`, `contacts`), actuate (`step`), push, set joint dynamics.
///
/// Args:
///     params: the robot, the name of a preset, or the path of a TOML file; None is `Params.paper()`.
///     model: "rigid" (rapier3d), "contact" (contacts and friction on a flat floor, specialised), "spatial" (coupled
///         3D without slip) or "planar" (eqs. (1)-(7) of the paper).
///     sim_dt: time step, s.
///
/// Raises:
///     ValueError: an unknown model, or a number out of range.
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
    fn new(params: Option<&Bound<'_, PyAny>>, model: &str, sim_dt: f64) -> PyResult<Self> {
        let kind = model.parse().map_err(to_python)?;
        let params = or_paper(params)?;
        call(|| Ballbot::new(&params, kind, sim_dt)).map(Self)
    }

    /// Starts anew from `state`, or at rest with a tilt (two components) and a yaw.
    ///
    /// Raises:
    ///     ValueError: a state out of bounds, below the floor, or with slip where the model has none.
    ///     TypeError: both a state and a tilt or yaw.
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

    /// Advances by `steps` time steps under constant motor torques (three, N·m).
    ///
    /// Raises:
    ///     ValueError: a torque that is not finite or beyond `params.max_wheel_torque`; nothing has moved then.
    ///     DivergedError: the state has left the simulation's bounds.
    #[pyo3(signature = (wheel_torques, steps=1))]
    fn step(&mut self, py: Python<'_>, wheel_torques: &Bound<'_, PyAny>, steps: i64) -> PyResult<()> {
        let steps = usize::try_from(steps)
            .map_err(|_| PyValueError::new_err(format!("steps = {steps} is out of range: it must be at least 0")))?;
        let torques = numbers::<3>("wheel_torques", wheel_torques)?;
        let robot = &mut self.0;
        py.detach(|| call(|| robot.step(&torques, steps)))
    }

    /// Gives the body an impulse (inertial frame, N·s) at `point` (body frame, m; None is its CoM).
    ///
    /// The models `contact` and `rigid` spread it over their next time step.
    #[pyo3(signature = (impulse, point=None))]
    fn push(&mut self, impulse: &Bound<'_, PyAny>, point: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let impulse = vector("impulse", impulse)?;
        let point = point.map(|p| vector("point", p)).transpose()?;
        call(|| self.0.push(&impulse, point.as_ref()))
    }

    /// Changes the wheel joints' viscous (N·m/(rad/s)) or dry (N·m) friction; it outlives a reset.
    #[pyo3(signature = (viscous_friction=None, coulomb_friction=None))]
    fn set_joint_dynamics(&mut self, viscous_friction: Option<f64>, coulomb_friction: Option<f64>) -> PyResult<()> {
        let dynamics = changed(self.0.joint_dynamics(), viscous_friction, coulomb_friction);
        call(|| self.0.set_joint_dynamics(dynamics))
    }

    /// `viscous_friction` and `coulomb_friction` of the wheel joints, as `set_joint_dynamics` takes them.
    #[getter]
    fn joint_dynamics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dynamics = self.0.joint_dynamics();
        let dict = PyDict::new(py);
        dict.set_item("viscous_friction", dynamics.viscous_friction)?;
        dict.set_item("coulomb_friction", dynamics.coulomb_friction)?;
        Ok(dict)
    }

    /// The present state.
    #[getter]
    fn state(&self) -> PyState {
        PyState(self.0.state())
    }

    /// Contact forces of the last step; `contact` and `rigid` know none before their first.
    #[getter]
    fn contacts(&self) -> PyContacts {
        PyContacts { contacts: self.0.contacts(), params: self.0.params().clone() }
    }

    /// Kinetic plus potential energy, J; the latter is zero with the body's CoM at the ball centre's height.
    #[getter]
    fn energy(&self) -> f64 {
        self.0.energy()
    }

    /// Simulated time since the reset, s.
    #[getter]
    fn time(&self) -> f64 {
        self.0.time()
    }

    /// The robot's parameters.
    #[getter]
    fn params(&self) -> PyParams {
        PyParams(self.0.params().clone())
    }

    /// The model's name.
    #[getter]
    fn model(&self) -> &'static str {
        self.0.kind().name()
    }

    /// Time step, s.
    #[getter]
    fn sim_dt(&self) -> f64 {
        self.0.sim_dt()
    }

    /// Everything that the future depends on, for `restore`.
    fn snapshot<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.0.save())
    }

    /// Continues, to the last bit, from a snapshot of a robot with the same arguments.
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
