//! `Jacobian`.

use crate::convert::matrix;
use crate::errors::{not_pickled, to_python};
use crate::state::{PyContacts, PyState};
use ballbot_core::Params;
use ballbot_core::gradients::{Jacobian, Parameter, force_names};
use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

type Matrix<'py> = Bound<'py, PyArray2<f64>>;

/// Margin below which a state is on a kink of the motion, up to rounding.
const ON_A_KINK: f64 = 1e-9;

/// Derivatives of a motion under constant motor torques: `Ballbot.jacobian`. Attributes are fresh float64 arrays.
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

/// The parameters of names.
pub(crate) fn parameters(names: &[String]) -> PyResult<Vec<Parameter>> {
    let mut found = Vec::new();
    for name in names {
        found.extend(Parameter::named(name).map_err(to_python)?);
    }
    Ok(found)
}

#[pymethods]
impl PyJacobian {
    /// The state after the motion by the state before, shape (n, n).
    #[getter(A)]
    fn a<'py>(&self, py: Python<'py>) -> Matrix<'py> {
        matrix(py, &self.jacobian.a)
    }

    /// The state by the torques, shape (n, 3).
    #[getter(B)]
    fn b<'py>(&self, py: Python<'py>) -> Matrix<'py> {
        matrix(py, &self.jacobian.b)
    }

    /// The state by the parameters, shape (n, k).
    #[getter(P)]
    fn p<'py>(&self, py: Python<'py>) -> Matrix<'py> {
        matrix(py, &self.jacobian.p)
    }

    /// The contact forces by the state before, shape (9, n).
    #[getter(C)]
    fn c<'py>(&self, py: Python<'py>) -> Matrix<'py> {
        matrix(py, &self.jacobian.c)
    }

    /// The contact forces by the torques, shape (9, 3).
    #[getter(D)]
    fn d<'py>(&self, py: Python<'py>) -> Matrix<'py> {
        matrix(py, &self.jacobian.d)
    }

    /// The contact forces by the parameters, shape (9, k).
    #[getter(Q)]
    fn q<'py>(&self, py: Python<'py>) -> Matrix<'py> {
        matrix(py, &self.jacobian.q)
    }

    /// Names of the n states: 30, and for robots with rolling, spinning or roller friction 6 contact forces of the last
    /// step, on which these losses depend.
    #[getter]
    fn states<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.jacobian.state_names())
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
        PyContacts { contacts: self.jacobian.contacts.clone(), params: self.params.clone() }
    }

    /// Whether a contact changed its mode during the motion: opened, closed, gripped or slipped. The derivatives are of the
    /// modes taken.
    #[getter]
    fn modes_changed(&self) -> bool {
        self.jacobian.modes_changed
    }

    /// Distance of the nearest step from other modes: the smallest change of an impulse, as a fraction of the impulse of a
    /// wheel's static load, or of a gap, as a fraction of g dt², with which a contact changes its mode.
    #[getter]
    fn margin(&self) -> f64 {
        self.jacobian.margin
    }

    /// Whether a step is on a kink of the motion, with a `margin` below 1e-9, so that the derivatives hold on one side.
    #[getter]
    fn one_sided(&self) -> bool {
        self.jacobian.margin < ON_A_KINK
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
