//! `Controller`, `Pid` and `Lqr`.

use crate::errors::{InvalidInputError, call, not_pickled, to_python};
use crate::exclusive::Exclusive;
use crate::robot::params::Robot;
use crate::robot::state::PyState;
use crate::values::convert::{array, elements, matrix, numbers, shaped};
use crate::values::keywords::unknown;
use crate::values::numbers::{one_or_more, optional_real, real};
use ballbot_core::batch::Design;
use ballbot_core::control::{
    Constant, Constants, Controller, DEFAULT_TRACTION, LimitOptions, Lqr, LqrOptions, Pid, PidGains, SETPOINT_PARTS,
    Sampled, Setpoint, controller_kind,
};
use ballbot_core::fields::{Fields, OptionDescription};
use ballbot_core::models::Scale;
use ballbot_core::models::linear::{INPUTS, STATES};
use ballbot_core::{Params, Result, one_of};
use nalgebra::DMatrix;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping};

type Argument<'a, 'py> = Option<&'a Bound<'py, PyAny>>;
type Keywords<'a, 'py> = Option<&'a Bound<'py, PyDict>>;

/// The option of controllers that predict over the delay of the motors.
const DELAY: &str = "delay";

/// Length of a part of a setpoint.
fn part_len(name: &str) -> usize {
    Setpoint::default().part(name).len()
}

/// Setpoints of `n` robots from a mapping; a value applies to all robots, or has one row per robot.
pub(crate) fn setpoints(
    controller: &PyController,
    law: &dyn Controller,
    n: usize,
    parts: &Bound<'_, PyDict>,
) -> PyResult<Vec<Setpoint>> {
    let mut setpoints = vec![Setpoint::default(); n];
    for (name, value) in parts {
        let name: String = name.extract()?;
        controller.check_part(law, &name)?;
        let len = part_len(&name);
        let shape: &[Option<usize>] = if len == 1 { &[] } else { &[Some(len)] };
        let shared = elements::<f64>(&name, &value, shape, len);
        let values = match shared {
            Ok(values) => values.repeat(n),
            Err(_) if len == 1 => shaped(&name, &value, [n])?,
            Err(_) => shaped(&name, &value, [n, len])?,
        };
        ballbot_core::check_finite(&name, &values).map_err(to_python)?;
        for (setpoint, values) in setpoints.iter_mut().zip(values.chunks(len)) {
            setpoint.part_mut(&name).copy_from_slice(values);
        }
    }
    Ok(setpoints)
}

