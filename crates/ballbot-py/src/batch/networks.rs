//! Networks of robots from arrays.

use crate::control::controllers::PyController;
use crate::errors::to_python;
use crate::robot::params::Robot;
use crate::values::convert::{ANY_COUNT, objects, read_elements};
use crate::values::numbers::one_or_more;
use ballbot_core::batch::{Layer, Networks};
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Most layers of a network.
const MAX_LAYERS: usize = 64;

/// Numbers of a layer: outputs and inputs, weights and biases.
struct Numbers {
    shape: [usize; 2],
    weights: Vec<f64>,
    biases: Vec<f64>,
}

/// The layers of `n` networks from pairs of weights and biases; None is one network, whose arrays have no first axis.
fn read(of: &str, value: &Bound<'_, PyAny>, n: Option<usize>) -> PyResult<Vec<Numbers>> {
    let mut read = Vec::new();
    for (k, layer) in objects(of, value, MAX_LAYERS)?.iter().enumerate() {
        let name = format!("{of}[{k}]");
        let [weights, biases] = <[_; 2]>::try_from(objects(&name, layer, 2)?)
            .map_err(|_| PyTypeError::new_err(format!("{name} must be a pair: weights and biases")))?;
        let mut numbers = Numbers { shape: [0; 2], weights: Vec::new(), biases: Vec::new() };
        let first = usize::from(n.is_none());
        let shape = &[n, None, None][first..];
        let array = read_elements(&format!("{name}[0]"), &weights, shape, ANY_COUNT, &mut numbers.weights)?;
        numbers.shape = [array.shape()[1 - first], array.shape()[2 - first]];
        let shape = &[n, Some(numbers.shape[0])][first..];
        read_elements(&format!("{name}[1]"), &biases, shape, ANY_COUNT, &mut numbers.biases)?;
        read.push(numbers);
    }
    Ok(read)
}

fn layers(numbers: &[Numbers]) -> Vec<Layer<'_>> {
    numbers
        .iter()
        .map(|Numbers { shape: [outputs, inputs], weights, biases }| Layer {
            inputs: *inputs,
            outputs: *outputs,
            weights,
            biases,
        })
        .collect()
}

/// The networks of `n` robots from (weights, biases) of each layer; arrays without the axis of the robots are of one
/// network for all.
pub(crate) fn networks(value: &Bound<'_, PyAny>, n: usize) -> PyResult<Networks> {
    let axes = || -> PyResult<usize> {
        let weights = value.get_item(0)?.get_item(0)?;
        value.py().import("numpy")?.call_method1("ndim", (weights,))?.extract()
    };
    if axes().is_ok_and(|axes| axes == 2) {
        return Networks::shared(n, &layers(&read("policies", value, None)?)).map_err(to_python);
    }
    Networks::new(n, &layers(&read("policies", value, Some(n))?)).map_err(to_python)
}

/// A policy as a controller; `OnnxPolicy.controller` makes it from a file.
///
/// Args:
///     name: its name.
///     task: the task that it was trained in: "balance", "push", "goal" or "velocity".
///     layers: weights (1, outputs, inputs) and biases (1, outputs) of each layer.
///     history: ages of the observations that it is given together, control steps.
///     options: options of the environment that are numbers, by name.
///     robot: the robot; None is the paper's.
///     cells: weights (1, 4u, inputs + u) and biases (1, 4u) of each LSTM cell of u units before the layers: input,
///         forget, cell and output gates of inputs and own outputs.
///
/// Raises:
///     ValueError: another task, cells or layers that do not fit the observation, or a number out of range.
#[pyfunction]
#[pyo3(signature = (name, task, layers, history, options, robot=None, cells=None))]
pub(crate) fn _policy_controller(
    name: &str,
    task: &str,
    layers: &Bound<'_, PyAny>,
    history: &Bound<'_, PyAny>,
    options: &Bound<'_, PyDict>,
    robot: Option<Robot>,
    cells: Option<&Bound<'_, PyAny>>,
) -> PyResult<PyController> {
    let numbers = read("layers", layers, Some(1))?;
    let cells = cells.map_or_else(|| Ok(Vec::new()), |cells| read("cells", cells, Some(1)))?;
    let history = crate::batch::options::history(history)?;
    let mut values = Vec::new();
    for (name, value) in options {
        let name: String = name.extract()?;
        values.push((name.clone(), one_or_more(&name, &value)?));
    }
    let task = task.to_owned();
    PyController::designed(name, "Controller", Robot::or_paper(robot), move |params, _| {
        let options: Vec<_> = values.iter().map(|(name, values)| (name.as_str(), values.as_slice())).collect();
        let (cells, layers) = (self::layers(&cells), self::layers(&numbers));
        ballbot_core::batch::policy_controller(&task, params, &options, &history, &cells, &layers)
    })
}
