//! `Jacobian` and `Jacobians`.

use crate::errors::{not_pickled, to_python};
use crate::robot::state::{PyContacts, PyState};
use crate::values::convert::{ANY_COUNT, dimensions, elements, finite_elements, matrix, names};
use ballbot_core::fields::Fields;
use ballbot_core::gradients::{Coordinates, FORCES, Jacobian, Parameter, ROLLING, RollingJacobian, force_names};
use ballbot_core::{Params, WHEELS, Wheels, try_zeros};
use nalgebra::{DMatrix, DVector};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

type Matrix<'py> = Bound<'py, PyArray2<f64>>;

/// Margin below which a state is on a kink of the motion, up to rounding.
const ON_A_KINK: f64 = 1e-9;

/// Derivatives of a motion under constant motor torques: `Ballbot.jacobian`; attributes are fresh float64 arrays.
///
/// ```python
/// jacobian = bb.Ballbot().jacobian([0.0, 0.0, 0.0], steps=10, parameters=["body_mass"])
/// print(jacobian.A.shape, jacobian.B.shape, jacobian.P.shape)
/// ```
///
/// With the state x, the torques u (N·m), the parameters p, and the contact forces y (N) of the last step:
/// dx' = A dx + B du + P dp and dy = C dx + D du + Q dp, in SI units. `states`, `parameters` and `forces` name the rows and
/// columns. A change of an attitude is a rotation vector, rad: of the ball in the inertial frame, of the body in the body
/// frame, as their angular velocities; the other coordinates are the numbers of `State`.
#[pyclass(name = "Jacobian", module = "ballbot_rs", frozen)]
pub(crate) struct PyJacobian {
    pub(crate) jacobian: Jacobian,
    pub(crate) parameters: Vec<Parameter>,
    pub(crate) params: Params,
}

/// Largest number of motions whose derivatives are computed at once: 10 GB.
const MOST_MOTIONS: usize = 1 << 20;

/// Torques of motions, shape (T, 3).
pub(crate) fn torques(value: &Bound<'_, PyAny>) -> PyResult<Vec<Wheels<f64>>> {
    torques_of_shape(value, &[None, Some(WHEELS)])
}

/// Torques of `n` robots, shape (n, 3), or (n, k, 3).
pub(crate) fn torques_of_robots(value: &Bound<'_, PyAny>, n: usize) -> PyResult<Vec<Wheels<f64>>> {
    match dimensions::<f64>("wheel_torques", value, WHEELS * MOST_MOTIONS)? {
        3 => torques_of_shape(value, &[Some(n), None, Some(WHEELS)]),
        _ => torques_of_shape(value, &[Some(n), Some(WHEELS)]),
    }
}

/// Torques of an array of a shape that ends with 3.
pub(crate) fn torques_of_shape(value: &Bound<'_, PyAny>, shape: &[Option<usize>]) -> PyResult<Vec<Wheels<f64>>> {
    let numbers: Vec<f64> = elements("wheel_torques", value, shape, WHEELS * MOST_MOTIONS)?;
    Ok(numbers.chunks_exact(WHEELS).map(|torques| Wheels([torques[0], torques[1], torques[2]])).collect())
}