/// Numbers by name from keyword arguments; `known` are the names that are accepted, and whether None is, the default of
/// the robot.
fn options(
    class: &str,
    keywords: Keywords<'_, '_>,
    known: &[(&'static str, bool)],
) -> PyResult<Vec<(String, Vec<f64>)>> {
    let mut options = Vec::new();
    for (name, value) in keywords.into_iter().flatten() {
        let name: String = name.extract()?;
        let Some(&(_, scaled)) = known.iter().find(|(known, _)| *known == name) else {
            let known: Vec<_> = known.iter().map(|(name, _)| *name).collect();
            return Err(unknown(value.py(), class, &name, &known));
        };
        if scaled && value.is_none() {
            continue;
        }
        let values = one_or_more(&name, &value)?;
        options.push((name, values));
    }
    Ok(options)
}

fn borrowed(options: &[(String, Vec<f64>)]) -> Vec<(&str, &[f64])> {
    options.iter().map(|(name, values)| (name.as_str(), values.as_slice())).collect()
}

/// Options for the paper's robot, each with its unit, which scales.
type Scaled = Vec<(String, Vec<f64>, &'static str)>;

/// The units of options for the paper's robot, none of which is among `others`.
fn with_units(
    options: Vec<(String, Vec<f64>)>,
    others: &[(String, Vec<f64>)],
    described: &[OptionDescription],
) -> PyResult<Scaled> {
    let unit = |(name, values): (String, Vec<f64>)| {
        if others.iter().any(|(other, _)| *other == name) {
            return Err(PyTypeError::new_err(format!("{name} is given twice: as an option and in scaled")));
        }
        let unit = described.iter().find(|option| option.name == name).map_or("", |option| option.unit);
        if name == DELAY || unit.is_empty() || Scale::of(&Params::paper()).factor(unit).is_none() {
            return Err(InvalidInputError::new_err(format!("scaled: {name} (unit '{unit}') does not scale")));
        }
        Ok((name, values, unit))
    };
    options.into_iter().map(unit).collect()
}

/// The options of a robot.
fn of_robot(scaled: &Scaled, params: &Params) -> Vec<(String, Vec<f64>)> {
    if scaled.is_empty() {
        return Vec::new();
    }
    let scale = Scale::of(params);
    let times = |values: &[f64], unit| values.iter().map(|value| value * scale.factor(unit).unwrap_or(1.0)).collect();
    scaled.iter().map(|(name, values, unit)| (name.clone(), times(values, unit))).collect()
}

/// Torque limits from arguments, in place of the limits of a law.
fn limits(
    own: LimitOptions,
    max_torque: Option<f64>,
    traction: Argument<'_, '_>,
    speed_limit: Option<f64>,
    boundary: Argument<'_, '_>,
) -> PyResult<LimitOptions> {
    let traction = match traction.filter(|value| !value.is_none()) {
        None => own.traction,
        Some(value) if value.extract::<bool>().is_ok() => value.extract::<bool>()?.then_some(DEFAULT_TRACTION),
        Some(value) => {
            Some(real(value).map_err(|_| PyTypeError::new_err("traction must be True, False, a number or None"))?)
        }
    };
    let boundary =
        boundary.filter(|value| !value.is_none()).map(|value| numbers::<4>("boundary", value)).transpose()?;
    Ok(LimitOptions { max_torque, traction, speed_limit, boundary })
}

/// Numbers, vectors and matrices by name.
pub(crate) fn constants_dict<'py>(py: Python<'py>, constants: &Constants) -> PyResult<Bound<'py, PyDict>> {
    let found = PyDict::new(py);
    for Constant { name, shape, values } in constants.iter() {
        if shape.is_empty() {
            found.set_item(name, values[0])?;
        } else {
            found.set_item(name, PyArray1::from_slice(py, values).reshape(shape.clone())?)?;
        }
    }
    Ok(found)
}

/// A feedback law by its name (see `CONTROLLERS`), for one robot when called, for all robots of a `Batch` in Rust.
///
/// ```python
/// law = bb.Controller("lqi", "kugle", control_dt=0.01, position=0.1)
/// torques = law(bb.State.at_rest("kugle", tilt=(0.05, 0.0)), position=(0.5, 0.0))
/// ```
///
/// Args:
///     name: a key of `CONTROLLERS`, as "lqr".
///     robot: the robot; None is the paper's.
///     control_dt: time between two calls, s; None is the period that the law is designed for, or 0.01.
///     max_torque: limit of each wheel torque, N·m; None is the motors' limit with `traction`, else 0.9 of the torque
///         at which a wheel of the upright robot slips.
///     traction: whether torques are scaled down so that no wheel slips or lifts, yaw torque first; True is 0.9 of the
///         friction limit, a number from 0.01 to 1 that fraction; None is True, except for "pid" (False).
///     speed_limit: largest speed of the ball over the floor, m/s, kept by a control barrier; None does not limit it.
///     boundary: least and largest x, then y, of the ball's center in the inertial frame, shape (4,), m, kept by a
///         control barrier; None means no boundary.
///     scaled: weights or gains of the law for the paper's robot, by name, except for `delay`. Each is scaled
///         to the robot by `Params.scale` of its unit, so that similar robots have similar laws; its limits apply to the
///         scaled number.
///     options: weights or gains of the law.
///
/// Raises:
///     ValueError: an unknown name, a number out of range, or an option of `scaled` that does not scale.
///     TypeError: an option that the law does not have, or that is given twice.
#[pyclass(name = "Controller", module = "ballbot_rs", subclass, frozen)]
pub(crate) struct PyController {
    name: String,
    class: &'static str,
    /// The robot that it is designed for.
    pub(crate) params: Params,
    pub(crate) law: Exclusive<Box<dyn Controller>>,
    /// Its design for other robots.
    pub(crate) design: Box<Design>,
}

/// A controller as an argument.
pub(crate) fn controller_of<'a, 'py>(value: &'a Bound<'py, PyAny>) -> PyResult<&'a Bound<'py, PyController>> {
    value.cast::<PyController>().map_err(|_| {
        let given = value.repr().map_or_else(|_| "another object".to_owned(), |text| text.to_string());
        let given: String = given.chars().take(80).collect();
        PyTypeError::new_err(format!(
            "controller must be a Controller, not {given}: make_controller makes one from a name, and the function \
             rollout and simulate take names, policies and Python functions"
        ))
    })
}

impl PyController {
    fn new<C: Controller + 'static>(
        name: &str,
        class: &'static str,
        params: Params,
        law: C,
        design: impl Fn(&Params, f64) -> Result<C> + Send + Sync + 'static,
    ) -> Self {
        let design = Box::new(move |params: &Params, delay| -> Result<Box<dyn Controller>> {
            Ok(Box::new(design(params, delay)?))
        });
        Self { name: name.to_owned(), class, params, law: Exclusive::new("controller", Box::new(law)), design }
    }

    /// The controller that `design` makes for a robot.
    pub(crate) fn designed(
        name: &str,
        class: &'static str,
        params: Params,
        design: impl Fn(&Params, f64) -> Result<Box<dyn Controller>> + Send + Sync + 'static,
    ) -> PyResult<Self> {
        let law = Exclusive::new("controller", call(|| design(&params, 0.0))?);
        Ok(Self { name: name.to_owned(), class, params, law, design: Box::new(design) })
    }

    pub(crate) fn check_part(&self, law: &dyn Controller, name: &str) -> PyResult<()> {
        if law.parts().contains(&name) {
            return Ok(());
        }
        let known = SETPOINT_PARTS.contains(&name);
        let reason = if known { ", it does not follow that part of a setpoint" } else { "" };
        Err(PyTypeError::new_err(format!(
            "{} got an unexpected keyword argument '{name}'{reason}: expected one of {}",
            self.class,
            one_of(name, law.parts())
        )))
    }
}

