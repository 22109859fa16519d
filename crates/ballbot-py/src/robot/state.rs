//! `State` and `Contacts`.

use crate::errors::{call, to_python};
use crate::robot::params::{PyParams, Robot};
use crate::values::convert::{array, numbers, vector, vector_or};
use crate::values::keywords::no_others;
use crate::values::numbers::real;
use crate::values::short;
use ballbot_core::{Contacts, Error, Params, State, Wheels, check_finite, unit_quaternion, wxyz};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use numpy::PyArray1;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::f64::consts::PI;

type Array<'py> = Bound<'py, PyArray1<f64>>;
type Argument<'a, 'py> = Option<&'a Bound<'py, PyAny>>;

/// Position, attitude and velocities of ball, body and wheels, immutable; attributes are fresh float64 arrays.
///
/// ```python
/// state = bb.State.at_rest("kugle", tilt=(0.05, 0.0), yaw=0.3)
/// print(state.tilt, state.yaw, state.to_array().shape)
/// ```
///
/// `body_angular_velocity` is in the body frame, all other vectors are in the inertial frame (z up, floor at z = 0).
/// Velocities and rates default to zero, attitudes to identity, `body_position` (origin of the body frame) to
/// `ball_position`, `body_velocity` to `ball_velocity`. Positions, velocities and wheel values have the shape (3,),
/// quaternions (w, x, y, z) the shape (4,).
///
/// Raises:
///     ValueError: a wrong shape, a number that is not finite, a quaternion whose length is not 1.
#[pyclass(name = "State", module = "ballbot_rs", frozen, eq)]
#[derive(Clone, PartialEq)]
pub(crate) struct PyState(pub State);

fn quaternion(name: &str, value: Argument<'_, '_>) -> PyResult<UnitQuaternion<f64>> {
    match value {
        Some(v) => unit_quaternion(name, numbers::<4>(name, v)?).map_err(to_python),
        None => Ok(UnitQuaternion::identity()),
    }
}

const NAMES: [&str; 10] = [
    "ball_position",
    "ball_velocity",
    "ball_angular_velocity",
    "body_quaternion",
    "body_angular_velocity",
    "wheel_speeds",
    "ball_quaternion",
    "wheel_angles",
    "body_position",
    "body_velocity",
];

/// Units of [`NAMES`].
const UNITS: [&str; 10] = ["m", "m/s", "rad/s", "w, x, y, z", "rad/s", "rad/s", "w, x, y, z", "rad", "m", "m/s"];