/// The parameters of names.
pub(crate) fn parameters(value: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<Parameter>> {
    let mut found = Vec::new();
    let most = Params::FIELDS.iter().map(|field| field.len).sum();
    for name in value.map_or(Ok(Vec::new()), |value| names("parameters", value, most))? {
        found.extend(Parameter::named(&name).map_err(to_python)?);
    }
    Ok(found)
}

#[pymethods]
impl PyJacobian {
    /// Derivatives of the state after the motion with respect to the state before, shape (n, n).
    #[getter(A)]
    fn a<'py>(&self, py: Python<'py>) -> Matrix<'py> {
        matrix(py, &self.jacobian.a)
    }

    /// Derivatives of the state with respect to the torques, shape (n, 3).
    #[getter(B)]
    fn b<'py>(&self, py: Python<'py>) -> Matrix<'py> {
        matrix(py, &self.jacobian.b)
    }

    /// Derivatives of the state with respect to the parameters, shape (n, k).
    #[getter(P)]
    fn p<'py>(&self, py: Python<'py>) -> Matrix<'py> {
        matrix(py, &self.jacobian.p)
    }

    /// Derivatives of the contact forces with respect to the state before, shape (9, n).
    #[getter(C)]
    fn c<'py>(&self, py: Python<'py>) -> Matrix<'py> {
        matrix(py, &self.jacobian.c)
    }

    /// Derivatives of the contact forces with respect to the torques, shape (9, 3).
    #[getter(D)]
    fn d<'py>(&self, py: Python<'py>) -> Matrix<'py> {
        matrix(py, &self.jacobian.d)
    }

    /// Derivatives of the contact forces with respect to the parameters, shape (9, k).
    #[getter(Q)]
    fn q<'py>(&self, py: Python<'py>) -> Matrix<'py> {
        matrix(py, &self.jacobian.q)
    }

    /// Names of the n states: 30, and for robots with rolling, spinning or roller friction 6 contact forces of the last
    /// step, on which these losses depend; in the models without slip the 17 that are independent.
    #[getter]
    fn states<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.jacobian.coordinates.names())
    }

    /// Names of the k parameters; an element of an array as `body_com_offset[0]`.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.parameters.iter().map(ToString::to_string))
    }

    /// Names of the nine contact forces: `Contacts.wheel_normal_forces`, `wheel_tractions` and `floor_force`.
    #[getter]
    fn forces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, force_names())
    }

    /// The state after the motion.
    #[getter]
    fn state(&self) -> PyState {
        PyState(self.jacobian.next.clone())
    }

    /// The contacts of the last step.
    #[getter]
    fn contacts(&self) -> PyContacts {
        PyContacts { contacts: self.jacobian.contacts, params: self.params.clone() }
    }

    /// Whether a contact changed its mode during the motion: opened, closed, gripped or slipped. The derivatives are of the
    /// modes taken.
    #[getter]
    fn modes_changed(&self) -> bool {
        self.jacobian.modes_changed
    }

    /// Distance of the nearest step from other modes: the smallest change of an impulse, as a fraction of the impulse of a
    /// wheel's static load, of a gap, as a fraction of g dt², or of a joint's impulse, as a fraction of its dry friction, with
    /// which a contact changes its mode. Infinite in the models without slip, which have no modes.
    #[getter]
    fn margin(&self) -> f64 {
        self.jacobian.margin
    }

    /// Whether a step is on a kink of the motion, with a `margin` below 1e-9, so that the derivatives are one-sided.
    #[getter]
    fn one_sided(&self) -> bool {
        self.jacobian.margin < ON_A_KINK
    }

    /// Names of the coordinates of `rolling`: of `states` without the attitude of the ball and the wheel angles, on which
    /// nothing depends, and without what follows from rolling.
    #[classattr]
    const ROLLING: [&'static str; 11] = ROLLING;

    /// A (11, 11) and B (11, 3) for changes of the state with which the ball still rolls on a plane floor, and the
    /// wheels on the ball; in the coordinates `ROLLING`, for the design of controllers. Such changes open and close no gap,
    /// so the derivatives hold for a robot in balance on both sides.
    ///
    /// Raises:
    ///     ValueError: a robot on a terrain.
    fn rolling<'py>(&self, py: Python<'py>) -> PyResult<(Matrix<'py>, Matrix<'py>)> {
        let RollingJacobian { a, b, .. } = self.jacobian.rolling(&self.params).map_err(to_python)?;
        Ok((matrix(py, &a), matrix(py, &b)))
    }

    fn __reduce__(&self) -> PyResult<()> {
        not_pickled("Jacobian", "pickle its arrays")
    }

    fn __repr__(&self) -> String {
        let Jacobian { a, p, modes_changed, margin, .. } = &self.jacobian;
        format!(
            "<Jacobian: {} states, 3 torques, {} parameters, margin {margin:.2e}{}>",
            a.ncols(),
            p.ncols(),
            if *modes_changed { ", modes change" } else { "" }
        )
    }
}

/// Derivatives of several motions, as `Jacobian` with one more axis in front; attributes are fresh arrays.
///
/// ```python
/// batch = bb.Batch(8, model="contact")
/// batch.reset()
/// print(batch.jacobians(np.zeros((8, 3)), steps=10).A.shape)
/// ```
///
/// Of the robots of a batch, `Batch.jacobians`, or along the motion of one robot, `Ballbot.jacobians`, as
/// `MotionJacobians`.
#[pyclass(name = "Jacobians", module = "ballbot_rs", frozen, subclass)]
pub(crate) struct PyJacobians {
    jacobians: Vec<Option<Jacobian>>,
    /// Numbers of the torques of a motion.
    torques: usize,
    parameters: Vec<Parameter>,
    states: Vec<String>,
}

impl PyJacobians {
    pub(crate) fn new(
        jacobians: Vec<Option<Jacobian>>,
        torques: usize,
        parameters: Vec<Parameter>,
        coordinates: Coordinates,
    ) -> Self {
        Self { jacobians, torques, parameters, states: coordinates.names() }
    }