impl PyController {
    /// Writes the parts of a mapping that the law follows.
    fn write_setpoint(&self, law: &dyn Controller, setpoint: &Bound<'_, PyAny>, target: &mut Setpoint) -> PyResult<()> {
        let Ok(setpoint) = setpoint.cast::<PyMapping>() else {
            let kind = setpoint.get_type().name()?;
            return Err(PyTypeError::new_err(format!("setpoint must be a mapping of parts by name, not {kind}")));
        };
        let items = setpoint.items()?;
        let mut follows = items.is_empty();
        for item in items.iter() {
            let (name, value): (String, Bound<'_, PyAny>) = item.extract()?;
            if law.parts().contains(&name.as_str()) {
                write_part(target, &name, &value)?;
                follows = true;
            } else if !SETPOINT_PARTS.contains(&name.as_str()) {
                let known = SETPOINT_PARTS.join(", ");
                return Err(PyTypeError::new_err(format!("a setpoint has no part '{name}': expected one of {known}")));
            }
        }
        if follows {
            return Ok(());
        }
        let known = law.parts().join(", ");
        Err(PyTypeError::new_err(format!("{} follows no part of this setpoint: it follows {known}", self.class)))
    }
}

/// Writes a part of a setpoint.
fn write_part(target: &mut Setpoint, name: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
    let values = if part_len(name) == 1 {
        vec![real(value).map_err(|_| PyTypeError::new_err(format!("{name} must be a number")))?]
    } else {
        numbers::<2>(name, value)?.to_vec()
    };
    ballbot_core::check_finite(name, &values).map_err(to_python)?;
    target.part_mut(name).copy_from_slice(&values);
    Ok(())
}

#[pymethods]
impl PyController {
    #[new]
    #[pyo3(signature = (
        name, robot=None, control_dt=None, *, max_torque=None, traction=None, speed_limit=None, boundary=None, scaled=None,
        **options
    ))]
    #[allow(clippy::too_many_arguments, reason = "keywords of Python")]
    fn py_new(
        name: &str,
        robot: Option<Robot>,
        #[pyo3(from_py_with = optional_real)] control_dt: Option<f64>,
        #[pyo3(from_py_with = optional_real)] max_torque: Option<f64>,
        traction: Argument<'_, '_>,
        #[pyo3(from_py_with = optional_real)] speed_limit: Option<f64>,
        boundary: Argument<'_, '_>,
        scaled: Option<&Bound<'_, PyDict>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let kind = controller_kind(name).map_err(to_python)?;
        let described = (kind.options)();
        let known: Vec<_> = described.iter().map(|option| (option.name, option.scaled)).collect();
        let options = self::options("Controller", options, &known)?;
        let scaled = with_units(self::options("Controller", scaled, &known)?, &options, &described)?;
        let params = Robot::or_paper(robot);
        let control_dt = control_dt.or(kind.control_dt).unwrap_or(0.01);
        let limits = limits(kind.limits, max_torque, traction, speed_limit, boundary)?;
        let predicts = known.iter().any(|(name, _)| *name == DELAY) && !options.iter().any(|(name, _)| name == DELAY);
        let design = move |params: &Params, delay: f64| {
            let delay = [delay];
            let predicted = (predicts && delay[0] > 0.0).then_some((DELAY, &delay[..]));
            let scaled = of_robot(&scaled, params);
            let options: Vec<_> = borrowed(&options).into_iter().chain(borrowed(&scaled)).chain(predicted).collect();
            (kind.make)(params, control_dt, &limits, &options)
        };
        Self::designed(name, "Controller", params, design)
    }

    /// Wheel torques for the next `control_dt`, shape (3,), N·m.
    ///
    /// `setpoint` is a mapping of parts, such as a `Reference` gives; parts that the law does not follow are ignored,
    /// but it must follow at least one. Instead, parts may be keywords, each in `setpoint_parts`: `position`
    /// and `velocity` (x, y of the ball, inertial frame, m and m/s), `acceleration`, `jerk` and `snap` (x, y of the
    /// flat output, inertial frame, m/s² and its derivatives: lean and torques are fed forward from them), `yaw` (rad),
    /// `yaw_rate` (rad/s), `tilt` (x, y, heading frame, rad). Other parts raise TypeError.
    #[pyo3(signature = (state, setpoint=None, **parts))]
    fn __call__<'py>(
        &self,
        py: Python<'py>,
        state: &PyState,
        setpoint: Argument<'_, 'py>,
        parts: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let mut law = self.law.write()?;
        let mut target = Setpoint::default();
        if let Some(setpoint) = setpoint {
            if parts.is_some_and(|parts| !parts.is_empty()) {
                return Err(PyTypeError::new_err("a controller takes a setpoint or its parts as keywords, not both"));
            }
            self.write_setpoint(law.as_ref(), setpoint, &mut target)?;
        }
        for (name, value) in parts.into_iter().flatten() {
            let name: String = name.extract()?;
            self.check_part(law.as_ref(), &name)?;
            write_part(&mut target, &name, &value)?;
        }
        target.validate().map_err(to_python)?;
        Ok(array(py, law.wheel_torques(&state.0, &target).as_slice()))
    }

    /// Clears the memory of the law.
    fn reset(&self) -> PyResult<()> {
        self.law.write()?.reset();
        Ok(())
    }

    /// Estimate of the horizontal external force on the body at the last call: x and y, inertial frame, shape (2,),
    /// N. None if the law does not estimate it: with the option `lean_observer` above 0 the laws that have it do, and
    /// "admittance" does.
    ///
    /// Its height does not matter, nor does a CoM offset. The weight of the robot along a slope counts as a force,
    /// and so does friction that the parameters do not have.
    #[getter]
    fn outside_force<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        let mut law = self.law.write()?;
        let Some(index) = law.force_index() else { return Ok(None) };
        Ok(Some(array(py, &law.memory_mut()[index..index + 2])))
    }

    /// Standard deviation of `outside_force` along x and y of the heading frame, shape (2,), N, by white noise of the
    /// state; None as `outside_force`. Noise of the tilt has no effect.
    ///
    /// Args:
    ///     velocity: standard deviation of a component of the measured velocity of the ball, m/s.
    ///     tilt_rate: of a component of the tilt rate, rad/s.
    ///
    /// Raises:
    ///     ValueError: a standard deviation that is negative or above 1e6.
    #[pyo3(signature = (velocity, tilt_rate))]
    fn outside_force_deviation<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = real)] velocity: f64,
        #[pyo3(from_py_with = real)] tilt_rate: f64,
    ) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        for (name, value) in [("velocity", velocity), ("tilt_rate", tilt_rate)] {
            if !(0.0..=1e6).contains(&value) {
                return Err(PyValueError::new_err(format!("{name} = {value}, it must be from 0 to 1e6")));
            }
        }
        Ok(self.law.read()?.force_deviation(&[0.0, velocity, tilt_rate]).map(|deviation| array(py, &deviation)))
    }

    /// Constants of the law, by name: numbers, vectors and matrices. `ballbot export` writes them as C.
    ///
    /// Raises:
    ///     ValueError: a law that does not provide them.
    fn constants<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let law = self.law.read()?;
        let constants = law.constants().ok_or_else(|| {
            PyValueError::new_err(format!("the controller '{}' does not give its constants", self.name))
        })?;
        constants_dict(py, &constants)
    }

    /// Name of the law.
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    /// Time between two calls, s.
    #[getter]
    fn control_dt(&self) -> PyResult<f64> {
        Ok(self.law.read()?.control_dt())
    }

    /// Parts of a setpoint that it follows.
    #[getter]
    fn setpoint_parts(&self) -> PyResult<Vec<&'static str>> {
        Ok(self.law.read()?.parts().to_vec())
    }

    fn __reduce__(&self) -> PyResult<()> {
        not_pickled(self.class, "pass on its name, robot and options, and make another of them")
    }

    fn __repr__(&self) -> PyResult<String> {
        Ok(format!("<{} '{}', control_dt={} s>", self.class, self.name, self.control_dt()?))
    }
}

