//! The closed-form models and the torque maps.

use crate::errors::{InvalidInputError, not_pickled, to_python};
use crate::robot::params::Robot;
use crate::robot::state::PyContacts;
use crate::values::convert::{array, matrix, numbers, shaped, vector};
use crate::values::keywords::no_others;
use crate::values::numbers::real;
use ballbot_core::kinematics::{Omniwheels, TorqueMap};
use ballbot_core::models::{LinearModel, PlanarModel, SpatialModel};
use ballbot_core::{Wheels, check_bounded, unit_quaternion};
use nalgebra::{DMatrix, SMatrix, UnitQuaternion, Vector2, Vector3, Vector6};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

type Array<'py> = Bound<'py, PyArray1<f64>>;
type Matrix<'py> = Bound<'py, PyArray2<f64>>;

/// Equations of motion of the coupled 3D robot without slip (Kane's method).
///
/// ```python
/// model = bb.SpatialModel("kugle")
/// print(model.accelerations([1.0, 0.0, 0.0, 0.0], np.zeros(6), [0.1, 0.0, 0.0]))
/// ```
///
/// The defaults are the equations that `Ballbot(model="spatial")` integrates. Generalized velocity: ball velocity x, y
/// (inertial frame, m/s), body angular velocity (body frame, rad/s) and spin of the ball about the vertical (rad/s),
/// shape (6,); shape (5,) without the spin for `ball_spins_about_vertical=False`, which constrains it to zero.
/// `absolute_wheel_spin=False` is the paper's wheel energy, which uses the spin of a wheel relative to the body.
#[pyclass(name = "SpatialModel", module = "ballbot_rs", frozen)]
pub(crate) struct PySpatialModel(SpatialModel);

impl PySpatialModel {
    fn motion(
        &self,
        body_quaternion: &Bound<'_, PyAny>,
        generalized_velocity: &Bound<'_, PyAny>,
    ) -> PyResult<(UnitQuaternion<f64>, Vector6<f64>)> {
        let quaternion = numbers::<4>("body_quaternion", body_quaternion)?;
        let quaternion = unit_quaternion("body_quaternion", quaternion).map_err(to_python)?;
        let dof = self.0.degrees_of_freedom();
        let velocity: Vec<f64> = shaped("generalized_velocity", generalized_velocity, [dof])?;
        check_bounded("generalized_velocity", &velocity).map_err(to_python)?;
        let velocity = self.0.generalized_velocity(&velocity).map_err(to_python)?;
        Ok((quaternion, velocity))
    }
}

