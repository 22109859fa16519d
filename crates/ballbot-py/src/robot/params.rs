//! `Params`.

use crate::errors::{InvalidInputError, call, to_python};
use crate::robot::payloads::payload_index;
use crate::values::numbers::{one_or_more, real};
use ballbot_core::fields::{Fields, describe_options};
use ballbot_core::models::Scale;
use ballbot_core::{Error, Params, check_finite, urdf};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyCFunction, PyDict, PyList, PyMapping, PyTuple};
use std::path::PathBuf;

/// Units of quantities that scale with the robot, for messages.
const UNITS: &str =
    "one of '', 's', '1/s', 'm', 'm/s', 'm/s²', 'm/s³', 'kg', 'N', 'N·s/m', 'rad', 'rad/s', 'N·m', 'N·m/(rad/s)'";

/// The hint for URDFs in place of a robot.
const TWO_URDFS: &str = "URDFs are two, of the bot and of the ball: Params.from_urdf(bot_path, ball_path)";

/// Physical parameters of a ballbot, immutable: scalars are floats, vectors tuples.
///
/// ```python
/// robot = bb.Params.preset("kugle").replace(body_mass=15.0)
/// print(robot.body_mass, robot.equilibrium_wheel_loads)
/// ```
///
/// `body_*` describe everything above the ball: they include the mass of the wheels and exclude the inertia of the
/// wheels about their own axles.
/// `PARAMETERS` has the name, unit, default, limit and description of each; those without a default are required.
///
/// Raises:
///     ValueError: a value is missing, unknown, not finite, or out of range; the message gives the value and the limit.
#[pyclass(name = "Params", module = "ballbot_rs", frozen, eq)]
#[derive(Clone, PartialEq)]
pub(crate) struct PyParams(pub Params);

/// Adds the class, with a property for each parameter.
pub(crate) fn add_to(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add_class::<PyParams>()?;
    let class = py.get_type::<PyParams>();
    let property = py.import("builtins")?.getattr("property")?;
    for (index, field) in describe_options::<Params>().into_iter().enumerate() {
        let get = move |args: &Bound<'_, PyTuple>, _: Option<&Bound<'_, PyDict>>| {
            let params = args.get_item(0)?.cast_into::<PyParams>()?;
            to_object(args.py(), params.get().0.values(index)).map(Bound::unbind)
        };
        let unit = if field.unit.is_empty() { String::new() } else { format!("{}, ", field.unit) };
        let doc = format!("{} ({unit}{})", field.doc, field.limit);
        let get = PyCFunction::new_closure(py, None, None, get)?;
        class.setattr(field.name, property.call1((get, py.None(), py.None(), doc))?)?;
    }
    Ok(())
}

/// Keyword arguments as named slices of numbers.
fn fields(kwargs: Option<&Bound<'_, PyDict>>) -> PyResult<Vec<(String, Vec<f64>)>> {
    let mut fields = Vec::new();
    for (name, value) in kwargs.into_iter().flatten() {
        let name: String = name.extract()?;
        let values = one_or_more(&name, &value)?;
        fields.push((name, values));
    }
    Ok(fields)
}

fn borrowed(fields: &[(String, Vec<f64>)]) -> impl Iterator<Item = (&str, &[f64])> {
    fields.iter().map(|(name, values)| (name.as_str(), values.as_slice()))
}

fn to_object<'py>(py: Python<'py>, values: &[f64]) -> PyResult<Bound<'py, PyAny>> {
    match values {
        [number] => Ok(number.into_pyobject(py)?.into_any()),
        _ => Ok(PyTuple::new(py, values)?.into_any()),
    }
}

#[pymethods]
impl PyParams {
    #[new]
    #[pyo3(signature = (**fields))]
    fn new(fields: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let fields = self::fields(fields)?;
        Params::from_fields(borrowed(&fields)).map(Self).map_err(to_python)
    }

