//! Options of a task and of its environments, from and to Python.

use crate::batch::events::{events, to_list};
use crate::batch::perception::{instrument, levels, levels_object, set_instruments};
use crate::errors::to_python;
use crate::robot::params::Robot;
use crate::robot::terrain::{terrain, terrain_object};
use crate::values::fields::{option, optional_dict};
use crate::values::keywords::unknown;
use crate::values::numbers::one_or_more;
use ballbot_core::batch::{History, SCALAR_OPTIONS, ScalarKind, ScalarOption, TaskConfig};
use ballbot_core::fields::OptionDescription;
use ballbot_core::perception::instrument_kind;
use ballbot_core::task::TaskDescription;
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Sets the option of `config` that a keyword argument names.
pub(crate) fn configure(
    config: &mut dyn TaskConfig,
    task: &TaskDescription,
    name: &str,
    value: &Bound<'_, PyAny>,
) -> PyResult<()> {
    let wrong = |what: &str| {
        let found = value.get_type().name().map_or_else(|_| "this".to_owned(), |n| n.to_string());
        PyTypeError::new_err(format!("{name} must be {what}, not {found}"))
    };
    let of_type = |error: PyErr, what: &str| match error.is_instance_of::<PyTypeError>(value.py()) {
        true => wrong(what),
        false => error,
    };
    match name {
        // `robot=None` is rejected: omit the option to get the default robot.
        "robot" => config.set_params(value.extract::<Robot>()?.0),
        "model" => {
            let model: String = value.extract().map_err(|_| wrong("the name of a model"))?;
            config.set_model(model.parse().map_err(to_python)?);
        }
        "terrain" => config.set_terrain(terrain(value)?),
        "actuators" => config.set_actuators(option(value)?.unwrap_or_default()),
        "sensors" => config.set_sensors(option(value)?),
        "level" => config.set_levels(levels(value)?),
        "history" => {
            config.set_history(history(value).map_err(|error| of_type(error, "a whole number, or a list of ages"))?);
        }
        "observation" => {
            let observation: String = value.extract().map_err(|_| wrong("the name of a kind of observation"))?;
            config.set_observation(observation.parse().map_err(to_python)?);
        }
        "reward" => {
            let scales = value.cast::<PyDict>().map_err(|_| {
                wrong("a dict of scales by reward term (a Task of your own has its own rewards: docs/own_tasks.md)")
            })?;
            for (term, scale) in scales {
                let term: String = term.extract()?;
                let scale =
                    scale.extract().map_err(|_| PyTypeError::new_err(format!("reward.{term} must be a number")))?;
                config.set_reward(&term, scale).map_err(to_python)?;
            }
        }
        "events" => config.set_events(events(value)?),
        _ if value.is_none() && is_optional(config, name) => (),
        _ if instrument_kind(name).is_ok() => match instrument(name, value)? {
            Some(instrument) => config.instruments_mut().set(instrument),
            None => config.instruments_mut().remove(name),
        },
        _ if config.get(name).is_none() => {
            let others: Vec<String> = resolved(value.py(), config, task)?.keys().extract()?;
            let known: Vec<_> = ["robot", "model"].into_iter().chain(others.iter().map(String::as_str)).collect();
            return Err(unknown(value.py(), "Batch", name, &known));
        }
        _ => {
            let values =
                one_or_more(name, value).map_err(|error| of_type(error, "a number, or an array of numbers"))?;
            config.set(name, &values).map_err(to_python)?;
        }
    }
    Ok(())
}

/// Which of the last observations are given together: their count, or their ages.
pub(crate) fn history(value: &Bound<'_, PyAny>) -> PyResult<History> {
    let numbers = one_or_more("history", value)?;
    // Arrays without dimensions have no length.
    match (numbers.as_slice(), value.len()) {
        ([count], Err(_)) => History::last(*count),
        (ages, _) => History::of_ages(ages),
    }
    .map_err(to_python)
}

/// [`history`] in the form of an option.
pub(crate) fn history_object<'py>(py: Python<'py>, history: &History) -> PyResult<Bound<'py, PyAny>> {
    match history {
        History::Last(count) => Ok(count.into_pyobject(py)?.into_any()),
        History::Ages(ages) => ages.into_bound_py_any(py),
    }
}

/// Whether None means a value that follows from other options.
fn is_optional(config: &dyn TaskConfig, name: &str) -> bool {
    SCALAR_OPTIONS.iter().any(|option| option.name == name && option.kind == ScalarKind::OptionalReal)
        || config.is_scaled(name)
}

/// All options with the values in use, except `robot` and `model`.
pub(crate) fn resolved<'py>(
    py: Python<'py>,
    config: &dyn TaskConfig,
    task: &TaskDescription,
) -> PyResult<Bound<'py, PyDict>> {
    let resolved = PyDict::new(py);
    for ScalarOption { name, kind, .. } in SCALAR_OPTIONS {
        let value = config.get(name).unwrap_or_default()[0];
        match kind {
            ScalarKind::Real | ScalarKind::OptionalReal => resolved.set_item(name, value)?,
            ScalarKind::Whole => resolved.set_item(name, value as u64)?,
            ScalarKind::Flag => resolved.set_item(name, value != 0.0)?,
        }
    }
    resolved.set_item("history", history_object(py, config.history())?)?;
    for OptionDescription { name, .. } in &task.options {
        match config.get(name).unwrap_or_default().as_slice() {
            [number] => resolved.set_item(name, number)?,
            numbers => resolved.set_item(name, numbers)?,
        }
    }
    resolved.set_item("terrain", terrain_object(py, config.terrain().as_ref())?)?;
    resolved.set_item("actuators", optional_dict(py, Some(config.actuators()).filter(|motors| !motors.is_ideal()))?)?;
    resolved.set_item("sensors", optional_dict(py, config.sensors().as_ref())?)?;
    set_instruments(&resolved, config.instruments())?;
    resolved.set_item("level", levels_object(py, *config.levels())?)?;
    resolved.set_item("observation", config.observation().name())?;
    let reward = PyDict::new(py);
    for (name, scale) in config.reward() {
        reward.set_item(name, scale)?;
    }
    resolved.set_item("reward", reward)?;
    resolved.set_item("events", to_list(py, config.events())?)?;
    Ok(resolved)
}
