//! The ideal torque source.

use super::Actuator;
use ballbot_base::lanes::{Lane, Memory};
use ballbot_base::wheels::Wheels;

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
    fn torques<L: Lane>(&self, commands: Wheels<L>, _: Wheels<L>, _: &mut Memory<'_, L>) -> Wheels<L> {
        let [a, b, c] = commands.0;
        Wheels([a * self.max_torque, b * self.max_torque, c * self.max_torque])
    }
}