    /// The robot of the paper, Table II.
    #[staticmethod]
    fn paper() -> Self {
        Self(Params::paper())
    }

    /// A published robot by name. Raises ValueError for a name not in `preset_names()`.
    #[staticmethod]
    fn preset(name: &str) -> PyResult<Self> {
        Params::preset(name).map(Self).map_err(to_python)
    }

    /// Names of the published robots.
    #[staticmethod]
    fn preset_names() -> Vec<&'static str> {
        Params::preset_names().to_vec()
    }

    /// Parameters from TOML text or from a TOML file, one key per parameter. A one-line string that ends in ".toml" is
    /// a path.
    ///
    /// Raises:
    ///     ValueError: malformed TOML, or as the constructor; the message has the file, the key and the value.
    ///     OSError: the file cannot be read.
    #[staticmethod]
    fn from_toml(text_or_path: &Bound<'_, PyAny>) -> PyResult<Self> {
        if let Some(path) = toml_path(text_or_path) {
            return call(|| Params::from_toml_file(&path)).map(Self);
        }
        let Ok(text) = text_or_path.extract::<String>() else {
            let kind = text_or_path.get_type().name()?;
            return Err(PyTypeError::new_err(format!("text_or_path must be TOML text or a path, not {kind}")));
        };
        call(|| Params::from_toml(&text)).map(Self)
    }

    /// All values as TOML text; `from_toml` restores them to the last bit.
    fn to_toml(&self) -> String {
        self.0.to_toml()
    }

    /// Parameters of a ballbot described by two URDFs.
    ///
    /// Raises:
    ///     UrdfError: malformed text, or not a ballbot; the message has the reason.
    ///     OSError: a file cannot be read.
    #[staticmethod]
    fn from_urdf(bot_path: PathBuf, ball_path: PathBuf) -> PyResult<Self> {
        call(|| urdf::params_from_urdf(&bot_path, &ball_path)).map(Self)
    }

    /// A copy with some values changed. Raises ValueError as the constructor.
    #[pyo3(signature = (**changes))]
    fn replace(&self, changes: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let changes = fields(changes)?;
        self.0.replace(borrowed(&changes)).map(Self).map_err(to_python)
    }

    /// All values by name.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (name, values) in self.0.fields() {
            dict.set_item(name, to_object(py, values)?)?;
        }
        Ok(dict)
    }

    /// Acceleration of gravity in the frame of the floor, m/s²: (0, 0, -g) on a level floor.
    #[getter]
    fn gravity_vector(&self) -> (f64, f64, f64) {
        <[f64; 3]>::from(self.0.gravity_vector()).into()
    }

    /// The same robot on a floor at rest, with the same friction everywhere; `floor_tilt` is kept.
    fn on_still_floor(&self) -> Self {
        Self(self.0.on_still_floor())
    }

    /// Whether the floor moves, or its friction differs from place to place.
    #[getter]
    fn has_perturbed_floor(&self) -> bool {
        self.0.has_perturbed_floor()
    }

    /// A copy with a payload that moves on the body, in place of its present payload of that number: a point mass on springs and dampers. The
    /// body alone stays the same; `body_*` of the copy describe it with the payload at its place.
    ///
    /// ```python
    /// robot = bb.Params.paper().with_payload(1.0, position=(0.0, 0.0, 0.4), stiffness=300.0, damping=3.0)
    /// print(robot.body_mass, robot.without_payloads().body_mass)
    /// ```
    ///
    /// Args:
    ///     mass: kg; 0 for none.
    ///     position: its place at rest, body frame, m; None keeps the parameter, `payload_position`.
    ///     stiffness: along the body axes, one number for all or three, N/m; None keeps `payload_stiffness`.
    ///     damping: likewise, N/(m/s); None keeps `payload_damping`.
    ///     inertia: of a rigid body about its CoM, body axes, one moment for all or three, kg·m². It turns with the body, so the
    ///         inertia of the body is permanently increased by it; None is a point mass.
    ///     payload: 0, or 1 for a second payload, whose parameters are `second_payload_*`; there must be a first.
    ///
    /// Raises ValueError as the constructor.
    #[pyo3(signature = (mass, *, position=None, stiffness=None, damping=None, inertia=None, payload=0))]
    fn with_payload(
        &self,
        #[pyo3(from_py_with = real)] mass: f64,
        position: Option<&Bound<'_, PyAny>>,
        stiffness: Option<&Bound<'_, PyAny>>,
        damping: Option<&Bound<'_, PyAny>>,
        inertia: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = payload_index)] payload: usize,
    ) -> PyResult<Self> {
        let moments = inertia.map_or(Ok([0.0; 3]), moments_of)?;
        let mut changes = Vec::new();
        let name = self.0.payloads()[payload].name;
        for (what, value) in [("position", position), ("stiffness", stiffness), ("damping", damping)] {
            let Some(value) = value else { continue };
            let name = format!("{name}_{what}");
            let mut values = one_or_more(&name, value)?;
            if let ([one], "stiffness" | "damping") = (&values[..], what) {
                values = vec![*one; 3];
            }
            changes.push((name, values));
        }
        let load = || {
            let mut robot = self.0.without_payloads().replace(borrowed(&changes))?;
            check_finite("mass", &[mass])?;
            for (moment, more) in robot.body_inertia.iter_mut().zip(moments) {
                *moment += more;
            }
            for (index, present) in self.0.payloads().iter().enumerate() {
                let mass = if index == payload { mass } else { present.mass };
                if index == payload || mass > 0.0 {
                    robot = robot.with_payload(index, mass, robot.payloads()[index].position);
                }
            }
            robot.validate()?;
            Ok(robot)
        };
        load().map(Self).map_err(to_python)
    }

    /// The body alone, without its payloads: payloads of 0 kg.
    fn without_payloads(&self) -> Self {
        Self(self.0.without_payloads())
    }

    /// The same robot with its payloads fixed to the body at their positions, as controllers model it.
    fn with_payloads_fixed(&self) -> Self {
        Self(self.0.with_payloads_fixed())
    }

    /// Whether a payload moves on the body.
    #[getter]
    fn has_payload(&self) -> bool {
        self.0.has_payload()
    }

    /// Acceleration of gravity in the frame of the floor `time` s after the start of an episode, less the acceleration of the
    /// floor, m/s²: `gravity_vector` on a floor at rest. Raises ValueError for a time that is not finite.
    fn gravity_at(&self, #[pyo3(from_py_with = real)] time: f64) -> PyResult<(f64, f64, f64)> {
        check_finite("time", &[time]).map_err(to_python)?;
        Ok(<[f64; 3]>::from(self.0.gravity_at(time)).into())
    }

    /// Angular velocity of the floor in its own frame `time` s after the start of an episode, rad/s. Raises ValueError for a
    /// time that is not finite.
    fn floor_rate_at(&self, #[pyo3(from_py_with = real)] time: f64) -> PyResult<(f64, f64, f64)> {
        check_finite("time", &[time]).map_err(to_python)?;
        Ok(<[f64; 3]>::from(self.0.floor_rate_at(time)).into())
    }

    /// Factor by which floor friction at x and y, m, is multiplied: 1 if uniform. Raises ValueError for a place that is
    /// not finite.
    fn floor_friction_factor(
        &self,
        #[pyo3(from_py_with = real)] x: f64,
        #[pyo3(from_py_with = real)] y: f64,
    ) -> PyResult<f64> {
        check_finite("place", &[x, y]).map_err(to_python)?;
        Ok(self.0.floor_friction_factor(x, y))
    }

    /// Tilt (x, y) from the floor's normal at which the robot is at rest on the slope of `floor_tilt`, rad, as
    /// `State.at_equilibrium` takes it. Raises ValueError for a slope that is too steep for the robot.
    fn slope_lean(&self) -> PyResult<(f64, f64)> {
        self.0.slope_lean().map(|lean| (lean.x, lean.y)).map_err(to_python)
    }

    /// Slopes on which the robot can balance at rest in its worst heading, rad, pi/2 where nothing limits it: `fall`, at
    /// which its lean is `fall_tilt` (rad); `traction`, at which a wheel or the ball begins to slip; `motor`, at which
    /// a motor reaches its largest torque. Raises ValueError for a `fall_tilt` out of (0, pi/2].
    #[pyo3(signature = (fall_tilt=0.349_065_850_398_865_9))]
    fn slope_limits<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = real)] fall_tilt: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let limits = self.0.slope_limits(fall_tilt).map_err(to_python)?;
        let out = PyDict::new(py);
        for (name, limit) in [("fall", limits.fall), ("traction", limits.traction), ("motor", limits.motor)] {
            out.set_item(name, limit)?;
        }
        Ok(out)
    }

    /// Factor from a quantity of the paper's robot to the same quantity of this robot, by its unit: "s", "1/s", "m", "m/s",
    /// "m/s²", "m/s³", "kg", "N", "N·s/m", "rad/s", "N·m" or "N·m/(rad/s)", of a wheel. Times scale with the time constant of toppling,
    /// masses with the mass of body and ball, torques with the torque that
    /// holds a lean (Froude scaling; `docs/conventions.md`). "rad" is for leans: the lean that traction and motors can
    /// hold. Raises ValueError for another unit.
    fn scale(&self, unit: &str) -> PyResult<f64> {
        let factor = Scale::of(&self.0).factor(unit);
        factor.ok_or_else(|| InvalidInputError::new_err(format!("unit = '{unit}' has no scale: expected {UNITS}")))
    }

    /// Motor torques that hold the robot still in `slope_lean` at the heading `yaw` (rad), N·m. Raises ValueError as
    /// `slope_lean`.
    #[pyo3(signature = (yaw=0.0))]
    fn holding_torques(&self, #[pyo3(from_py_with = real)] yaw: f64) -> PyResult<(f64, f64, f64)> {
        let torques = check_finite("yaw", &[yaw]).and_then(|()| self.0.holding_torques(yaw));
        torques.map(|torques| torques.0.into()).map_err(to_python)
    }

    /// CoM of the body in the body frame, m: `body_com_offset` and `body_com_height`.
    #[getter]
    fn body_com(&self) -> (f64, f64, f64) {
        <[f64; 3]>::from(self.0.body_com()).into()
    }

    /// Zenith angle of each wheel contact, rad: `wheel_zenith` plus `wheel_zenith_offsets`.
    #[getter]
    fn wheel_zeniths(&self) -> (f64, f64, f64) {
        self.0.wheel_zeniths().0.into()
    }

    /// Half length of a slender mast about the CoM with the body's largest moment of inertia about an axis across the mast,
    /// m: the body is drawn, and touches the floor, with this height.
    #[getter]
    fn slender_half_length(&self) -> f64 {
        self.0.slender_half_length()
    }

    /// Load of each wheel on the ball in equilibrium on a level floor, with the CoM above the ball's center and without
    /// motor torque, N.
    #[getter]
    fn equilibrium_wheel_loads(&self) -> (f64, f64, f64) {
        self.0.equilibrium_wheel_loads().0.into()
    }

    /// Whether the CoM is on the mast, the body axes are principal axes, and the wheels have a common zenith, are 120 deg
    /// apart and have no inclined rollers. The model `planar` takes only such robots.
    #[getter]
    fn is_symmetric(&self) -> bool {
        self.0.is_symmetric()
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let mut parts = Vec::new();
        for (name, values) in self.0.fields() {
            parts.push(format!("{name}={}", to_object(py, values)?.repr()?));
        }
        Ok(format!("Params({})", parts.join(", ")))
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        Ok((PyTuple::empty(py), self.to_dict(py)?))
    }
}

