//! `Params`.

use crate::convert::elements;
use crate::errors::{call, to_python};
use ballbot_core::{Params, urdf};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::path::PathBuf;

/// Physical parameters of a ballbot.
#[pyclass(name = "Params", module = "ballbot_rs", frozen, eq)]
#[derive(Clone, PartialEq)]
pub(crate) struct PyParams(pub Params);

/// Keyword arguments as named slices of numbers.
fn fields(kwargs: Option<&Bound<'_, PyDict>>) -> PyResult<Vec<(String, Vec<f64>)>> {
    let mut fields = Vec::new();
    for (name, value) in kwargs.into_iter().flatten() {
        let name: String = name.extract()?;
        let values = match value.extract::<f64>() {
            Ok(number) => vec![number],
            Err(_) => elements(&name, &value, &[None])?,
        };
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

    #[staticmethod]
    fn paper() -> Self {
        Self(Params::paper())
    }

    #[staticmethod]
    fn preset(name: &str) -> PyResult<Self> {
        Params::preset(name).map(Self).map_err(to_python)
    }

    #[staticmethod]
    fn preset_names() -> Vec<&'static str> {
        Params::preset_names().to_vec()
    }

    #[staticmethod]
    #[expect(clippy::needless_pass_by_value, reason = "extracted from Python objects")]
    fn from_urdf(bot_path: PathBuf, ball_path: PathBuf) -> PyResult<Self> {
        call(|| urdf::params_from_urdf(&bot_path, &ball_path)).map(Self)
    }

    #[pyo3(signature = (**changes))]
    fn replace(&self, changes: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let changes = fields(changes)?;
        self.0.replace(borrowed(&changes)).map(Self).map_err(to_python)
    }

    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (name, values) in self.0.fields() {
            dict.set_item(name, to_object(py, values)?)?;
        }
        Ok(dict)
    }

    #[getter]
    fn ball_mass(&self) -> f64 {
        self.0.ball_mass
    }

    #[getter]
    fn ball_inertia(&self) -> f64 {
        self.0.ball_inertia
    }

    #[getter]
    fn ball_radius(&self) -> f64 {
        self.0.ball_radius
    }

    #[getter]
    fn body_mass(&self) -> f64 {
        self.0.body_mass
    }

    #[getter]
    fn body_inertia(&self) -> (f64, f64, f64) {
        self.0.body_inertia.into()
    }

    #[getter]
    fn body_com_height(&self) -> f64 {
        self.0.body_com_height
    }

    #[getter]
    fn wheel_mass(&self) -> f64 {
        self.0.wheel_mass
    }

    #[getter]
    fn wheel_inertia(&self) -> f64 {
        self.0.wheel_inertia
    }

    #[getter]
    fn wheel_radius(&self) -> f64 {
        self.0.wheel_radius
    }

    #[getter]
    fn wheel_zenith(&self) -> f64 {
        self.0.wheel_zenith
    }

    #[getter]
    fn wheel_azimuths(&self) -> (f64, f64, f64) {
        self.0.wheel_azimuths.into()
    }

    #[getter]
    fn max_wheel_torque(&self) -> f64 {
        self.0.max_wheel_torque
    }

    #[getter]
    fn gravity(&self) -> f64 {
        self.0.gravity
    }

    #[getter]
    fn ball_viscous_friction(&self) -> f64 {
        self.0.ball_viscous_friction
    }

    #[getter]
    fn wheel_viscous_friction(&self) -> f64 {
        self.0.wheel_viscous_friction
    }

    #[getter]
    fn wheel_coulomb_friction(&self) -> f64 {
        self.0.wheel_coulomb_friction
    }

    #[getter]
    fn wheel_static_friction(&self) -> f64 {
        self.0.wheel_static_friction
    }

    #[getter]
    fn wheel_dynamic_friction(&self) -> f64 {
        self.0.wheel_dynamic_friction
    }

    #[getter]
    fn floor_static_friction(&self) -> f64 {
        self.0.floor_static_friction
    }

    #[getter]
    fn floor_dynamic_friction(&self) -> f64 {
        self.0.floor_dynamic_friction
    }

    #[getter]
    fn friction_critical_velocity(&self) -> f64 {
        self.0.friction_critical_velocity
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

/// The given parameters, or the paper's.
pub(crate) fn or_paper(params: Option<&PyParams>) -> Params {
    params.map_or_else(Params::paper, |p| p.0.clone())
}
