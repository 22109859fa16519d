//! Descriptions of tasks and controllers as plain Python data.

use crate::errors::to_python;
use ballbot_core::actuator::MotorOptions;
use ballbot_core::batch::{Batch, Observation, SCALAR_OPTIONS, ScalarKind, task_kinds};
use ballbot_core::control::controller_kinds;
use ballbot_core::fields::{OptionDescription, describe_options};
use ballbot_core::options::PublishedOptions;
use ballbot_core::perception::instrument_kinds;
use ballbot_core::sensor::SensorOptions;
use ballbot_core::task::{Geometry, SCALED_BOUND};
use ballbot_core::{ModelKind, Params, planning};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

fn option<'py>(py: Python<'py>, option: &OptionDescription) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("name", option.name)?;
    dict.set_item("unit", option.unit)?;
    match option.default.as_slice() {
        [] => dict.set_item("default", py.None())?,
        [number] => dict.set_item("default", number)?,
        numbers => dict.set_item("default", numbers)?,
    }
    dict.set_item("scaled", option.scaled)?;
    dict.set_item("limit", &option.limit)?;
    dict.set_item("doc", &option.doc)?;
    Ok(dict)
}

fn options<'py>(py: Python<'py>, all: &[OptionDescription]) -> PyResult<Bound<'py, PyList>> {
    PyList::new(py, all.iter().map(|o| option(py, o)).collect::<PyResult<Vec<_>>>()?)
}

/// Tasks by name: id, summary, options, observation rows, reward terms, reasons for termination, command, metrics.
pub(crate) fn tasks(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let tasks = PyDict::new(py);
    for kind in task_kinds() {
        let description = kind.description();
        let task = PyDict::new(py);
        task.set_item("id", description.id)?;
        task.set_item("summary", description.summary)?;
        task.set_item("success", description.success)?;
        task.set_item("has_terrain", description.has_terrain)?;
        task.set_item("max_episode_steps", description.max_episode_steps)?;
        task.set_item("reward_threshold", description.reward_threshold)?;
        task.set_item("options", options(py, &description.options)?)?;
        let rows = PyList::empty(py);
        for (row, rest) in description.rows.iter().zip(&description.scaling.rest) {
            let dict = PyDict::new(py);
            dict.set_item("name", row.name)?;
            dict.set_item("unit", row.unit)?;
            dict.set_item("bound", row.bound)?;
            dict.set_item("rest", rest)?;
            dict.set_item("typical", row.typical)?;
            rows.append(dict)?;
        }
        task.set_item("observation", rows)?;
        let terms = PyList::empty(py);
        for term in &description.terms {
            let dict = PyDict::new(py);
            dict.set_item("name", term.name)?;
            dict.set_item("scale", term.scale)?;
            dict.set_item("cost", term.cost)?;
            dict.set_item("formula", term.formula)?;
            terms.append(dict)?;
        }
        task.set_item("rewards", terms)?;
        task.set_item("terminations", description.terminations)?;
        let command = PyList::empty(py);
        for part in description.command {
            let dict = PyDict::new(py);
            dict.set_item("name", part.name)?;
            dict.set_item("unit", part.unit)?;
            dict.set_item("bound", part.bound)?;
            command.append(dict)?;
        }
        task.set_item("command", command)?;
        task.set_item("geometry", description.geometry.map(Geometry::name))?;
        let metrics = PyList::empty(py);
        for metric in &description.metrics {
            let dict = PyDict::new(py);
            dict.set_item("name", metric.name)?;
            dict.set_item("unit", metric.unit)?;
            dict.set_item("doc", metric.doc)?;
            metrics.append(dict)?;
        }
        task.set_item("metrics", metrics)?;
        tasks.set_item(description.name, task)?;
    }
    Ok(tasks)
}

/// Controllers by name: summary, sampling time, parts of the setpoint, fraction of traction, options.
pub(crate) fn controllers(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let controllers = PyDict::new(py);
    for kind in controller_kinds() {
        let controller = PyDict::new(py);
        controller.set_item("summary", kind.summary)?;
        controller.set_item("label", kind.label)?;
        controller.set_item("control_dt", kind.control_dt)?;
        controller.set_item("setpoint", kind.parts)?;
        controller.set_item("traction", kind.limits.traction)?;
        controller.set_item("options", options(py, &(kind.options)())?)?;
        controllers.set_item(kind.name, controller)?;
    }
    Ok(controllers)
}

/// Options of every environment that are single numbers.
fn scalars(py: Python<'_>) -> PyResult<Bound<'_, PyList>> {
    let scalars = PyList::empty(py);
    for option in SCALAR_OPTIONS {
        let (kind, limit) = match option.kind {
            ScalarKind::Real => ("float", option.limit.to_string()),
            ScalarKind::OptionalReal => ("float | None", option.limit.to_string()),
            ScalarKind::Whole => ("int", option.limit.to_string()),
            ScalarKind::Flag => ("bool", String::new()),
        };
        let dict = PyDict::new(py);
        dict.set_item("name", option.name)?;
        dict.set_item("type", kind)?;
        dict.set_item("unit", option.unit)?;
        dict.set_item("limit", limit)?;
        dict.set_item("doc", option.doc.trim())?;
        scalars.append(dict)?;
    }
    Ok(scalars)
}

/// Instruments by name, in the order of an observation: title, description, options.
fn instruments(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let instruments = PyDict::new(py);
    for kind in instrument_kinds() {
        let instrument = PyDict::new(py);
        instrument.set_item("title", kind.title)?;
        instrument.set_item("about", kind.about)?;
        instrument.set_item("options", options(py, &(kind.options)())?)?;
        instruments.set_item(kind.name, instrument)?;
    }
    Ok(instruments)
}

/// Adds the tables of names.
pub(crate) fn add_to(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    planning::register().map_err(to_python)?;
    module.add("TASKS", tasks(py)?)?;
    module.add("CONTROLLERS", controllers(py)?)?;
    module.add("MODELS", ModelKind::ALL.map(ModelKind::name))?;
    module.add("ROBOTS", Params::preset_names())?;
    module.add("PARAMETERS", options(py, &describe_options::<Params>())?)?;
    module.add("ENVIRONMENT_OPTIONS", scalars(py)?)?;
    module.add("ACTUATORS", MotorOptions::preset_names())?;
    module.add("ACTUATOR_OPTIONS", options(py, &describe_options::<MotorOptions>())?)?;
    module.add("SENSORS", SensorOptions::preset_names())?;
    module.add("SENSOR_OPTIONS", options(py, &describe_options::<SensorOptions>())?)?;
    module.add("INSTRUMENTS", instruments(py)?)?;
    module.add("OBSERVATIONS", Observation::ALL.map(Observation::name))?;
    module.add("SAME_ROBOT", Batch::SAME_ROBOT)?;
    module.add("SCALED_BOUND", SCALED_BOUND)
}
