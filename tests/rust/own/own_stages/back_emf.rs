//! A motor with back-EMF: the torque falls with the speed of the wheel.

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
    fn torques<L: Lane>(&self, commands: [L; 3], speeds: [L; 3], _: &mut Memory<'_, L>) -> [L; 3] {
        let torque = |i: usize| speeds[i].mul_add_all(-self.loss, commands[i] * self.max_torque);
        [torque(0), torque(1), torque(2)]
    }
}
