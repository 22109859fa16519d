//! Times in whole control steps: sampling periods and read latencies.

use crate::error::{Result, check};

/// Largest latency in control steps.
const MAX_LATENCY: f64 = 100.0;

/// Control steps of `dt` (s) nearest to the period of `rate` (Hz; 0: every control step), at least one.
pub fn steps_of(rate: f64, dt: f64) -> f64 {
    if rate > 0.0 { (1.0 / (rate * dt)).round().max(1.0) } else { 1.0 }
}

/// Control steps of `control_dt` (s) in a latency, s.
///
/// # Errors
/// [`crate::Error::OutOfRange`] for a latency that is not a whole number of at most 100 steps.
pub fn latency_steps(latency: f64, control_dt: f64) -> Result<usize> {
    let steps = latency / control_dt;
    let words =
        format_args!("a whole number of at most {MAX_LATENCY} (latency = {latency} s, control_dt = {control_dt} s)");
    check("latency / control_dt", steps, words, |n| (n - n.round()).abs() <= 1e-6 * n && n <= MAX_LATENCY + 0.5)?;
    Ok(steps.round() as usize)
}
