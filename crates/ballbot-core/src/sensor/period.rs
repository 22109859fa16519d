//! When a sensor is sampled.

use super::floor::floor;
use crate::lanes::Lane;

/// Time from one sample of a sensor to the next, a whole number of control steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Period {
    steps: f64,
    dt: f64,
}

impl Period {
    /// The period nearest to that of `rate` (Hz; 0: every control step) in control steps of `dt` (s), at least one.
    pub fn new(rate: f64, dt: f64) -> Self {
        let steps = if rate > 0.0 { (1.0 / (rate * dt)).round().max(1.0) } else { 1.0 };
        Self { steps, dt }
    }

    /// Whether there is a sample at every control step.
    pub fn is_one_step(&self) -> bool {
        self.steps <= 1.0
    }

    /// Control steps in the period.
    pub fn steps(&self) -> f64 {
        self.steps
    }

    /// s.
    pub fn duration(&self) -> f64 {
        self.steps * self.dt
    }

    /// Whether there is a sample after `before` readings of the episode; `None` if there always is.
    #[inline(always)]
    pub fn due<L: Lane>(&self, before: L) -> Option<L::Mask> {
        if self.is_one_step() {
            return None;
        }
        // Half a reading more keeps the rounded quotient away from whole numbers.
        let periods = floor((before + 0.5) * (1.0 / self.steps));
        Some((before - periods * self.steps).le(before.zero()))
    }
}
