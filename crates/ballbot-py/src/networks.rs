//! Networks of robots from arrays.

use crate::convert::{ANY_COUNT, objects, read_elements};
use crate::errors::to_python;
use ballbot_core::batch::{Layer, Networks};
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

/// Most layers of a network.
const MAX_LAYERS: usize = 64;

/// The networks of `n` robots from (weights, biases) of each layer.
pub(crate) fn networks(value: &Bound<'_, PyAny>, n: usize) -> PyResult<Networks> {
    let mut read = Vec::new();
    for (k, layer) in objects("policies", value, MAX_LAYERS)?.iter().enumerate() {
        let name = format!("policies[{k}]");
        let [weights, biases] = <[_; 2]>::try_from(objects(&name, layer, 2)?)
            .map_err(|_| PyTypeError::new_err(format!("{name} must be a pair: weights and biases")))?;
        let mut numbers = (Vec::new(), Vec::new());
        let array = read_elements(&format!("{name}[0]"), &weights, &[Some(n), None, None], ANY_COUNT, &mut numbers.0)?;
        let [outputs, inputs] = [array.shape()[1], array.shape()[2]];
        read_elements(&format!("{name}[1]"), &biases, &[Some(n), Some(outputs)], ANY_COUNT, &mut numbers.1)?;
        read.push((outputs, inputs, numbers));
    }
    let layers: Vec<_> = read
        .iter()
        .map(|(outputs, inputs, (weights, biases))| Layer { inputs: *inputs, outputs: *outputs, weights, biases })
        .collect();
    Networks::new(n, &layers).map_err(to_python)
}
