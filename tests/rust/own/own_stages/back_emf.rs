//! A motor with back-EMF: the torque falls with the speed of the wheel.

use ballbot_core::Wheels;
use ballbot_core::actuator::Actuator;
use ballbot_core::lanes::{Lane, Memory};

#[derive(Clone)]
pub struct BackEmf {
    /// Torque of a command of 1 at rest, N·m.
    pub max_torque: f64,
    /// Torque lost for each rad/s, N·m/(rad/s).
    pub loss: f64,
}

impl Actuator for BackEmf {
    const MEMORY: usize = 0;

    #[inline(always)]
    fn torques<L: Lane>(&self, commands: Wheels<L>, speeds: Wheels<L>, _: &mut Memory<'_, L>) -> Wheels<L> {
        Wheels::from_fn(|i| speeds[i].mul_add_all(-self.loss, commands[i] * self.max_torque))
    }
}
