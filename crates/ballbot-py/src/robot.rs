//! `Ballbot`.

use crate::convert::{numbers, vector};
use crate::errors::{call, to_python};
use crate::params::{PyParams, or_paper};
use crate::state::{PyContacts, PyState};
use ballbot_core::{Ballbot, Params, State};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// A simulated robot: sense (`state`, `contacts`), actuate (`step`), push, change its parameters (`set_params`).
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

#[pymethods]
impl PyBallbot {
    #[new]
    #[pyo3(signature = (params=None, model="rigid", sim_dt=0.001))]
    fn new(params: Option<&Bound<'_, PyAny>>, model: &str, sim_dt: f64) -> PyResult<Self> {
        let kind = model.parse().map_err(to_python)?;
        let params = or_paper(params)?;
        call(|| Ballbot::new(&params, kind, sim_dt)).map(Self)
    }

    /// Starts anew from `state`; None is at rest upright.
    ///
    /// Raises:
    ///     ValueError: a state out of bounds, below the floor, or with slip where the model has none.
    #[pyo3(signature = (state=None))]
    fn reset(&mut self, state: Option<&PyState>) -> PyResult<()> {
        let start = state.map_or_else(|| State::upright(self.0.params()), |state| state.0.clone());
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

    /// Replaces the robot's parameters; they outlive a reset.
    ///
    /// With the same geometry (radii, wheel angles, height of the center of mass) the motion goes on; otherwise the robot
    /// starts anew, at rest upright.
    ///
    /// Raises:
    ///     ValueError: the parameters do not describe a robot that the model can simulate; nothing has changed then.
    fn set_params(&mut self, params: &Bound<'_, PyAny>) -> PyResult<()> {
        let params = or_paper(Some(params))?;
        call(|| self.0.set_params(&params)).map(|_| ())
    }

    /// The present state.
    #[getter]
    fn state(&self) -> PyState {
        PyState(self.0.state())
    }

    /// Contact forces of the last step; `contact` and `rigid` return zeros until the first step.
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
