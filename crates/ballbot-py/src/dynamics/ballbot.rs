//! `Ballbot`.

use crate::dynamics::jacobian::{self, PyJacobian, PyMotionJacobians};
use crate::errors::{call, to_python};
use crate::exclusive::Exclusive;
use crate::robot::params::{PyParams, Robot};
use crate::robot::payloads::{NUMBERS, deflections_of, numbers_of, payload_index};
use crate::robot::state::{PyContacts, PyState, tilt_of};
use crate::robot::terrain::{PyTerrain, terrain as ground};
use crate::signals::interruptible;
use crate::values::convert::{finite_elements, numbers, optional_vector, outside_force, vector};
use crate::values::keywords::no_others;
use crate::values::numbers::{count, optional_real, real, whole};
use ballbot_core::{Ballbot, PAYLOADS};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::sync::Arc;

/// Steps that take too little time to be worth interrupting.
const SHORT_RUN: usize = 1000;

/// A simulated robot: sense (`state`, `contacts`), actuate (`step`), push, change its parameters (`set_params`).
///
/// ```python
/// robot = bb.Ballbot("kugle", model="contact")
/// robot.reset(bb.State.at_equilibrium(robot.params, tilt=(0.05, 0.0)))
/// lqr = bb.Lqr(robot.params, control_dt=0.01)
/// for _ in range(100):
///     robot.step(lqr(robot.state), steps=10)
/// print(robot.time, robot.state.ball_position)
/// ```
///
/// Args:
///     robot: `Params`, the name of a preset, the path of a TOML file, or a dict of parameters; None is the paper's.
///     model: "contact" (contacts and friction on the ground, dedicated solver), "rigid" (the same with rapier3d), "spatial"
///         (coupled 3D without slip) or "planar" (eqs. (1)-(7) of the paper).
///     sim_dt: time step, s.
///     terrain: the ground, a `Terrain`, the name of a kind or a dict for `Terrain.generate`; None is level. "contact"
///         and "rigid" take any, "spatial" planes, "planar" none.
///
/// Raises:
///     ValueError: an unknown model, a number out of range, or ground that the model does not simulate.
#[pyclass(name = "Ballbot", module = "ballbot_rs", subclass, frozen)]
pub(crate) struct PyBallbot(Exclusive<Ballbot>);

