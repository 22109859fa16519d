//! When an instrument is sampled, and when a sample is read.

#[cfg(test)]
mod tests;

use crate::error::{Result, check};

/// Most control steps of a latency.
const MAX_LATENCY: f64 = 100.0;

/// Times in control steps of an episode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    period: u64,
    latency: u64,
}

impl Clock {
    /// Samples at `rate`, Hz (0: each control step), that are read after `latency`, s, in control steps of `control_dt`, s.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a latency that is no whole number of at most 100 control steps.
    pub fn new(rate: f64, latency: f64, control_dt: f64) -> Result<Self> {
        let steps = latency / control_dt;
        let words = format_args!(
            "a whole number of at most {MAX_LATENCY} control steps (latency = {latency} s, control_dt = {control_dt} s)"
        );
        check("latency / control_dt", steps, words, |n| {
            (n - n.round()).abs() <= 1e-6 * n.max(1.0) && n <= MAX_LATENCY + 0.5
        })?;
        let period = if rate > 0.0 { (1.0 / (rate * control_dt)).round().max(1.0) } else { 1.0 };
        Ok(Self { period: period as u64, latency: steps.round() as u64 })
    }

    /// Samples that may be under way.
    pub fn slots(&self) -> usize {
        (self.latency / self.period) as usize + 1
    }

    /// The sample that is taken at a step of the episode, if one is.
    pub fn taken(&self, step: u64) -> Option<u64> {
        step.is_multiple_of(self.period).then(|| step / self.period)
    }

    /// The sample that is read from a step of the episode on, if one is. That of the start is read at once.
    pub fn read(&self, step: u64) -> Option<u64> {
        self.taken(step.checked_sub(self.latency)?).filter(|sample| *sample > 0)
    }

    /// Where a sample is kept while it is under way.
    pub fn slot(&self, sample: u64) -> usize {
        (sample % self.slots() as u64) as usize
    }
}
