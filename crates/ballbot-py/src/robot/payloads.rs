//! Payloads from Python and to Python.

use crate::errors::InvalidInputError;
use crate::values::numbers::whole;
use ballbot_core::{Deflection, PAYLOADS};
use pyo3::prelude::*;

/// Numbers of the deflections of a robot's payloads.
pub(crate) const NUMBERS: usize = 6 * PAYLOADS;

/// Index of a payload.
pub(crate) fn payload_index(value: &Bound<'_, PyAny>) -> PyResult<usize> {
    let index = whole(value)?;
    let payload = usize::try_from(index).ok().filter(|&payload| payload < PAYLOADS);
    payload.ok_or_else(|| InvalidInputError::new_err(format!("payload = {index} must be 0, or 1 for the second")))
}

/// Numbers of the deflections of a robot's payloads.
pub(crate) fn numbers_of(deflections: &[Deflection<f64>; PAYLOADS]) -> [f64; NUMBERS] {
    let mut numbers = [0.0; NUMBERS];
    numbers.as_chunks_mut().0.copy_from_slice(&deflections.map(|deflection| deflection.to_array()));
    numbers
}

/// Deflections of the payloads of each robot, from their numbers.
pub(crate) fn deflections_of(numbers: &[f64]) -> Vec<[Deflection<f64>; PAYLOADS]> {
    let (deflections, _) = numbers.as_chunks::<6>();
    let (robots, _) = deflections.as_chunks::<PAYLOADS>();
    robots.iter().map(|robot| robot.map(Deflection::from_array)).collect()
}