/// The paper's PID with filtered derivative, on both components of the tilt from the equilibrium.
///
/// ```python
/// pid = bb.Pid(control_dt=0.002, proportional=20.0)
/// print(pid(bb.State.at_rest("paper", tilt=(0.05, 0.0))))
/// ```
///
/// It holds neither position nor heading.
///
/// Args:
///     robot: the robot; None is the paper's.
///     control_dt: time between two calls, s. The derivative filter of the paper's gains is stable up to 9.9 ms.
///     proportional: k_p, N·m/rad.
///     integral: k_i, N·m/(rad·s).
///     derivative: k_d, N·m·s/rad.
///     filter_coefficient: N, rad/s.
///     mapping: "consistent" or "as_printed", as in `virtual_to_wheel_torques`.
///     max_torque: as in `Controller`.
///     traction: as in `Controller`; None is False.
///     speed_limit, boundary: as in `Controller`.
///
/// Raises:
///     ValueError: a number out of range; "as_printed" for wheels that are uneven.
#[pyclass(name = "Pid", module = "ballbot_rs", subclass, frozen, extends = PyController)]
pub(crate) struct PyPid;

#[pymethods]
impl PyPid {
    #[new]
    #[pyo3(
        signature = (
            robot=None, control_dt=Pid::PAPER_CONTROL_DT, *, mapping="consistent", max_torque=None, traction=None,
            speed_limit=None, boundary=None, **gains
        ),
        text_signature = "(robot=None, control_dt=0.002, *, mapping='consistent', max_torque=None, traction=None, \
                          speed_limit=None, boundary=None, **gains)"
    )]
    #[allow(clippy::too_many_arguments, reason = "keywords of Python")]
    fn new(
        robot: Option<Robot>,
        #[pyo3(from_py_with = real)] control_dt: f64,
        mapping: &str,
        #[pyo3(from_py_with = optional_real)] max_torque: Option<f64>,
        traction: Argument<'_, '_>,
        #[pyo3(from_py_with = optional_real)] speed_limit: Option<f64>,
        boundary: Argument<'_, '_>,
        gains: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let map = mapping.parse().map_err(to_python)?;
        let gains: PidGains = fields("Pid", gains)?;
        let params = Robot::or_paper(robot);
        let limits = limits(LimitOptions::CAP, max_torque, traction, speed_limit, boundary)?;
        let design = move |params: &Params, _| Pid::with_map(params, control_dt, &gains, map, &limits);
        let pid = call(|| design(&params, 0.0))?;
        Ok(PyClassInitializer::from(PyController::new("pid", "Pid", params, pid, design)).add_subclass(Self))
    }
}

