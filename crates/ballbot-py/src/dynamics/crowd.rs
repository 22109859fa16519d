//! `Crowd`.

use crate::dynamics::jacobian::torques_of_shape;
use crate::errors::{InvalidInputError, call};
use crate::exclusive::Exclusive;
use crate::robot::params::{PyParams, Robot};
use crate::robot::payloads::{NUMBERS, deflections_of, numbers_of, payload_index};
use crate::robot::state::{PyContacts, PyState};
use crate::robot::terrain::{PyTerrain, terrain as ground};
use crate::signals::interruptible;
use crate::values::convert::{
    OPTION_COUNT, elements, finite_elements, objects, optional_vector, outside_force, vector,
};
use crate::values::keywords::no_others;
use crate::values::numbers::{count, optional_real, real, whole};
use ballbot_core::{Crowd, PAYLOADS, Params, State, sim::Between};
use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyString};
use std::sync::Arc;

/// Robots of the model "rigid" in one world: ball, body and wheels of each touch the other robots.
///
/// A robot that touches no other moves as a `Ballbot` of the same model, to the last bit while none touches anything but its
/// ball and a level floor.
///
/// ```python
/// crowd = bb.Crowd(["paper", "paper"], positions=[(0.0, 0.0), (0.4, 0.0)])
/// laws = [bb.Lqr(params, control_dt=0.01) for params in crowd.params]
/// crowd.push(0, (1.0, 0.0, 0.0))
/// for _ in range(200):
///     crowd.step([law(state) for law, state in zip(laws, crowd.states)], steps=10)
/// print(crowd.force_between(0, 1), [state.tilt for state in crowd.states])
/// ```
///
/// Args:
///     robots: robots in any form: `Params`, names of presets, paths of TOML files, or dicts of parameters; 1 to 64, all
///         with the same gravity and floor, except for its friction under their balls.
///     positions: of their balls, shape (n, 2), m. The robots start at rest above them, and `reset` returns there.
///     friction: Coulomb friction coefficient between robots, 0 to 10.
///     restitution: between robots, 0 to 0.5.
///     sim_dt: time step, s.
///     terrain: the ground, a `Terrain`, the name of a kind or a dict for `Terrain.generate`; None is level.
///
/// Raises:
///     ValueError: a number out of range, robots that overlap, are on different floors, or cannot rest where they
///         are placed.
#[pyclass(name = "Crowd", module = "ballbot_rs", subclass, frozen)]
pub(crate) struct PyCrowd(Exclusive<Crowd>);

/// Robots and their positions.
type Arguments = (Vec<PyParams>, Vec<Vec<f64>>);

impl PyCrowd {
    /// Checks the number of a robot.
    fn robot(crowd: &Crowd, name: &str, robot: i64) -> PyResult<usize> {
        let n = crowd.num_robots();
        usize::try_from(robot).ok().filter(|robot| *robot < n).ok_or_else(|| {
            InvalidInputError::new_err(format!("{name} = {robot} is out of range: there are robots 0 to {}", n - 1))
        })
    }
}