    fn stacked<'py>(
        &self,
        py: Python<'py>,
        [rows, columns]: [usize; 2],
        of: impl Fn(&Jacobian) -> &DMatrix<f64>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let shape = [self.jacobians.len(), rows, columns];
        let mut numbers = try_zeros("the derivatives", &shape).map_err(to_python)?;
        for (part, jacobian) in numbers.chunks_exact_mut((rows * columns).max(1)).zip(&self.jacobians) {
            if let Some(jacobian) = jacobian {
                // By columns in memory, by rows in the array.
                let matrix = of(jacobian);
                for (i, row) in part.chunks_exact_mut(columns).enumerate() {
                    row.iter_mut().enumerate().for_each(|(j, number)| *number = matrix[(i, j)]);
                }
            }
        }
        PyArray1::from_vec(py, numbers).reshape(shape)
    }

    fn one_each<'py, T: numpy::Element + Copy>(
        &self,
        py: Python<'py>,
        without: T,
        of: impl Fn(&Jacobian) -> T,
    ) -> Bound<'py, PyArray1<T>> {
        PyArray1::from_iter(py, self.jacobians.iter().map(|jacobian| jacobian.as_ref().map_or(without, &of)))
    }
}

type Stack<'py> = PyResult<Bound<'py, PyArray3<f64>>>;

#[pymethods]
impl PyJacobians {
    /// Derivatives of the states after each motion with respect to the states before, shape (N, n, n).
    #[getter(A)]
    fn a<'py>(&self, py: Python<'py>) -> Stack<'py> {
        let n = self.states.len();
        self.stacked(py, [n, n], |jacobian| &jacobian.a)
    }

    /// Derivatives of the states with respect to the torques, shape (N, n, 3); or to k torques of each robot, (N, n, 3 k).
    #[getter(B)]
    fn b<'py>(&self, py: Python<'py>) -> Stack<'py> {
        self.stacked(py, [self.states.len(), self.torques], |jacobian| &jacobian.b)
    }

    /// Derivatives of the states with respect to the parameters, shape (N, n, k).
    #[getter(P)]
    fn p<'py>(&self, py: Python<'py>) -> Stack<'py> {
        self.stacked(py, [self.states.len(), self.parameters.len()], |jacobian| &jacobian.p)
    }

    /// Derivatives of the contact forces with respect to the states before, shape (N, 9, n).
    #[getter(C)]
    fn c<'py>(&self, py: Python<'py>) -> Stack<'py> {
        self.stacked(py, [FORCES, self.states.len()], |jacobian| &jacobian.c)
    }

    /// Derivatives of the contact forces with respect to the torques, shape (N, 9, 3) or (N, 9, 3 k).
    #[getter(D)]
    fn d<'py>(&self, py: Python<'py>) -> Stack<'py> {
        self.stacked(py, [FORCES, self.torques], |jacobian| &jacobian.d)
    }

    /// Derivatives of the contact forces with respect to the parameters, shape (N, 9, k).
    #[getter(Q)]
    fn q<'py>(&self, py: Python<'py>) -> Stack<'py> {
        self.stacked(py, [FORCES, self.parameters.len()], |jacobian| &jacobian.q)
    }

    /// Names of the n states, as `Jacobian.states`.
    #[getter]
    fn states<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, &self.states)
    }

    /// Names of the k parameters.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.parameters.iter().map(ToString::to_string))
    }

    /// Names of the nine contact forces.
    #[getter]
    fn forces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, force_names())
    }

    /// Motions with derivatives, shape (N,). The others, of robots whose bot touches the floor, that diverge, or whose
    /// derivatives are not finite, have zeros.
    #[getter]
    fn valid<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        self.one_each(py, false, |_| true)
    }

    /// As `Jacobian.modes_changed`, shape (N,).
    #[getter]
    fn modes_changed<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        self.one_each(py, false, |jacobian| jacobian.modes_changed)
    }

    /// As `Jacobian.margin`, shape (N,); 0 without derivatives.
    #[getter]
    fn margin<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.one_each(py, 0.0, |jacobian| jacobian.margin)
    }

    /// As `Jacobian.one_sided`, shape (N,); True without derivatives.
    #[getter]
    fn one_sided<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        self.one_each(py, true, |jacobian| jacobian.margin < ON_A_KINK)
    }

    fn __len__(&self) -> usize {
        self.jacobians.len()
    }

    fn __reduce__(&self) -> PyResult<()> {
        not_pickled("Jacobians", "pickle the arrays")
    }

    fn __repr__(&self) -> String {
        let (n, m, k) = (self.states.len(), self.torques, self.parameters.len());
        format!("<Jacobians: {} motions, {n} states, {m} torques, {k} parameters>", self.jacobians.len())
    }
}