/// A struct of fields from keyword arguments.
fn fields<F: Fields>(class: &str, keywords: Keywords<'_, '_>) -> PyResult<F> {
    let known: Vec<_> = F::FIELDS.iter().map(|field| (field.name, field.scaled)).collect();
    let mut fields = F::unset();
    for (name, values) in options(class, keywords, &known)? {
        fields.set(&name, &values).map_err(to_python)?;
    }
    Ok(fields)
}

/// A discrete linear-quadratic regulator of position, tilt and heading, from the linear model of any robot.
///
/// ```python
/// lqr = bb.Lqr("kugle", control_dt=0.01, position=0.05)
/// print(lqr.gain, lqr(bb.State.at_rest("kugle", tilt=(0.05, 0.0))))
/// ```
///
/// Args:
///     robot: the robot; None is the paper's.
///     control_dt: time between two calls, s.
///     Q: cost of the states of `LinearModel` (10×10, or its diagonal), in place of the weights.
///     R: cost of the torques (3×3, or its diagonal), in place of `torque`.
///     max_torque: as in `Controller`.
///     traction: as in `Controller`; None is True.
///     speed_limit, boundary: as in `Controller`.
///     weights: deviations of equal cost (Bryson's rule): `position` (0.15 m), `velocity` (0.4 m/s), `tilt` (0.1 rad),
///         `tilt_rate` (1 rad/s), `yaw` (0.5 rad), `yaw_rate` (2 rad/s), `torque` (0.2 N·m); and `max_lean` (0.175
///         rad), the largest lean that deviations of position and velocity may command, and `max_speed` (1 m/s), the
///         largest speed that deviations of position may command. Also `delay` (0 s), the time between a torque and its
///         effect, a multiple of `control_dt` that is predicted over, and `lean_observer` (0 1/s), the rate at which
///         the equilibrium lean is estimated; a slope, a force or a wrong center of mass changes it. The defaults of
///         `torque` and `max_lean` are for the paper's robot, and scaled for another (`docs/conventions.md`).
///
/// Raises:
///     ValueError: a number out of range, or a cost that is not symmetric and positive.
///     TypeError: an unknown weight.
#[pyclass(name = "Lqr", module = "ballbot_rs", subclass, frozen, extends = PyController)]
pub(crate) struct PyLqr(Sampled<Lqr>);