/// Path of a TOML file: a path object, or a one-line string that ends in ".toml".
pub(crate) fn toml_path(value: &Bound<'_, PyAny>) -> Option<PathBuf> {
    match value.extract::<String>() {
        Ok(text) if !text.ends_with(".toml") || text.contains('\n') => None,
        _ => value.extract().ok(),
    }
}

/// A robot as an argument: `Params`, the name of a preset, the path of a TOML file, or a dict of parameters.
pub(crate) struct Robot(pub Params);

impl Robot {
    /// The robot that was given, or the paper's.
    pub(crate) fn or_paper(robot: Option<Self>) -> Params {
        robot.map_or_else(Params::paper, |robot| robot.0)
    }
}

impl FromPyObject<'_, '_> for Robot {
    type Error = PyErr;

    fn extract(robot: Borrowed<'_, '_, PyAny>) -> PyResult<Self> {
        if let Ok(params) = robot.cast::<PyParams>() {
            return Ok(Self(params.get().0.clone()));
        }
        if let Ok(values) = robot.cast::<PyMapping>() {
            let dict = PyDict::new(robot.py());
            dict.update(&values)?;
            return match Params::from_fields(borrowed(&fields(Some(&dict))?)) {
                Err(error @ Error::MissingParameters { .. }) => Err(InvalidInputError::new_err(format!(
                    "{error}; to change parameters of a robot write Params.preset(\"paper\").replace(...)"
                ))),
                found => found.map(Self).map_err(to_python),
            };
        }
        if robot.extract::<PathBuf>().is_ok_and(|path| path.extension().is_some_and(|suffix| suffix == "urdf")) {
            return Err(InvalidInputError::new_err(format!("robot = {}: {TWO_URDFS}", robot.repr()?)));
        }
        if let Some(path) = toml_path(&robot) {
            return call(|| Params::from_toml_file(&path)).map(Self);
        }
        match robot.extract::<String>() {
            Ok(preset) => Params::preset(&preset).map(Self).map_err(to_python),
            Err(_) => Err(PyTypeError::new_err(format!(
                "robot must be Params, the name of a preset, the path of a TOML file or a dict of parameters, not {}; \
                 {TWO_URDFS}",
                robot.get_type().name()?
            ))),
        }
    }
}

