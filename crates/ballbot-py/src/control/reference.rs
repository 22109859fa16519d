//! `Reference`.

use crate::control::controllers::PyController;
use crate::errors::{call, to_python};
use crate::robot::params::{PyParams, Robot};
use crate::values::convert::{ANY_COUNT, OPTION_COUNT, array, elements, finite_elements, matrix, numbers, objects};
use crate::values::keywords::unknown;
use crate::values::numbers::{optional_real, real};
use ballbot_core::control::{Controller, MOTION_PARTS, Motion, Reference, Setpoint, Turning};
use ballbot_core::{Error, Params, Result, require_memory};
use nalgebra::DMatrix;
use numpy::PyArray2;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PySequence, PyTuple};

type Argument<'a, 'py> = Option<&'a Bound<'py, PyAny>>;

/// A motion of the ball with the required lean and torques: setpoints over time, from rest at time 0.
///
/// ```python
/// circle = bb.Reference.circle(radius=0.5, period=6.0, robot="kugle")
/// print(circle.demand, circle(2.0)["position"])
/// print(bb.simulate("lqr", reference=circle, robot="kugle", seconds=2.0))
/// ```
///
/// Made by `hold`, `line`, `path`, `stops`, `velocities`, `circle`, `square`, `lemniscate` or `attitude`. A motion that
/// needs more traction or torque than the robot has is rejected; the message has a time that would suffice.
///
/// Arguments of all of them:
///     robot: the robot that follows it; None is the robot that `simulate` and `Batch.rollout` run it on, and
///         otherwise the paper's.
///     yaw: initial heading, rad.
///     yaw_rate: rate that the heading reaches within a second, rad/s.
///     friction: fraction of the friction limit of the wheels that the motion may use, from 0.01 to 1; None allows any.
///
/// Raises:
///     ValueError: numbers that do not define a motion, or a motion that the robot cannot follow.
#[pyclass(name = "Reference", module = "ballbot_rs", frozen)]
pub(crate) struct PyReference {
    kind: &'static str,
    /// The robot, if it was given.
    params: Option<Params>,
    friction: Option<f64>,
    reference: Reference,
}

/// The motion with the arguments that all have, from keywords.
fn new(kind: &'static str, motion: Motion, common: Option<&Bound<'_, PyDict>>) -> PyResult<PyReference> {
    let (mut given, mut turning, mut friction) = (None, Turning::default(), Some(1.0));
    for (name, value) in common.into_iter().flatten() {
        match name.extract::<String>()?.as_str() {
            "robot" => given = value.extract::<Option<Robot>>()?.map(|robot| robot.0),
            "yaw" => turning.yaw = real(&value)?,
            "yaw_rate" => turning.rate = real(&value)?,
            "friction" => friction = optional_real(&value)?,
            other => return Err(unknown(value.py(), &format!("Reference.{kind}"), other, &[])),
        }
    }
    let params = given.clone().unwrap_or_else(Params::paper);
    let reference = call(|| Reference::new(&params, motion, turning, friction))?;
    Ok(PyReference { kind, params: given, friction, reference })
}

impl PyReference {
    /// The motion on a robot with `params`.
    fn on(&self, params: &Params) -> Result<Reference> {
        if self.params.as_ref().is_some_and(|own| own == params) {
            return Ok(self.reference.clone());
        }
        if self.params.is_none() {
            return Reference::new(params, self.reference.motion().clone(), self.reference.turning(), self.friction);
        }
        if self.reference.suits(params) {
            return Ok(self.reference.clone());
        }
        Err(Error::Inconsistent(format!(
            "the Reference '{}' was made for another robot, which leans otherwise in the same motion: make it without \
             robot=, or for this robot",
            self.kind
        )))
    }
}