#[pymethods]
impl PyState {
    #[new]
    #[pyo3(signature = (
        ball_position, ball_velocity=None, ball_angular_velocity=None, body_quaternion=None,
        body_angular_velocity=None, wheel_speeds=None, *, ball_quaternion=None, wheel_angles=None,
        body_position=None, body_velocity=None
    ))]
    #[expect(clippy::too_many_arguments, reason = "the state has ten parts")]
    fn new(
        ball_position: &Bound<'_, PyAny>,
        ball_velocity: Argument<'_, '_>,
        ball_angular_velocity: Argument<'_, '_>,
        body_quaternion: Argument<'_, '_>,
        body_angular_velocity: Argument<'_, '_>,
        wheel_speeds: Argument<'_, '_>,
        ball_quaternion: Argument<'_, '_>,
        wheel_angles: Argument<'_, '_>,
        body_position: Argument<'_, '_>,
        body_velocity: Argument<'_, '_>,
    ) -> PyResult<Self> {
        let zero = Vector3::zeros();
        let ball_position = vector("ball_position", ball_position)?;
        let ball_velocity = vector_or("ball_velocity", ball_velocity, zero)?;
        let state = State {
            ball_position,
            ball_quaternion: quaternion("ball_quaternion", ball_quaternion)?,
            ball_velocity,
            ball_angular_velocity: vector_or("ball_angular_velocity", ball_angular_velocity, zero)?,
            body_position: vector_or("body_position", body_position, ball_position)?,
            body_quaternion: quaternion("body_quaternion", body_quaternion)?,
            body_velocity: vector_or("body_velocity", body_velocity, ball_velocity)?,
            body_angular_velocity: vector_or("body_angular_velocity", body_angular_velocity, zero)?,
            wheel_angles: Wheels::of_column(vector_or("wheel_angles", wheel_angles, zero)?),
            wheel_speeds: Wheels::of_column(vector_or("wheel_speeds", wheel_speeds, zero)?),
        };
        state.validate().map_err(to_python)?;
        Ok(Self(state))
    }

    /// At rest on the floor at the origin: rotated by `yaw` (rad), then tilted by the rotation vector (x, y, 0) (rad).
    #[staticmethod]
    #[pyo3(signature = (robot=None, tilt=None, yaw=0.0, **others), text_signature = "(robot, tilt=(0.0, 0.0), yaw=0.0)")]
    fn at_rest(
        robot: Option<Robot>,
        tilt: Argument<'_, '_>,
        #[pyo3(from_py_with = real)] yaw: f64,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        no_others("State.at_rest", others)?;
        let robot = required("State.at_rest", robot)?;
        tilted(&robot.0, tilt, yaw, State::tilted).map(Self)
    }

    /// At rest in equilibrium on the floor at the origin, the body's center of mass above the center of the ball; then
    /// rotated by `yaw` (rad) and tilted by the rotation vector (x, y, 0) (rad). Equal to `at_rest` for a robot whose
    /// center of mass is on the mast.
    #[staticmethod]
    #[pyo3(signature = (robot=None, tilt=None, yaw=0.0, **others), text_signature = "(robot, tilt=(0.0, 0.0), yaw=0.0)")]
    fn at_equilibrium(
        robot: Option<Robot>,
        tilt: Argument<'_, '_>,
        #[pyo3(from_py_with = real)] yaw: f64,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        no_others("State.at_equilibrium", others)?;
        let robot = required("State.at_equilibrium", robot)?;
        tilted(&robot.0, tilt, yaw, State::tilted_from_equilibrium).map(Self)
    }

    /// Rolling without slip with the ball's velocity (x, y): ball and wheel rates follow from it.
    #[staticmethod]
    #[pyo3(
        signature = (robot, ball_velocity, body_quaternion=None, body_angular_velocity=None, ball_spin=0.0, **others),
        text_signature = "(robot, ball_velocity, body_quaternion=None, body_angular_velocity=None, ball_spin=0.0)"
    )]
    fn rolling(
        robot: Robot,
        ball_velocity: &Bound<'_, PyAny>,
        body_quaternion: Argument<'_, '_>,
        body_angular_velocity: Argument<'_, '_>,
        #[pyo3(from_py_with = real)] ball_spin: f64,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        no_others("State.rolling", others)?;
        let velocity: Vector2<f64> = numbers::<2>("ball_velocity", ball_velocity)?.into();
        let attitude = quaternion("body_quaternion", body_quaternion)?;
        let rate = vector_or("body_angular_velocity", body_angular_velocity, Vector3::zeros())?;
        let state = State::rolling(&robot.0, velocity, ball_spin, attitude, rate);
        state.validate().map_err(to_python)?;
        Ok(Self(state))
    }

    /// The inverse of `to_array`.
    #[staticmethod]
    fn from_array(values: &Bound<'_, PyAny>) -> PyResult<Self> {
        let values = numbers::<{ State::LEN }>("values", values)?;
        let state = State::from_array(&values);
        state.validate().map_err(to_python)?;
        Ok(Self(state))
    }

    /// All values, shape (32,): position (3), quaternion (4), velocity (3) and angular velocity (3) of the ball, the
    /// same for the body, wheel angles (3), wheel speeds (3).
    fn to_array<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.0.to_array())
    }

    /// Copy with some fields changed.
    #[pyo3(signature = (**changes))]
    fn replace<'py>(slf: &Bound<'py, Self>, changes: Option<&Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
        let arguments = PyDict::new(slf.py());
        for name in NAMES {
            arguments.set_item(name, slf.getattr(name)?)?;
        }
        for (name, value) in changes.into_iter().flatten() {
            if !arguments.contains(&name)? {
                return Err(PyTypeError::new_err(format!("State has no field {name}; it has {}", NAMES.join(", "))));
            }
            arguments.set_item(name, value)?;
        }
        slf.get_type().call((), Some(&arguments))
    }

    /// Position of the ball center, inertial frame, m.
    #[getter]
    fn ball_position<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, self.0.ball_position.as_slice())
    }

    /// Attitude of the ball, (w, x, y, z), ball to inertial.
    #[getter]
    fn ball_quaternion<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &wxyz(&self.0.ball_quaternion))
    }

    /// Velocity of the ball center, inertial frame, m/s.
    #[getter]
    fn ball_velocity<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, self.0.ball_velocity.as_slice())
    }

    /// Angular velocity of the ball, inertial frame, rad/s.
    #[getter]
    fn ball_angular_velocity<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, self.0.ball_angular_velocity.as_slice())
    }

    /// Position of the origin of the body frame, inertial frame, m; the ball center unless a wheel has lifted off.
    #[getter]
    fn body_position<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, self.0.body_position.as_slice())
    }

    /// Attitude of the body, (w, x, y, z), body to inertial.
    #[getter]
    fn body_quaternion<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &wxyz(&self.0.body_quaternion))
    }

    /// Velocity of the origin of the body frame, inertial frame, m/s.
    #[getter]
    fn body_velocity<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, self.0.body_velocity.as_slice())
    }

    /// Angular velocity of the body, body frame, rad/s.
    #[getter]
    fn body_angular_velocity<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, self.0.body_angular_velocity.as_slice())
    }

    /// Rotation of each wheel relative to the body about its axle, rad.
    #[getter]
    fn wheel_angles<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, self.0.wheel_angles.as_slice())
    }

    /// Rate of each wheel relative to the body about its axle (the encoder rate), rad/s.
    #[getter]
    fn wheel_speeds<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, self.0.wheel_speeds.as_slice())
    }

    /// Angle between the mast and the vertical, rad.
    #[getter]
    fn tilt(&self) -> f64 {
        self.0.tilt()
    }

    /// Rotation vector (x, y) that takes the vertical to the mast, rad.
    #[getter]
    fn tilt_components<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, self.0.tilt_components().as_slice())
    }

    /// Heading, rad, in (−π, π].
    #[getter]
    fn yaw(&self) -> f64 {
        self.0.yaw()
    }

    fn __repr__(&self) -> String {
        let state = &self.0;
        let ball = short::numbers(&state.ball_position.as_slice()[..2]);
        let speed = short::number(state.ball_velocity.xy().norm());
        let tilt = short::number(state.tilt_components().norm().to_degrees());
        let yaw = short::number(state.yaw().to_degrees());
        let wheels = short::numbers(state.wheel_speeds.as_slice());
        format!("<State: ball at {ball} m, {speed} m/s, tilt {tilt} deg, yaw {yaw} deg, wheels {wheels} rad/s>")
    }

    fn _repr_html_(slf: &Bound<'_, Self>) -> PyResult<String> {
        let rows: Vec<_> = NAMES
            .into_iter()
            .zip(UNITS)
            .map(|(name, unit)| Ok((name, slf.getattr(name)?.extract()?, unit)))
            .collect::<PyResult<_>>()?;
        Ok(short::table(rows))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Array<'py>,))> {
        Ok((slf.get_type().getattr("from_array")?, (slf.get().to_array(slf.py()),)))
    }
}