#[pymethods]
impl PySpatialModel {
    #[new]
    #[pyo3(
        signature = (robot=None, absolute_wheel_spin=true, ball_spins_about_vertical=true, **others),
        text_signature = "(robot=None, absolute_wheel_spin=True, ball_spins_about_vertical=True)"
    )]
    fn new(
        robot: Option<Robot>,
        absolute_wheel_spin: bool,
        ball_spins_about_vertical: bool,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        no_others("SpatialModel", others)?;
        Ok(Self(SpatialModel::new(&Robot::or_paper(robot), absolute_wheel_spin, ball_spins_about_vertical)))
    }

    /// Derivative of the generalized velocity under motor torques (N·m, shape (3,)); shape of the generalized velocity.
    fn accelerations<'py>(
        &self,
        py: Python<'py>,
        body_quaternion: &Bound<'py, PyAny>,
        generalized_velocity: &Bound<'py, PyAny>,
        wheel_torques: &Bound<'py, PyAny>,
    ) -> PyResult<Array<'py>> {
        let (quaternion, velocity) = self.motion(body_quaternion, generalized_velocity)?;
        let torques = finite_vector("wheel_torques", wheel_torques)?;
        let accelerations = self.0.accelerations(&quaternion, &velocity, Wheels::of_column(torques));
        Ok(array(py, &accelerations.as_slice()[..self.0.degrees_of_freedom()]))
    }

    /// Encoder rates of the three wheels, rad/s, shape (3,).
    fn wheel_speeds<'py>(
        &self,
        py: Python<'py>,
        body_quaternion: &Bound<'py, PyAny>,
        generalized_velocity: &Bound<'py, PyAny>,
    ) -> PyResult<Array<'py>> {
        let (quaternion, velocity) = self.motion(body_quaternion, generalized_velocity)?;
        Ok(array(py, self.0.wheel_speeds(&quaternion, &velocity).as_slice()))
    }

    /// Kinetic plus potential energy, J.
    fn energy(&self, body_quaternion: &Bound<'_, PyAny>, generalized_velocity: &Bound<'_, PyAny>) -> PyResult<f64> {
        let (quaternion, velocity) = self.motion(body_quaternion, generalized_velocity)?;
        Ok(self.0.energy(&quaternion, &velocity))
    }

    /// Contact forces of the motion without slip, under motor torques (N·m, shape (3,)).
    fn contacts(
        &self,
        body_quaternion: &Bound<'_, PyAny>,
        generalized_velocity: &Bound<'_, PyAny>,
        wheel_torques: &Bound<'_, PyAny>,
    ) -> PyResult<PyContacts> {
        let (quaternion, velocity) = self.motion(body_quaternion, generalized_velocity)?;
        let torques = finite_vector("wheel_torques", wheel_torques)?;
        let contacts = self.0.contacts(&quaternion, &velocity, Wheels::of_column(torques));
        Ok(PyContacts { contacts, params: self.0.params().clone() })
    }

    fn __reduce__(&self) -> PyResult<()> {
        not_pickled("SpatialModel", "make another with the same arguments")
    }

    fn __repr__(&self) -> String {
        format!("<SpatialModel: {} degrees of freedom>", self.0.degrees_of_freedom())
    }
}

/// The planar model of the paper, equations (1)-(7): q = (position, tilt towards positive position) in m and rad.
///
/// ```python
/// model = bb.PlanarModel(plane="yz")
/// print(model.accelerations(q=[0.0, 0.05], q_dot=[0.0, 0.0], virtual_torque=0.1))
/// ```
///
/// Args:
///     robot: the robot; None is the paper's.
///     wheel_inertia: "as_printed" (J_w of one wheel) or "three_wheels" ((3/2) cos² α J_w, equivalent to three wheels).
///     plane: "yz" or "xz".
///
/// Raises:
///     ValueError: an unknown name, or a robot that is not symmetric about its mast.
#[pyclass(name = "PlanarModel", module = "ballbot_rs", frozen)]
pub(crate) struct PyPlanarModel(PlanarModel);