/// Rows of x and y.
fn rows(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<[f64; 2]>> {
    let values = elements::<f64>(name, value, &[None, Some(2)], OPTION_COUNT)?;
    Ok(values.chunks_exact(2).map(|row| [row[0], row[1]]).collect())
}

fn times_of(value: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    elements("times", value, &[None], OPTION_COUNT)
}

#[pymethods]
impl PyReference {
    /// The ball stays at `position`, shape (2,), m.
    #[staticmethod]
    #[pyo3(
        signature = (position, **common),
        text_signature = "(position, *, robot=None, yaw=0.0, yaw_rate=0.0, friction=1.0)"
    )]
    fn hold(position: &Bound<'_, PyAny>, common: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let position = numbers("position", position)?;
        new("hold", Motion::Hold { position }, common)
    }

    /// From rest at `start` to rest at `goal`, both of shape (2,), m, on a straight line in `seconds`.
    #[staticmethod]
    #[pyo3(
        signature = (goal, seconds, start=None, **common),
        text_signature = "(goal, seconds, start=None, *, robot=None, yaw=0.0, yaw_rate=0.0, friction=1.0)"
    )]
    fn line(
        goal: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = real)] seconds: f64,
        start: Argument<'_, '_>,
        common: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let start = start.map_or(Ok([0.0; 2]), |start| numbers("start", start))?;
        let motion = Motion::Path { points: vec![start, numbers("goal", goal)?], times: vec![0.0, seconds] };
        new("line", motion, common)
    }

    /// Smoothly through `points`, shape (n, 2), m, at `times`, shape (n,), s, at rest at the first and the last.
    #[staticmethod]
    #[pyo3(
        signature = (points, times, **common),
        text_signature = "(points, times, *, robot=None, yaw=0.0, yaw_rate=0.0, friction=1.0)"
    )]
    fn path(points: &Bound<'_, PyAny>, times: &Bound<'_, PyAny>, common: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let motion = Motion::Path { points: rows("points", points)?, times: times_of(times)? };
        new("path", motion, common)
    }

    /// On straight lines between `points`, shape (n, 2), m, at rest at each at `times`, shape (n,), s.
    #[staticmethod]
    #[pyo3(
        signature = (points, times, **common),
        text_signature = "(points, times, *, robot=None, yaw=0.0, yaw_rate=0.0, friction=1.0)"
    )]
    fn stops(
        points: &Bound<'_, PyAny>,
        times: &Bound<'_, PyAny>,
        common: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let motion = Motion::Stops { points: rows("points", points)?, times: times_of(times)? };
        new("stops", motion, common)
    }

    /// Around a square of `side` (m) from the origin, at rest at each corner, a side in `seconds`.
    #[staticmethod]
    #[pyo3(
        signature = (side, seconds, **common),
        text_signature = "(side, seconds, *, robot=None, yaw=0.0, yaw_rate=0.0, friction=1.0)"
    )]
    fn square(
        #[pyo3(from_py_with = real)] side: f64,
        #[pyo3(from_py_with = real)] seconds: f64,
        common: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let points = vec![[0.0; 2], [side, 0.0], [side, side], [0.0, side], [0.0; 2]];
        let times = (0..5).map(|k| f64::from(k) * seconds).collect();
        new("square", Motion::Stops { points, times }, common)
    }

    /// At `velocities`, shape (n, 2), m/s, from rest at the origin; each change begins at `times`, shape (n,), s, and
    /// takes `change` seconds.
    #[staticmethod]
    #[pyo3(
        signature = (velocities, times, change, **common),
        text_signature = "(velocities, times, change, *, robot=None, yaw=0.0, yaw_rate=0.0, friction=1.0)"
    )]
    fn velocities(
        velocities: &Bound<'_, PyAny>,
        times: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = real)] change: f64,
        common: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let (velocities, times) = (rows("velocities", velocities)?, times_of(times)?);
        let motion = Motion::Velocities { velocities, times, change };
        new("velocities", motion, common)
    }

    /// Around a circle of `radius` (m) through the origin, a turn in `period` seconds, up to speed within `start` seconds.
    #[staticmethod]
    #[pyo3(
        signature = (radius, period, start=4.0, **common),
        text_signature = "(radius, period, start=4.0, *, robot=None, yaw=0.0, yaw_rate=0.0, friction=1.0)"
    )]
    fn circle(
        #[pyo3(from_py_with = real)] radius: f64,
        #[pyo3(from_py_with = real)] period: f64,
        #[pyo3(from_py_with = real)] start: f64,
        common: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let motion = Motion::Circle { radius, period, start };
        new("circle", motion, common)
    }

    /// Around x = a sin ωt, y = a sin ωt cos ωt, a = `size` (m), a turn in `period` seconds, up to speed within `start` seconds.
    #[staticmethod]
    #[pyo3(
        signature = (size, period, start=4.0, **common),
        text_signature = "(size, period, start=4.0, *, robot=None, yaw=0.0, yaw_rate=0.0, friction=1.0)"
    )]
    fn lemniscate(
        #[pyo3(from_py_with = real)] size: f64,
        #[pyo3(from_py_with = real)] period: f64,
        #[pyo3(from_py_with = real)] start: f64,
        common: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let motion = Motion::Lemniscate { size, period, start };
        new("lemniscate", motion, common)
    }

    /// Back and forth along x, so that the tilt about y is a sine of amplitude `lean` (rad) and `frequency` (Hz), which it
    /// reaches within `start` seconds.
    #[staticmethod]
    #[pyo3(
        signature = (lean, frequency, start=4.0, **common),
        text_signature = "(lean, frequency, start=4.0, *, robot=None, yaw=0.0, yaw_rate=0.0, friction=1.0)"
    )]
    fn attitude(
        #[pyo3(from_py_with = real)] lean: f64,
        #[pyo3(from_py_with = real)] frequency: f64,
        #[pyo3(from_py_with = real)] start: f64,
        common: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let motion = Motion::Attitude { lean, frequency, start };
        new("attitude", motion, common)
    }

    /// Setpoint at `time` (s): arrays and numbers by the names of its parts, as controllers take them.
    fn __call__<'py>(&self, py: Python<'py>, #[pyo3(from_py_with = real)] time: f64) -> PyResult<Bound<'py, PyDict>> {
        ballbot_core::check_finite("time", &[time]).map_err(to_python)?;
        let setpoint = self.reference.at(time);
        let parts = PyDict::new(py);
        for name in MOTION_PARTS {
            match setpoint.part(name) {
                [value] => parts.set_item(name, value)?,
                values => parts.set_item(name, array(py, values))?,
            }
        }
        Ok(parts)
    }

    /// Setpoints at `times`, shape (n,), s: arrays by name, with n rows each.
    fn sample<'py>(&self, py: Python<'py>, times: &Bound<'_, PyAny>) -> PyResult<Bound<'py, PyDict>> {
        let times = finite_elements("times", times, &[None], ANY_COUNT)?;
        // In addition to the setpoints, a part in the core and in NumPy.
        require_memory("the setpoints", times.len(), 2 * size_of::<Setpoint>()).map_err(to_python)?;
        let setpoints: Vec<Setpoint> = times.iter().map(|t| self.reference.at(*t)).collect();
        let parts = PyDict::new(py);
        for name in MOTION_PARTS {
            let width = Setpoint::default().part(name).len();
            let values = DMatrix::from_fn(setpoints.len(), width, |i, j| setpoints[i].part(name)[j]);
            match width {
                1 => parts.set_item(name, array(py, values.as_slice()))?,
                _ => parts.set_item(name, matrix(py, &values))?,
            }
        }
        Ok(parts)
    }

    /// When the motion ends, s; None if it does not.
    #[getter]
    fn duration(&self) -> Option<f64> {
        self.reference.duration()
    }

    /// When the first turn at full speed of a circle or lemniscate ends, s; None for other motions.
    #[getter]
    fn first_turn(&self) -> Option<f64> {
        self.reference.first_turn()
    }

    /// Largest fraction of the friction limit, the load or the torque of a wheel that the motion uses.
    #[getter]
    fn demand(&self) -> f64 {
        self.reference.demand()
    }

    /// The smallest factor by which the motion must be slowed down for its demand to be `friction`; None if no factor
    /// below 1000 suffices.
    #[pyo3(signature = (friction=1.0))]
    fn slowdown(&self, py: Python<'_>, #[pyo3(from_py_with = real)] friction: f64) -> PyResult<Option<f64>> {
        py.detach(|| self.reference.slowdown(friction)).map_err(to_python)
    }

    /// The same motion on another robot, as `simulate` and `Batch.rollout` take it.
    ///
    /// Raises:
    ///     ValueError: a motion that this robot cannot follow; a reference that was made with `robot` of another
    ///         robot, which leans differently.
    fn for_robot(&self, robot: Robot) -> PyResult<Self> {
        let reference = call(|| self.on(&robot.0))?;
        Ok(Self { kind: self.kind, params: Some(robot.0), friction: self.friction, reference })
    }

    /// The robot that it was made with; None if none was given.
    #[getter]
    fn params(&self) -> Option<PyParams> {
        self.params.clone().map(PyParams)
    }

    /// Calls the method that made it.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let (py, this) = (slf.py(), slf.get());
        let rows = |rows: &[[f64; 2]]| PyArray2::from_owned_array(py, rows.to_vec().into()).into_any();
        let row = |values: &[f64]| array(py, values).into_any();
        let numbers = |values: &[f64]| PyTuple::new(py, values);
        let arguments = match (this.kind, this.reference.motion()) {
            (_, Motion::Hold { position }) => PyTuple::new(py, [row(position)])?,
            ("line", Motion::Path { points, times }) => {
                (row(&points[1]), times[1], row(&points[0])).into_pyobject(py)?
            }
            ("square", Motion::Stops { points, times }) => numbers(&[points[1][0], times[1]])?,
            (_, Motion::Path { points, times } | Motion::Stops { points, times }) => {
                PyTuple::new(py, [rows(points), row(times)])?
            }
            (_, Motion::Velocities { velocities, times, change }) => {
                (rows(velocities), row(times), change).into_pyobject(py)?
            }
            (_, Motion::Circle { radius, period, start }) => numbers(&[*radius, *period, *start])?,
            (_, Motion::Lemniscate { size, period, start }) => numbers(&[*size, *period, *start])?,
            (_, Motion::Attitude { lean, frequency, start }) => numbers(&[*lean, *frequency, *start])?,
        };
        let common = PyDict::new(py);
        let Turning { yaw, rate, .. } = this.reference.turning();
        common.set_item("robot", this.params.clone().map(PyParams))?;
        common.set_item("yaw", yaw)?;
        common.set_item("yaw_rate", rate)?;
        common.set_item("friction", this.friction)?;
        let partial = py.import("functools")?.getattr("partial")?;
        Ok((partial.call((slf.get_type().getattr(this.kind)?,), Some(&common))?, arguments))
    }

    fn __repr__(&self) -> String {
        let duration = self.reference.duration().map_or_else(String::new, |t| format!(", duration={t} s"));
        format!("<Reference '{}'{duration}>", self.kind)
    }
}