/// The robot of a call that needs one, after its keywords have been checked: an old name has a hint.
fn required(who: &str, robot: Option<Robot>) -> PyResult<Robot> {
    robot.ok_or_else(|| PyTypeError::new_err(format!("{who}() missing 1 required positional argument: 'robot'")))
}

/// A tilt (x, y) as an argument, rad.
pub(crate) fn tilt_of(tilt: &Bound<'_, PyAny>) -> PyResult<Vector2<f64>> {
    let tilt = numbers::<2>("tilt", tilt)?;
    call(|| check_finite("tilt", &tilt))?;
    match tilt.into_iter().enumerate().find(|(_, angle)| angle.abs() > PI) {
        Some((i, value)) => {
            let limit = format!("within ±pi rad; did you mean math.radians({value})?");
            Err(to_python(Error::OutOfRange { name: format!("tilt[{i}]"), value, limit }))
        }
        None => Ok(tilt.into()),
    }
}

/// A state at rest with a tilt and a yaw.
fn tilted(
    params: &Params,
    tilt: Argument<'_, '_>,
    yaw: f64,
    state: fn(&Params, Vector2<f64>, f64) -> State,
) -> PyResult<State> {
    let tilt = tilt.map(tilt_of).transpose()?.unwrap_or_default();
    call(|| {
        check_finite("yaw", &[yaw])?;
        let state = state(params, tilt, yaw);
        state.validate()?;
        Ok(state)
    })
}

