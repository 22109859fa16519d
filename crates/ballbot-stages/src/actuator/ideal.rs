//! The ideal torque source.

use super::Actuator;
use ballbot_base::lanes::{Lane, Memory};

/// A motor that gives the commanded fraction of its largest torque, instantly and at any speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ideal {
    /// Torque of a command of 1, N·m.
    pub max_torque: f64,
}

impl Actuator for Ideal {
    const MEMORY: usize = 0;

    #[inline(always)]
    fn is_held(&self) -> bool {
        true
    }

    #[inline(always)]
    fn torques<L: Lane>(&self, [a, b, c]: [L; 3], _: [L; 3], _: &mut Memory<'_, L>) -> [L; 3] {
        [a * self.max_torque, b * self.max_torque, c * self.max_torque]
    }
}
