//! When an instrument is sampled, and when a sample is read.

use ballbot_base::control_steps::{latency_steps, steps_of};
use ballbot_base::error::Result;

/// Times in control steps of an episode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    period: u64,
    latency: u64,
}

impl Clock {
    /// Samples at `rate`, Hz (0: each control step), that are read after `latency`, s, in control steps of
    /// `control_dt`, s.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] for a latency that is not a whole number of at most 100 control steps.
    pub fn new(rate: f64, latency: f64, control_dt: f64) -> Result<Self> {
        let latency = latency_steps(latency, control_dt)? as u64;
        Ok(Self { period: steps_of(rate, control_dt) as u64, latency })
    }

    /// Maximum number of pending samples.
    pub fn slots(&self) -> usize {
        (self.latency / self.period) as usize + 1
    }

    /// The sample that is taken at a step of the episode, if any.
    pub fn taken(&self, step: u64) -> Option<u64> {
        step.is_multiple_of(self.period).then(|| step / self.period)
    }

    /// The sample that is read from a step of the episode on, if any. The sample of the start is read at once.
    pub fn read(&self, step: u64) -> Option<u64> {
        self.taken(step.checked_sub(self.latency)?).filter(|sample| *sample > 0)
    }

    /// Slot of a pending sample.
    pub fn slot(&self, sample: u64) -> usize {
        (sample % self.slots() as u64) as usize
    }
}