/// Pickled contacts: the arguments of [`_contacts_of`].
type Pickled<'py> = (PyParams, Array<'py>, (bool, bool), (u64, u64));

/// Contacts of a robot from their pickled form: loads, tractions and slip speeds of the wheels, force and slip velocity of
/// the floor, forces of the floor on the bot and of obstacles, shape (20,), whether the bot touches the floor and anything
/// an obstacle, and the counts of searched and unsolved steps.
#[pyfunction]
pub(crate) fn _contacts_of(
    params: &PyParams,
    numbers: &Bound<'_, PyAny>,
    touches: (bool, bool),
    steps: (u64, u64),
) -> PyResult<PyContacts> {
    let n = crate::values::convert::numbers::<20>("numbers", numbers)?;
    let three = |first: usize| [n[first], n[first + 1], n[first + 2]];
    let contacts = Contacts {
        wheel_normal_forces: Wheels(three(0)),
        wheel_tractions: Wheels(three(3)),
        wheel_slip_speeds: Wheels(three(6)),
        floor_force: three(9).into(),
        floor_slip_velocity: [n[12], n[13]].into(),
        bot_floor_force: three(14).into(),
        obstacle_force: three(17).into(),
        bot_on_floor: touches.0,
        on_obstacle: touches.1,
        searched_steps: steps.0,
        unsolved_steps: steps.1,
    };
    contacts.validate().map_err(to_python)?;
    Ok(PyContacts { contacts, params: params.0.clone() })
}

/// Contact forces during the last step; attributes are fresh float64 arrays.
///
/// ```python
/// robot = bb.Ballbot()
/// robot.step([0.0, 0.0, 0.0], steps=10)
/// print(robot.contacts.wheel_normal_forces, robot.contacts.wheel_tractions)
/// ```
#[pyclass(name = "Contacts", module = "ballbot_rs", frozen)]
pub(crate) struct PyContacts {
    pub(crate) contacts: Contacts,
    pub(crate) params: Params,
}