/// Derivatives along the motion of one robot, `Ballbot.jacobians`: motion t begins where motion t - 1 has ended.
///
/// ```python
/// motion = bb.Ballbot().jacobians(np.zeros((20, 3)), steps=10)
/// forward = motion.jvp(torques=np.ones((20, 3)))
/// ```
///
/// `jvp` (forward mode) and `vjp` (reverse mode) differentiate the whole motion.
#[pyclass(name = "MotionJacobians", module = "ballbot_rs", frozen, extends = PyJacobians)]
pub(crate) struct PyMotionJacobians;

impl PyMotionJacobians {
    pub(crate) fn new(
        py: Python<'_>,
        jacobians: Vec<Jacobian>,
        parameters: Vec<Parameter>,
        coordinates: Coordinates,
    ) -> PyResult<Py<Self>> {
        let all = PyJacobians::new(jacobians.into_iter().map(Some).collect(), WHEELS, parameters, coordinates);
        Py::new(py, PyClassInitializer::from(all).add_subclass(Self))
    }
}

/// An optional vector or matrix of numbers; zeros for `None`.
fn optional(name: &str, value: Option<&Bound<'_, PyAny>>, shape: &[usize]) -> PyResult<Vec<f64>> {
    let expected: Vec<_> = shape.iter().copied().map(Some).collect();
    match value {
        Some(value) => finite_elements(name, value, &expected, ANY_COUNT),
        None => try_zeros(name, shape).map_err(to_python),
    }
}

#[pymethods]
impl PyMotionJacobians {
    /// Change of the state after each motion, shape (T, n), from a change of the first state (n,), of the torques (T, 3) and
    /// of the parameters (k,); None leaves them unchanged.
    ///
    /// Raises:
    ///     ValueError: a wrong shape, or a number that is not finite.
    #[pyo3(signature = (state=None, torques=None, parameters=None))]
    fn jvp<'py>(
        slf: &Bound<'py, Self>,
        state: Option<&Bound<'py, PyAny>>,
        torques: Option<&Bound<'py, PyAny>>,
        parameters: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (py, all) = (slf.py(), slf.as_super().borrow());
        let (n, k) = (all.states.len(), all.parameters.len());
        let mut state = DVector::from(optional("state", state, &[n])?);
        let motions = all.jacobians.len();
        let torques = optional("torques", torques, &[motions, WHEELS])?;
        let parameters = DVector::from(optional("parameters", parameters, &[k])?);
        let mut out = DMatrix::zeros(motions, n);
        for (t, jacobian) in all.jacobians.iter().flatten().enumerate() {
            let torque = DVector::from_column_slice(&torques[t * WHEELS..][..WHEELS]);
            state = &jacobian.a * state + &jacobian.b * torque + &jacobian.p * &parameters;
            out.row_mut(t).tr_copy_from(&state);
        }
        Ok(matrix(py, &out))
    }

    /// Derivatives of a number with respect to the first state (n,), the torques (T, 3) and the parameters (k,), from its
    /// derivatives with respect to the state after each motion, shape (T, n). Attitudes are rotation vectors, as in
    /// `states`.
    ///
    /// Raises:
    ///     ValueError: a wrong shape, or a number that is not finite.
    fn vjp<'py>(slf: &Bound<'py, Self>, states: &Bound<'py, PyAny>) -> PyResult<Products<'py>> {
        let (py, all) = (slf.py(), slf.as_super().borrow());
        let (n, k) = (all.states.len(), all.parameters.len());
        let motions = all.jacobians.len();
        let by_states = finite_elements("states", states, &[Some(motions), Some(n)], ANY_COUNT)?;
        let (mut state, mut parameters) = (DVector::zeros(n), DVector::zeros(k));
        let mut torques = DMatrix::zeros(motions, WHEELS);
        for (t, jacobian) in all.jacobians.iter().enumerate().rev() {
            let Some(jacobian) = jacobian else { continue };
            state += DVector::from_column_slice(&by_states[t * n..][..n]);
            torques.row_mut(t).tr_copy_from(&jacobian.b.tr_mul(&state));
            parameters += jacobian.p.tr_mul(&state);
            state = jacobian.a.tr_mul(&state);
        }
        let vector = |vector: DVector<f64>| PyArray1::from_slice(py, vector.as_slice());
        Ok((vector(state), matrix(py, &torques), vector(parameters)))
    }
}

/// Derivatives with respect to state, torques and parameters.
type Products<'py> = (Bound<'py, PyArray1<f64>>, Matrix<'py>, Bound<'py, PyArray1<f64>>);
