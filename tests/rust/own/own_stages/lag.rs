//! A motor whose torque follows its command with a first-order lag.

use ballbot_core::Wheels;
use ballbot_core::actuator::Actuator;
use ballbot_core::lanes::{Lane, Memory};

#[derive(Clone)]
pub struct Lag {
    /// Torque of a command of 1, N·m.
    pub max_torque: f64,
    /// Fraction of the distance to the command that the torque covers in a model step.
    pub share: f64,
}

impl Actuator for Lag {
    /// The torques, N·m.
    const MEMORY: usize = 3;

    #[inline(always)]
    fn torques<L: Lane>(&self, commands: Wheels<L>, _: Wheels<L>, memory: &mut Memory<'_, L>) -> Wheels<L> {
        for (i, command) in commands.into_iter().enumerate() {
            let torque = memory.get(i);
            memory.set(i, (command * self.max_torque - torque).mul_add_all(self.share, torque));
        }
        memory.wheels(0)
    }
}