/// What the argument `robot` takes as parameters, for Python.
#[pyfunction]
pub(crate) fn _params_of(robot: &Bound<'_, PyAny>) -> PyResult<PyParams> {
    robot.extract::<Robot>().map(|robot| PyParams(robot.0))
}

/// A list of robots.
pub(crate) fn several(robots: &Bound<'_, PyList>) -> PyResult<Vec<Params>> {
    if robots.is_empty() {
        return Err(InvalidInputError::new_err("robot = []: there is none, expected at least one"));
    }
    robots.iter().map(|robot| Ok(robot.extract::<Robot>()?.0)).collect()
}

/// Moments of inertia of a rigid body, kg·m², from one number for all or three.
fn moments_of(inertia: &Bound<'_, PyAny>) -> PyResult<[f64; 3]> {
    let [x, y, z] = match one_or_more("inertia", inertia)?[..] {
        [one] => [one; 3],
        [x, y, z] => [x, y, z],
        ref found => {
            let (name, found) = ("inertia".to_owned(), found.len());
            return Err(to_python(Error::Length { name, found, expected: 3 }));
        }
    };
    for (i, (value, others)) in [(x, y + z), (y, z + x), (z, x + y)].into_iter().enumerate() {
        if !(value >= 0.0 && value <= others) {
            let limit = format!("from 0 to the sum of the others, {others} kg·m²");
            return Err(to_python(Error::OutOfRange { name: format!("inertia[{i}]"), value, limit }));
        }
    }
    Ok([x, y, z])
}