#[pymethods]
impl PyBallbot {
    #[new]
    #[pyo3(
        signature = (robot=None, model="contact", sim_dt=0.001, terrain=None, **others),
        text_signature = "(robot=None, model='contact', sim_dt=0.001, terrain=None)"
    )]
    fn new(
        robot: Option<Robot>,
        model: &str,
        #[pyo3(from_py_with = real)] sim_dt: f64,
        terrain: Option<&Bound<'_, PyAny>>,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        no_others("Ballbot", others)?;
        let kind = model.parse().map_err(to_python)?;
        let params = Robot::or_paper(robot);
        let ground = terrain.map_or(Ok(None), ground)?;
        let robot = call(|| {
            let mut robot = Ballbot::new(&params, kind, sim_dt)?;
            if ground.is_some() {
                robot.set_terrain(ground.as_ref())?;
            }
            Ok(robot)
        });
        robot.map(|robot| Self(Exclusive::new("Ballbot", robot)))
    }

    /// The ground; None is level.
    #[getter]
    fn terrain(&self) -> PyResult<Option<PyTerrain>> {
        Ok(self.0.read()?.terrain().map(|terrain| PyTerrain(Arc::clone(terrain))))
    }

    /// Puts the robot on different ground, upright at rest above the origin: a `Terrain`, the name of a kind, a dict
    /// for `Terrain.generate`, or None for level ground.
    ///
    /// Raises:
    ///     ValueError: ground that the model does not simulate, or with valleys too narrow for the ball; the robot is
    ///         then unchanged.
    fn set_terrain(&self, terrain: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let ground = terrain.map_or(Ok(None), ground)?;
        let mut robot = self.0.write()?;
        call(|| robot.set_terrain(ground.as_ref()))
    }

    /// Restarts at rest with the ball on the ground, its center above `x` and `y`, m, at the heading `yaw`, rad. `tilt`
    /// is the rotation vector (x, y) of its tilt from the equilibrium on level ground, rad; None is the lean at which
    /// it is at rest on the slope there.
    ///
    /// Raises:
    ///     ValueError: no lean holds the robot on the slope, or a part of it would be below the ground.
    #[pyo3(signature = (x, y, yaw=0.0, tilt=None))]
    fn place_on_ground(
        &self,
        #[pyo3(from_py_with = real)] x: f64,
        #[pyo3(from_py_with = real)] y: f64,
        #[pyo3(from_py_with = real)] yaw: f64,
        tilt: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let tilt = tilt.map(tilt_of).transpose()?;
        let mut robot = self.0.write()?;
        call(|| robot.place_on_ground(x, y, yaw, tilt))
    }

    /// Restarts from `state`; None is upright at rest above the origin.
    ///
    /// A ball above the ground falls onto it. A state has no contact forces: `contact` and `rigid` recompute them in their next step. A snapshot has them.
    ///
    /// Raises:
    ///     ValueError: a state out of bounds, below the floor, or with slip where the model has none.
    #[pyo3(signature = (state=None))]
    fn reset(&self, state: Option<&PyState>) -> PyResult<()> {
        let mut robot = self.0.write()?;
        let start = state.map_or_else(|| robot.upright(), |state| state.0.clone());
        call(|| robot.reset(&start))
    }

    /// Advances by `steps` time steps under constant motor torques (three, N·m).
    ///
    /// Raises:
    ///     ValueError: a torque that is not finite or beyond `params.max_wheel_torque`; nothing has moved then.
    ///     DivergedError: the state has left the simulation's bounds.
    ///     KeyboardInterrupt: Ctrl-C during a long call; `time` is the simulated time reached.
    #[pyo3(signature = (wheel_torques, steps=1))]
    fn step(
        &self,
        py: Python<'_>,
        wheel_torques: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = whole)] steps: i64,
    ) -> PyResult<()> {
        let steps = count("steps", steps, 0)?;
        let torques = numbers::<3>("wheel_torques", wheel_torques)?;
        let mut robot = self.0.write()?;
        let robot = &mut *robot;
        if steps <= SHORT_RUN {
            return py.detach(|| call(|| robot.step(torques, steps)));
        }
        interruptible(py, || robot.step(torques, steps))
    }

    /// Derivatives of the next `steps` time steps under constant motor torques (three, N·m), through contact and slip, with
    /// respect to the state, the torques, and `parameters` of `params`: names, each for all its elements, or of one element,
    /// as `body_com_offset[0]`. The robot does not move. Models "contact", and on level ground "spatial" and "planar".
    ///
    /// With the modes of the contacts fixed, a step is smooth, and its derivatives are exact. Where a contact changes its
    /// mode the motion has a kink, and the derivatives are of the modes taken: `Jacobian.modes_changed`, `margin`.
    ///
    /// Raises:
    ///     ValueError: an unknown parameter, or one without derivative (`roller_count`, a `roller_ripple` of 0, inertia with
    ///         equal principal moments); fewer than one step; torques as in `step`; the model "rigid"; a terrain under
    ///         "spatial"; a parameter with which "planar" does not simulate the robot; the bot touches the floor, or the
    ///         ball its body; derivatives that are not finite.
    ///     DivergedError: the state leaves the simulation's bounds.
    ///     KeyboardInterrupt: Ctrl-C during a long call.
    #[pyo3(signature = (wheel_torques, steps=1, parameters=None))]
    fn jacobian(
        &self,
        py: Python<'_>,
        wheel_torques: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = whole)] steps: i64,
        parameters: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<PyJacobian> {
        let steps = count("steps", steps, 1)?;
        let torques = numbers::<3>("wheel_torques", wheel_torques)?;
        let parameters = jacobian::parameters(parameters)?;
        let robot = self.0.read()?;
        let robot = &*robot;
        let jacobian = interruptible(py, || robot.jacobian(torques, steps, &parameters))?;
        Ok(PyJacobian { jacobian, parameters, params: robot.params().clone() })
    }

    /// `jacobian` of successive motions, each of `steps` time steps under its torques (shape (T, 3), N·m), each from where
    /// the one before has ended. The robot does not move.
    ///
    /// Raises:
    ///     ValueError, DivergedError, KeyboardInterrupt: as `jacobian`.
    ///     MemoryError: too many motions.
    #[pyo3(signature = (wheel_torques, steps=1, parameters=None))]
    fn jacobians(
        &self,
        py: Python<'_>,
        wheel_torques: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = whole)] steps: i64,
        parameters: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Py<PyMotionJacobians>> {
        let steps = count("steps", steps, 1)?;
        let torques = jacobian::torques(wheel_torques)?;
        let parameters = jacobian::parameters(parameters)?;
        let robot = self.0.read()?;
        let robot = &*robot;
        let jacobians = interruptible(py, || robot.jacobians(&torques, steps, &parameters))?;
        PyMotionJacobians::new(py, jacobians, parameters, robot.derivative_coordinates())
    }

    /// Applies an impulse (inertial frame, N·s) to the body at `point` (body frame, m; None is its CoM).
    ///
    /// The models `contact` and `rigid` spread it over their next time step.
    #[pyo3(signature = (impulse, point=None))]
    fn push(&self, impulse: &Bound<'_, PyAny>, point: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let impulse = vector("impulse", impulse)?;
        let point = optional_vector("point", point)?;
        let mut robot = self.0.write()?;
        call(|| robot.push(&impulse, point.as_ref()))
    }

    /// Replaces the external force on the body: it acts in every time step, until another force or a reset.
    ///
    /// A sine is `force` times sin(2π f t + phase), with t from its start; each time step has its mean over the step. Times are
    /// in whole time steps.
    ///
    /// Args:
    ///     force: inertial frame, shape (3,), N; zero ends the former force.
    ///     point: body frame, shape (3,), m; None is its CoM.
    ///     frequency: of a sine, Hz, at most half the rate of the time steps; 0 is a constant force.
    ///     phase: of a sine at its start, rad.
    ///     delay: time from now to its start, s.
    ///     duration: time for which it acts, s; None is without end.
    ///
    /// Raises:
    ///     ValueError: a number out of range, or the model `planar`; the former force then stays.
    #[pyo3(signature = (force, point=None, *, frequency=0.0, phase=0.0, delay=0.0, duration=None))]
    #[allow(clippy::too_many_arguments, reason = "keywords of Python")]
    fn apply_force(
        &self,
        force: &Bound<'_, PyAny>,
        point: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = real)] frequency: f64,
        #[pyo3(from_py_with = real)] phase: f64,
        #[pyo3(from_py_with = real)] delay: f64,
        #[pyo3(from_py_with = optional_real)] duration: Option<f64>,
    ) -> PyResult<()> {
        let force = outside_force(force, point, frequency, phase, delay, duration)?;
        let mut robot = self.0.write()?;
        call(|| robot.apply_force(&force))
    }

    /// Moves the rest position of a payload's springs, as a leaning rider does. Held until another offset or a reset.
    ///
    /// Args:
    ///     offset: from the payload's place, body axes, shape (3,), m.
    ///     payload: 0, or 1 for the second payload.
    ///
    /// Raises:
    ///     ValueError: a robot without such a payload, or a number beyond ±1000 m; the former offset then stays.
    #[pyo3(signature = (offset, *, payload=0))]
    fn move_payload(
        &self,
        offset: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = payload_index)] payload: usize,
    ) -> PyResult<()> {
        let offset = vector("offset", offset)?;
        let mut robot = self.0.write()?;
        call(|| robot.move_payload(payload, offset.into()))
    }

    /// Replaces the robot's parameters; they persist over resets.
    ///
    /// With the same geometry (radii, wheel angles, position of the center of mass) the motion continues; otherwise the
    /// robot restarts upright at rest.
    ///
    /// Raises:
    ///     ValueError: the parameters do not describe a robot that the model can simulate; nothing has changed then.
    fn set_params(&self, params: Robot) -> PyResult<()> {
        let mut robot = self.0.write()?;
        call(|| robot.set_params(&params.0)).map(|_| ())
    }

    /// The current state.
    #[getter]
    fn state(&self) -> PyResult<PyState> {
        Ok(PyState(self.0.read()?.state()))
    }

    /// Contact forces of the last step; `contact` and `rigid` return zeros until the first step.
    #[getter]
    fn contacts(&self) -> PyResult<PyContacts> {
        let robot = self.0.read()?;
        Ok(PyContacts { contacts: robot.contacts(), params: robot.params().clone() })
    }

    /// Kinetic plus potential energy, J; the latter is zero with the body's CoM at the ball center's height.
    #[getter]
    fn energy(&self) -> PyResult<f64> {
        Ok(self.0.read()?.energy())
    }

    /// Deflections of the two payloads from their places, m, then their rates, m/s, body axes, shape (2, 6); zeros for a payload
    /// that the robot does not have. A reset puts payloads at their places.
    #[getter]
    fn payloads<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        PyArray1::from_slice(py, &numbers_of(&self.0.read()?.payloads())).reshape([PAYLOADS, 6])
    }

    /// Replaces the deflections of the payloads; a reset puts them at their places.
    ///
    /// Args:
    ///     payloads: deflections from their places, m, then their rates, m/s, body axes, shape (2, 6), as the attribute
    ///         `payloads`; zeros for a payload that the robot does not have.
    ///
    /// Raises:
    ///     ValueError: a wrong shape, a number beyond 1000 m or 1000 m/s, or numbers of a robot without such a payload; the
    ///         payloads then stay as they are.
    fn set_payloads(&self, payloads: &Bound<'_, PyAny>) -> PyResult<()> {
        let numbers = finite_elements("payloads", payloads, &[Some(PAYLOADS), Some(6)], NUMBERS)?;
        let deflections = deflections_of(&numbers)[0];
        let mut robot = self.0.write()?;
        call(|| robot.set_payloads(&deflections))
    }

    /// Simulated time since the reset, s.
    #[getter]
    fn time(&self) -> PyResult<f64> {
        Ok(self.0.read()?.time())
    }

    /// The robot's parameters.
    #[getter]
    fn params(&self) -> PyResult<PyParams> {
        Ok(PyParams(self.0.read()?.params().clone()))
    }

    /// The model's name.
    #[getter]
    fn model(&self) -> PyResult<&'static str> {
        Ok(self.0.read()?.kind().name())
    }

    /// Time step, s.
    #[getter]
    fn sim_dt(&self) -> PyResult<f64> {
        Ok(self.0.read()?.sim_dt())
    }

    /// The complete state, for `restore`.
    fn snapshot<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.0.read()?.save()))
    }

    /// Continues, bit for bit, from a snapshot of a robot with the same arguments.
    ///
    /// Restore only snapshots from `snapshot`: the checksum detects damage, not forgery.
    ///
    /// Raises:
    ///     ValueError: the bytes are not such a snapshot, or its numbers are not finite; nothing has changed then.
    fn restore(&self, snapshot: &[u8]) -> PyResult<()> {
        let mut robot = self.0.write()?;
        call(|| robot.load(snapshot))
    }

    fn __repr__(&self) -> PyResult<String> {
        let robot = self.0.read()?;
        Ok(format!("Ballbot(model='{}', sim_dt={}, time={:.4})", robot.kind(), robot.sim_dt(), robot.time()))
    }

    fn __getnewargs__(&self) -> PyResult<(PyParams, &'static str, f64, Option<PyTerrain>)> {
        let robot = self.0.read()?;
        let terrain = robot.terrain().map(|terrain| PyTerrain(Arc::clone(terrain)));
        Ok((PyParams(robot.params().clone()), robot.kind().name(), robot.sim_dt(), terrain))
    }

    fn __getstate__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        self.snapshot(py)
    }

    fn __setstate__(&self, snapshot: &[u8]) -> PyResult<()> {
        self.restore(snapshot)
    }
}