#[pymethods]
impl PyPlanarModel {
    #[new]
    #[pyo3(
        signature = (robot=None, wheel_inertia="as_printed", plane="yz", **others),
        text_signature = "(robot=None, wheel_inertia='as_printed', plane='yz')"
    )]
    fn new(
        robot: Option<Robot>,
        wheel_inertia: &str,
        plane: &str,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        no_others("PlanarModel", others)?;
        let wheel_inertia = wheel_inertia.parse().map_err(to_python)?;
        let plane = plane.parse().map_err(to_python)?;
        PlanarModel::in_plane(&Robot::or_paper(robot), wheel_inertia, plane).map(Self).map_err(to_python)
    }

    /// Accelerations q̈ under a virtual torque (N·m), eq. (1), shape (2,).
    fn accelerations<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        q_dot: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = real)] virtual_torque: f64,
    ) -> PyResult<Array<'py>> {
        let (q, q_dot) = planar_motion(q, q_dot)?;
        check_bounded("virtual_torque", &[virtual_torque]).map_err(to_python)?;
        Ok(array(py, self.0.accelerations(&q, &q_dot, virtual_torque).as_slice()))
    }

    /// Kinetic plus potential energy, J.
    fn energy(&self, q: &Bound<'_, PyAny>, q_dot: &Bound<'_, PyAny>) -> PyResult<f64> {
        let (q, q_dot) = planar_motion(q, q_dot)?;
        Ok(self.0.energy(&q, &q_dot))
    }

    /// Yaw acceleration θ̈_z under a virtual torque (N·m), eq. (7), rad/s².
    fn yaw_acceleration(&self, #[pyo3(from_py_with = real)] virtual_torque: f64) -> PyResult<f64> {
        check_bounded("virtual_torque", &[virtual_torque]).map_err(to_python)?;
        Ok(self.0.yaw_acceleration(virtual_torque))
    }

    /// Matrices A (4×4) and B (4×1) of ẋ = A x + B u about rest upright; `STATES` and `INPUTS` name x and u.
    fn linearize<'py>(&self, py: Python<'py>) -> (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>) {
        let (a, b) = self.0.linearize();
        (dynamic(py, &a), dynamic(py, &b))
    }

    /// Names of the states x of `linearize`, with units.
    #[classattr]
    const STATES: [&'static str; 4] = ["position (m)", "tilt (rad)", "velocity (m/s)", "tilt rate (rad/s)"];

    /// Name of the input u of `linearize`, with its unit.
    #[classattr]
    const INPUTS: [&'static str; 1] = ["virtual torque (N·m)"];

    fn __reduce__(&self) -> PyResult<()> {
        not_pickled("PlanarModel", "make another with the same arguments")
    }

    fn __repr__(&self) -> String {
        format!("<PlanarModel: {} states, {} input>", Self::STATES.len(), Self::INPUTS.len())
    }
}

/// A matrix of any size as an array.
fn dynamic<'py, const M: usize, const N: usize>(
    py: Python<'py>,
    values: &SMatrix<f64, M, N>,
) -> Bound<'py, PyArray2<f64>> {
    matrix(py, &DMatrix::from_column_slice(M, N, values.as_slice()))
}

/// The spatial model linearized about rest upright: ẋ = A x + B u, in the heading frame.
///
/// ```python
/// model = bb.LinearModel("kugle")
/// a, b = model.discretize(0.01)
/// print(np.linalg.eigvals(model.A).real.max())
/// ```
///
/// The ball is free to spin about the vertical; its spin follows from motion from rest under motor torques.
#[pyclass(name = "LinearModel", module = "ballbot_rs", frozen)]
pub(crate) struct PyLinearModel(LinearModel);

#[pymethods]
impl PyLinearModel {
    #[new]
    #[pyo3(signature = (robot=None, **others), text_signature = "(robot=None)")]
    fn new(robot: Option<Robot>, others: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        no_others("LinearModel", others)?;
        Ok(Self(LinearModel::new(&Robot::or_paper(robot))))
    }

    /// State matrix A (10×10).
    #[getter(A)]
    fn a<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        dynamic(py, &self.0.a)
    }

    /// Input matrix B (10×3).
    #[getter(B)]
    fn b<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        dynamic(py, &self.0.b)
    }

    /// λ², the square of the rate at which the robot topples, 1/s².
    #[getter]
    fn toppling_squared(&self) -> f64 {
        self.0.toppling_squared()
    }

    /// Acceleration of the ball towards x per small lean that the wheels hold, m/(s²·rad).
    #[getter]
    fn acceleration_per_lean(&self) -> f64 {
        self.0.acceleration_per_lean()
    }

    /// Torques of the wheels that turn the body by 1 rad/s² about x, y and z of the heading frame, N·m, shape (3, 3): one
    /// row per wheel.
    #[getter]
    fn turning_torques<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        dynamic(py, &self.0.turning_torques())
    }

    /// Matrices A (10×10) and B (10×3) of x⁺ = A x + B u for inputs held over `dt` seconds; exact.
    fn discretize<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = real)] dt: f64,
    ) -> PyResult<(Matrix<'py>, Matrix<'py>)> {
        check_bounded("dt", &[dt]).map_err(to_python)?;
        let (a, b) = self.0.discretize(dt);
        if !a.iter().chain(&b).all(|value| value.is_finite()) {
            return Err(InvalidInputError::new_err(format!("dt = {dt} s is too long: the state overflows")));
        }
        Ok((dynamic(py, &a), dynamic(py, &b)))
    }

    /// Names of the states x, with units.
    #[classattr]
    const STATES: [&'static str; 10] = [
        "x (m)",
        "y (m)",
        "tilt x (rad)",
        "tilt y (rad)",
        "yaw (rad)",
        "velocity x (m/s)",
        "velocity y (m/s)",
        "body rate x (rad/s)",
        "body rate y (rad/s)",
        "body rate z (rad/s)",
    ];

    /// Names of the inputs u, with units.
    #[classattr]
    const INPUTS: [&'static str; 3] = ["torque 0 (N·m)", "torque 1 (N·m)", "torque 2 (N·m)"];

    fn __reduce__(&self) -> PyResult<()> {
        not_pickled("LinearModel", "make another with the same arguments")
    }

    fn __repr__(&self) -> String {
        format!("<LinearModel: {} states, {} inputs>", Self::STATES.len(), Self::INPUTS.len())
    }
}

