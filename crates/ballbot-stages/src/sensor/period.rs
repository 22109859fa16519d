//! When a sensor is sampled.

use ballbot_base::lanes::{Lane, floor, lane_struct};

lane_struct! {
    /// Time from one sample of a sensor to the next, a whole number of control steps.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Period<T> {
        pub steps: T,
        /// 1 / `steps`: the fraction that is one control step.
        pub inverse: T,
    }
}

impl<L: Lane> Period<L> {
    /// Whether there is a sample after `before` readings of the episode.
    #[inline(always)]
    pub fn due(&self, before: L) -> L::Mask {
        // Half a reading more keeps the rounded quotient away from whole numbers.
        let periods = floor((before + 0.5) * self.inverse);
        (before - periods * self.steps).le(before.zero())
    }
}