#[pymethods]
impl PyContacts {
    /// Load of each wheel on the ball, N.
    #[getter]
    fn wheel_normal_forces<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, self.contacts.wheel_normal_forces.as_slice())
    }

    /// Traction of each wheel on the ball along its drive direction, N.
    #[getter]
    fn wheel_tractions<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, self.contacts.wheel_tractions.as_slice())
    }

    /// Slip speed of each wheel on the ball along the drive direction, m/s.
    #[getter]
    fn wheel_slip_speeds<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, self.contacts.wheel_slip_speeds.as_slice())
    }

    /// Force of the floor on the ball, inertial frame, N.
    #[getter]
    fn floor_force<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, self.contacts.floor_force.as_slice())
    }

    /// Force of the floor on body and wheels, inertial frame, N; zero in the models `spatial` and `planar`.
    #[getter]
    fn bot_floor_force<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, self.contacts.bot_floor_force.as_slice())
    }

    /// Force of obstacles on ball, body and wheels, inertial frame, N.
    #[getter]
    fn obstacle_force<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, self.contacts.obstacle_force.as_slice())
    }

    /// Velocity (x, y) of the lowest point of the ball, m/s.
    #[getter]
    fn floor_slip_velocity<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, self.contacts.floor_slip_velocity.as_slice())
    }

    /// Whether the body or a wheel touches the floor.
    #[getter]
    fn bot_on_floor(&self) -> bool {
        self.contacts.bot_on_floor
    }

    /// Whether the ball, the body or a wheel touches an obstacle.
    #[getter]
    fn on_obstacle(&self) -> bool {
        self.contacts.on_obstacle
    }

    /// Steps since the reset in which the first guess of sticking and slipping contacts was wrong.
    #[getter]
    fn searched_steps(&self) -> u64 {
        self.contacts.searched_steps
    }

    /// Searched steps in which no impulses satisfied the contact conditions, or, in the model `rigid`, the impulses of
    /// wheels and bot did not converge with each other.
    #[getter]
    fn unsolved_steps(&self) -> u64 {
        self.contacts.unsolved_steps
    }

    /// Fraction of the dynamic friction limit in use, three wheels and floor, shape (4,). Models without slip are valid
    /// up to 1.
    #[getter]
    fn friction_utilization<'py>(&self, py: Python<'py>) -> Array<'py> {
        array(py, &self.contacts.friction_utilization(&self.params))
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Pickled<'py>)> {
        let c = &self.contacts;
        let wheels = [c.wheel_normal_forces.0, c.wheel_tractions.0, c.wheel_slip_speeds.0].concat();
        let floor = [c.floor_force.as_slice(), c.floor_slip_velocity.as_slice()].concat();
        let others = [c.bot_floor_force.as_slice(), c.obstacle_force.as_slice()].concat();
        let touches = (c.bot_on_floor, c.on_obstacle);
        let steps = (c.searched_steps, c.unsolved_steps);
        let restore = py.import("ballbot_rs._core")?.getattr("_contacts_of")?;
        Ok((restore, (PyParams(self.params.clone()), array(py, &[wheels, floor, others].concat()), touches, steps)))
    }

    fn __repr__(&self) -> String {
        let Contacts { wheel_normal_forces, wheel_slip_speeds, floor_force, bot_on_floor, on_obstacle, .. } =
            &self.contacts;
        format!(
            "<Contacts: loads {} N, slip {} m/s, floor {} N{}{}>",
            short::numbers(wheel_normal_forces.as_slice()),
            short::numbers(wheel_slip_speeds.as_slice()),
            short::number(floor_force.norm()),
            if *bot_on_floor { ", the bot touches it" } else { "" },
            if *on_obstacle { ", on an obstacle" } else { "" }
        )
    }

    fn _repr_html_(&self) -> String {
        let c = &self.contacts;
        short::table([
            ("wheel_normal_forces", c.wheel_normal_forces.0.to_vec(), "N"),
            ("wheel_tractions", c.wheel_tractions.0.to_vec(), "N"),
            ("wheel_slip_speeds", c.wheel_slip_speeds.0.to_vec(), "m/s"),
            ("floor_force", c.floor_force.as_slice().to_vec(), "N"),
            ("bot_floor_force", c.bot_floor_force.as_slice().to_vec(), "N"),
            ("obstacle_force", c.obstacle_force.as_slice().to_vec(), "N"),
            ("floor_slip_velocity", c.floor_slip_velocity.as_slice().to_vec(), "m/s"),
            ("friction_utilization", c.friction_utilization(&self.params).to_vec(), ""),
        ])
    }
}