#[pymethods]
impl PyCrowd {
    #[new]
    #[pyo3(
        signature = (robots, positions, *, friction=0.3, restitution=0.0, sim_dt=0.001, terrain=None, **others),
        text_signature = "(robots, positions, *, friction=0.3, restitution=0.0, sim_dt=0.001, terrain=None)"
    )]
    fn new(
        robots: &Bound<'_, PyAny>,
        positions: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = real)] friction: f64,
        #[pyo3(from_py_with = real)] restitution: f64,
        #[pyo3(from_py_with = real)] sim_dt: f64,
        terrain: Option<&Bound<'_, PyAny>>,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        no_others("Crowd", others)?;
        if robots.is_instance_of::<PyString>() {
            return Err(PyTypeError::new_err("robots must be a list of robots, not one robot"));
        }
        let robots = objects("robots", robots, OPTION_COUNT)?;
        let robots: Vec<Params> =
            robots.iter().map(|robot| Ok(robot.extract::<Robot>()?.0)).collect::<PyResult<_>>()?;
        let numbers: Vec<f64> = elements("positions", positions, &[None, Some(2)], OPTION_COUNT)?;
        let positions: Vec<_> = numbers.chunks_exact(2).map(|place| [place[0], place[1]]).collect();
        let ground = terrain.map_or(Ok(None), ground)?;
        let between = Between { friction, restitution };
        let crowd = call(|| Crowd::new(&robots, &positions, ground.as_ref(), between, sim_dt))?;
        Ok(Self(Exclusive::new("Crowd", crowd)))
    }

    fn __len__(&self) -> PyResult<usize> {
        Ok(self.0.read()?.num_robots())
    }

    /// Restarts each robot from a state; None restores the states at rest in which they were created.
    ///
    /// Raises:
    ///     ValueError: not a state for each, a state out of bounds or below the floor, or robots that overlap by more than
    ///         1 mm; all robots are then unchanged.
    #[pyo3(signature = (states=None))]
    fn reset(&self, states: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let mut crowd = self.0.write()?;
        let states: Vec<State> = match states {
            None => crowd.start().to_vec(),
            Some(states) => objects("states", states, crowd.num_robots())?
                .iter()
                .enumerate()
                .map(|(i, state)| match state.cast::<PyState>() {
                    Ok(state) => Ok(state.get().0.clone()),
                    Err(_) => {
                        let kind = state.get_type().name()?;
                        Err(PyTypeError::new_err(format!("states[{i}] must be a State, not {kind}")))
                    }
                })
                .collect::<PyResult<_>>()?,
        };
        call(|| crowd.reset(&states))
    }

    /// Advances by `steps` time steps under constant motor torques of each robot, shape (n, 3), N·m.
    ///
    /// Raises:
    ///     ValueError: a torque that is not finite or beyond its robot's `max_wheel_torque`; nothing has moved then.
    ///     DivergedError: the state of a robot has left the simulation's bounds; all stop until a reset.
    ///     KeyboardInterrupt: Ctrl-C during a long call; `time` is the simulated time reached.
    #[pyo3(signature = (wheel_torques, steps=1))]
    fn step(
        &self,
        py: Python<'_>,
        wheel_torques: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = whole)] steps: i64,
    ) -> PyResult<()> {
        let steps = count("steps", steps, 0)?;
        let mut crowd = self.0.write()?;
        let crowd = &mut *crowd;
        let n = crowd.num_robots();
        let torques = torques_of_shape(wheel_torques, &[Some(n), Some(3)])?;
        interruptible(py, || crowd.step(&torques, steps))
    }

    /// Applies an impulse (inertial frame, N·s) to the body of a robot at `point` (body frame, m; None is its CoM), over the
    /// next time step.
    #[pyo3(signature = (robot, impulse, point=None))]
    fn push(
        &self,
        #[pyo3(from_py_with = whole)] robot: i64,
        impulse: &Bound<'_, PyAny>,
        point: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let impulse = vector("impulse", impulse)?;
        let point = optional_vector("point", point)?;
        let mut crowd = self.0.write()?;
        let robot = Self::robot(&crowd, "robot", robot)?;
        call(|| crowd.push(robot, &impulse, point.as_ref()))
    }

    /// Replaces the external force on the body of a robot, as `Ballbot.apply_force`.
    ///
    /// Raises:
    ///     ValueError: a number out of range; the former force then stays.
    #[pyo3(signature = (robot, force, point=None, *, frequency=0.0, phase=0.0, delay=0.0, duration=None))]
    #[allow(clippy::too_many_arguments, reason = "keywords of Python")]
    fn apply_force(
        &self,
        #[pyo3(from_py_with = whole)] robot: i64,
        force: &Bound<'_, PyAny>,
        point: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = real)] frequency: f64,
        #[pyo3(from_py_with = real)] phase: f64,
        #[pyo3(from_py_with = real)] delay: f64,
        #[pyo3(from_py_with = optional_real)] duration: Option<f64>,
    ) -> PyResult<()> {
        let force = outside_force(force, point, frequency, phase, delay, duration)?;
        let mut crowd = self.0.write()?;
        let robot = Self::robot(&crowd, "robot", robot)?;
        call(|| crowd.apply_force(robot, &force))
    }

    /// Moves the rest position of the springs of a robot's payload, as `Ballbot.move_payload`.
    ///
    /// Args:
    ///     robot: its number.
    ///     offset: from the payload's place, body axes, shape (3,), m.
    ///     payload: 0, or 1 for the second payload.
    ///
    /// Raises:
    ///     ValueError: a robot without such a payload, or a number beyond ±1000 m; the former offset then stays.
    #[pyo3(signature = (robot, offset, *, payload=0))]
    fn move_payload(
        &self,
        #[pyo3(from_py_with = whole)] robot: i64,
        offset: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = payload_index)] payload: usize,
    ) -> PyResult<()> {
        let offset = vector("offset", offset)?;
        let mut crowd = self.0.write()?;
        let robot = Self::robot(&crowd, "robot", robot)?;
        call(|| crowd.move_payload(robot, payload, offset.into()))
    }

    /// Replaces the deflections of the payloads of all robots; a reset puts them at their places.
    ///
    /// Args:
    ///     payloads: as the attribute `payloads`, shape (n, 2, 6); zeros for payloads that a robot does not have.
    ///
    /// Raises:
    ///     ValueError: a wrong shape, a number beyond 1000 m or 1000 m/s, or numbers of a robot without such a payload; the
    ///         payloads then stay as they are.
    fn set_payloads(&self, payloads: &Bound<'_, PyAny>) -> PyResult<()> {
        let mut crowd = self.0.write()?;
        let n = crowd.num_robots();
        let numbers = finite_elements("payloads", payloads, &[Some(n), Some(PAYLOADS), Some(6)], NUMBERS * n)?;
        call(|| crowd.set_payloads(&deflections_of(&numbers)))
    }

    /// Mean force of robot `of` on robot `on` in the last step, inertial frame, shape (3,), N.
    fn force_between<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = whole)] of: i64,
        #[pyo3(from_py_with = whole)] on: i64,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let crowd = self.0.read()?;
        let force = crowd.force_between(Self::robot(&crowd, "of", of)?, Self::robot(&crowd, "on", on)?);
        Ok(PyArray1::from_slice(py, force.as_slice()))
    }

    /// Current state of each robot.
    #[getter]
    fn states(&self) -> PyResult<Vec<PyState>> {
        Ok(self.0.read()?.states().into_iter().map(PyState).collect())
    }

    /// Contact forces of each robot in the last step, without the forces between robots; zeros until the first step.
    #[getter]
    fn contacts(&self) -> PyResult<Vec<PyContacts>> {
        let crowd = self.0.read()?;
        let of = |robot| PyContacts { contacts: crowd.contacts(robot), params: crowd.params(robot).clone() };
        Ok((0..crowd.num_robots()).map(of).collect())
    }

    /// Kinetic plus potential energy of each robot, shape (n,), J, as `Ballbot.energy`.
    #[getter]
    fn energy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let crowd = self.0.read()?;
        Ok(PyArray1::from_iter(py, (0..crowd.num_robots()).map(|robot| crowd.energy(robot))))
    }

    /// Deflections of each robot's payloads, shape (n, 2, 6), as `Ballbot.payloads`.
    #[getter]
    fn payloads<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let crowd = self.0.read()?;
        let numbers = (0..crowd.num_robots()).flat_map(|robot| numbers_of(&crowd.payloads(robot)));
        PyArray1::from_iter(py, numbers).reshape([crowd.num_robots(), PAYLOADS, 6])
    }

    /// Parameters of each robot.
    #[getter]
    fn params(&self) -> PyResult<Vec<PyParams>> {
        let crowd = self.0.read()?;
        Ok((0..crowd.num_robots()).map(|robot| PyParams(crowd.params(robot).clone())).collect())
    }

    /// Friction between robots.
    #[getter]
    fn friction(&self) -> PyResult<f64> {
        Ok(self.0.read()?.between().friction)
    }

    /// Restitution between robots.
    #[getter]
    fn restitution(&self) -> PyResult<f64> {
        Ok(self.0.read()?.between().restitution)
    }

    /// The ground; None is level.
    #[getter]
    fn terrain(&self) -> PyResult<Option<PyTerrain>> {
        Ok(self.0.read()?.terrain().map(|terrain| PyTerrain(Arc::clone(terrain))))
    }

    /// Simulated time since the reset, s.
    #[getter]
    fn time(&self) -> PyResult<f64> {
        Ok(self.0.read()?.time())
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

    /// Continues, bit for bit, from a snapshot of a crowd with the same arguments.
    ///
    /// Restore only snapshots from `snapshot`: the checksum detects damage, not forgery.
    ///
    /// Raises:
    ///     ValueError: the bytes are not such a snapshot, or its numbers are not finite; nothing has changed then.
    fn restore(&self, snapshot: &[u8]) -> PyResult<()> {
        let mut crowd = self.0.write()?;
        call(|| crowd.load(snapshot))
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Arguments, Bound<'py, PyDict>)> {
        let crowd = self.0.read()?;
        let positions = crowd.start().iter().map(|state| state.ball_position.xy().as_slice().to_vec()).collect();
        let keywords = PyDict::new(py);
        keywords.set_item("friction", crowd.between().friction)?;
        keywords.set_item("restitution", crowd.between().restitution)?;
        keywords.set_item("sim_dt", crowd.sim_dt())?;
        keywords.set_item("terrain", crowd.terrain().map(|terrain| PyTerrain(Arc::clone(terrain))))?;
        Ok(((self.params()?, positions), keywords))
    }

    fn __getstate__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        self.snapshot(py)
    }

    fn __setstate__(&self, snapshot: &[u8]) -> PyResult<()> {
        self.restore(snapshot)
    }

    fn __repr__(&self) -> PyResult<String> {
        let crowd = self.0.read()?;
        Ok(format!("Crowd(robots={}, sim_dt={}, time={:.4})", crowd.num_robots(), crowd.sim_dt(), crowd.time()))
    }
}