/// References that robots follow, one per robot or one for all.
pub(crate) struct References(Vec<Reference>);

impl References {
    /// References from a single one or a sequence with one for each of `n` robots; `None` if the value is neither.
    pub(crate) fn extracted(
        controller: &PyController,
        law: &dyn Controller,
        n: usize,
        value: &Bound<'_, PyAny>,
    ) -> PyResult<Option<Self>> {
        let references = if let Ok(one) = value.cast::<PyReference>() {
            vec![call(|| one.get().on(&controller.params))?]
        } else if value.cast::<PyDict>().is_err() && value.cast::<PySequence>().is_ok() {
            let wrong = || PyTypeError::new_err("setpoints must be a dict, a Reference or a list of them");
            let found = value.len().map_err(|_| wrong())?;
            if found != n {
                let error = ballbot_core::Error::Length { name: "setpoints".into(), found, expected: n };
                return Err(to_python(error));
            }
            let of = |one: &Bound<'_, PyAny>| match one.cast::<PyReference>() {
                Ok(one) => call(|| one.get().on(&controller.params)),
                Err(_) => Err(wrong()),
            };
            objects("setpoints", value, n)?.iter().map(of).collect::<PyResult<_>>()?
        } else {
            return Ok(None);
        };
        controller.check_part(law, "position")?;
        Ok(Some(Self(references)))
    }

    /// Writes the setpoints of all robots at time `t`.
    pub(crate) fn write(&self, t: f64, setpoints: &mut [Setpoint]) {
        match self.0.as_slice() {
            [one] => setpoints.fill(one.at(t)),
            each => each.iter().zip(setpoints).for_each(|(reference, setpoint)| *setpoint = reference.at(t)),
        }
    }

    /// Checks that the setpoints at both times are within their limits.
    pub(crate) fn check(&self, times: [f64; 2]) -> Result<()> {
        self.0.iter().try_for_each(|reference| times.iter().try_for_each(|t| reference.at(*t).validate()))
    }
}
