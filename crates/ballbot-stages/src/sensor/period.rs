//! When a sensor is sampled.

use ballbot_base::lanes::Lane;
use ballbot_base::lanes::floor;

/// Time from one sample of a sensor to the next, a whole number of control steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Period<T> {
    steps: T,
    /// 1 / `steps`.
    inverse: T,
}

impl<L: Lane> Period<L> {
    /// A period from its control steps and their inverse.
    #[inline(always)]
    pub fn from_numbers([steps, inverse]: [L; 2]) -> Self {
        Self { steps, inverse }
    }

    /// The fraction that is one control step.
    #[inline(always)]
    pub fn inverse(&self) -> L {
        self.inverse
    }

    /// Whether there is a sample after `before` readings of the episode.
    #[inline(always)]
    pub fn due(&self, before: L) -> L::Mask {
        // Half a reading more keeps the rounded quotient away from whole numbers.
        let periods = floor((before + 0.5) * self.inverse);
        (before - periods * self.steps).le(before.zero())
    }
}