/// A cost matrix from a matrix, or from its diagonal.
fn cost(name: &str, value: &Bound<'_, PyAny>, size: usize) -> PyResult<DMatrix<f64>> {
    if let Ok(diagonal) = shaped::<f64, 1>(name, value, [size]) {
        return Ok(DMatrix::from_diagonal(&diagonal.into()));
    }
    let rows = shaped::<f64, 2>(name, value, [size, size])?;
    ballbot_core::check_finite(name, &rows).map_err(to_python)?;
    Ok(DMatrix::from_row_slice(size, size, &rows))
}

/// The design of a regulator for a robot whose motors have a delay.
fn regulator(
    control_dt: f64,
    [q, r]: [Argument<'_, '_>; 2],
    limits: LimitOptions,
    weights: Keywords<'_, '_>,
) -> PyResult<impl Fn(&Params, f64) -> Result<Sampled<Lqr>> + Send + Sync + use<>> {
    let options: LqrOptions = fields("Lqr", weights)?;
    let mut predicts = true;
    for (name, _) in weights.into_iter().flatten() {
        let name: String = name.extract()?;
        if name == "torque" && r.is_some() {
            return Err(PyTypeError::new_err("Lqr takes R or the weight torque, not both"));
        }
        predicts &= name != DELAY;
        let own = ["torque", "max_lean", "max_speed", DELAY, "lean_observer"];
        if !own.contains(&name.as_str()) && q.is_some() {
            return Err(PyTypeError::new_err(format!("Lqr takes Q or the weight {name}, not both")));
        }
    }
    let q = q.map(|q| cost("Q", q, STATES)).transpose()?;
    let r = r.map(|r| cost("R", r, INPUTS)).transpose()?;
    Ok(move |params: &Params, delay: f64| {
        params.validate()?;
        let weights = Scale::of(params).fit(&options.weights);
        weights.check_limits()?;
        let (own_q, own_r) = weights.matrices();
        let costs = [q.as_ref().unwrap_or(&own_q), r.as_ref().unwrap_or(&own_r)];
        let mut options = options;
        if predicts {
            options.delay.delay = delay;
        }
        Lqr::with_costs(params, control_dt, costs, &options, &limits)
    })
}