fn planar_motion(q: &Bound<'_, PyAny>, q_dot: &Bound<'_, PyAny>) -> PyResult<(Vector2<f64>, Vector2<f64>)> {
    let (q, q_dot) = (numbers::<2>("q", q)?, numbers::<2>("q_dot", q_dot)?);
    check_bounded("q", &q).map_err(to_python)?;
    check_bounded("q_dot", &q_dot).map_err(to_python)?;
    Ok((q.into(), q_dot.into()))
}

fn finite_vector(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vector3<f64>> {
    let v = vector(name, value)?;
    check_bounded(name, v.as_slice()).map_err(to_python)?;
    Ok(v)
}

/// Wheel torques (N·m) of virtual torques (τ_x, τ_y, τ_z) in the body frame, with the sign of the paper's equation (8).
///
/// ```python
/// print(bb.virtual_to_wheel_torques("kugle", [0.1, 0.0, 0.0]))
/// ```
///
/// `mapping` "consistent" conserves power; "as_printed" is eq. (8), whose tilt and yaw torques are too large; it is a
/// ValueError for wheels without a common zenith and 120 deg spacing, and for inclined rollers.
#[pyfunction]
#[pyo3(
    signature = (robot, virtual_torques, mapping="consistent", **others),
    text_signature = "(robot, virtual_torques, mapping='consistent')"
)]
pub(crate) fn virtual_to_wheel_torques<'py>(
    py: Python<'py>,
    robot: Robot,
    virtual_torques: &Bound<'py, PyAny>,
    mapping: &str,
    others: Option<&Bound<'_, PyDict>>,
) -> PyResult<Array<'py>> {
    no_others("virtual_to_wheel_torques", others)?;
    let map: TorqueMap = mapping.parse().map_err(to_python)?;
    map.require(&robot.0).map_err(to_python)?;
    let torques = finite_vector("virtual_torques", virtual_torques)?;
    Ok(array(py, Omniwheels::new(&robot.0).wheel_torques(&torques, map).as_slice()))
}

/// Virtual torques (τ_x, τ_y, τ_z) of wheel torques, N·m, shape (3,): the inverse of the consistent map.
///
/// ```python
/// print(bb.wheel_to_virtual_torques("kugle", [0.1, 0.0, 0.0]))
/// ```
#[pyfunction]
#[pyo3(signature = (robot, wheel_torques, **others), text_signature = "(robot, wheel_torques)")]
pub(crate) fn wheel_to_virtual_torques<'py>(
    py: Python<'py>,
    robot: Robot,
    wheel_torques: &Bound<'py, PyAny>,
    others: Option<&Bound<'_, PyDict>>,
) -> PyResult<Array<'py>> {
    no_others("wheel_to_virtual_torques", others)?;
    let torques = finite_vector("wheel_torques", wheel_torques)?;
    Ok(array(py, Omniwheels::new(&robot.0).virtual_torques(Wheels::of_column(torques)).as_slice()))
}