#[pymethods]
impl PyLqr {
    #[new]
    #[pyo3(signature = (
        robot=None, control_dt=0.01, *, Q=None, R=None, max_torque=None, traction=None, speed_limit=None,
        boundary=None, **weights
    ))]
    #[allow(clippy::too_many_arguments, reason = "keywords of Python")]
    #[allow(non_snake_case, reason = "the names that SciPy and python-control give these matrices")]
    fn new(
        robot: Option<Robot>,
        #[pyo3(from_py_with = real)] control_dt: f64,
        Q: Argument<'_, '_>,
        R: Argument<'_, '_>,
        #[pyo3(from_py_with = optional_real)] max_torque: Option<f64>,
        traction: Argument<'_, '_>,
        #[pyo3(from_py_with = optional_real)] speed_limit: Option<f64>,
        boundary: Argument<'_, '_>,
        weights: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let limits = limits(LimitOptions::TRACTION, max_torque, traction, speed_limit, boundary)?;
        let params = Robot::or_paper(robot);
        let design = regulator(control_dt, [Q, R], limits, weights)?;
        let lqr = call(|| design(&params, 0.0))?;
        let controller = PyController::new("lqr", "Lqr", params, lqr.clone(), design);
        Ok(PyClassInitializer::from(controller).add_subclass(Self(lqr)))
    }

    /// Deviation x that the gain multiplies, shape (10,), in the heading frame: m, rad, m/s, rad/s.
    ///
    /// Position error (x, y), tilt (x, y) from the equilibrium, yaw error, then their rates.
    #[pyo3(signature = (state, *, position=None, velocity=None, yaw=0.0))]
    fn deviation<'py>(
        &self,
        py: Python<'py>,
        state: &PyState,
        position: Argument<'_, 'py>,
        velocity: Argument<'_, 'py>,
        #[pyo3(from_py_with = real)] yaw: f64,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let pair = |name: &str, value: Argument<'_, '_>| value.map_or(Ok([0.0; 2]), |v| numbers::<2>(name, v));
        let setpoint = Setpoint {
            position: pair("position", position)?.into(),
            velocity: pair("velocity", velocity)?.into(),
            yaw,
            ..Setpoint::default()
        };
        setpoint.validate().map_err(to_python)?;
        Ok(array(py, self.0.deviation(&state.0, &setpoint).as_slice()))
    }

    /// K (3×10): the torques are −K x of the deviation x, before they are limited.
    #[getter]
    fn gain<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        matrix(py, &self.0.regulator().gain)
    }

    /// S (10×10), the solution of the Riccati equation: the sum of xᵀQx + uᵀRu over all steps from x is xᵀSx.
    #[getter]
    fn riccati_solution<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        matrix(py, &self.0.regulator().cost)
    }

    /// Relative residual of the Riccati equation.
    #[getter]
    fn residual(&self) -> f64 {
        self.0.regulator().residual
    }
}
