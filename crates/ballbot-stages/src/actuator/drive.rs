//! The actuators of environments as one type.

use super::{Actuator, Ideal, MotorOptions, Motors};
use ballbot_base::error::Result;
use ballbot_base::lanes::{Lane, Memory};
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;

/// An actuator that is chosen when environments are created. The run-time choice costs less than compiling environments
/// for each.
#[derive(Clone)]
pub enum Drive {
    /// Ideal motors.
    Ideal(Ideal),
    /// Motors with their effects.
    Motors(Motors),
}

macro_rules! of_chosen {
    ($drive:expr, $actuator:ident => $result:expr) => {
        match $drive {
            Drive::Ideal($actuator) => $result,
            Drive::Motors($actuator) => $result,
        }
    };
}

impl Actuator for Drive {
    const MEMORY: usize = 0;

    #[inline(always)]
    fn is_held(&self) -> bool {
        of_chosen!(self, actuator => actuator.is_held())
    }

    fn is_individual(&self) -> bool {
        of_chosen!(self, actuator => actuator.is_individual())
    }

    fn memory_len(&self) -> usize {
        of_chosen!(self, actuator => actuator.memory_len())
    }

    fn begin(&self, key: [u32; 2], episode: u32, memory: &mut [f64]) {
        of_chosen!(self, actuator => actuator.begin(key, episode, memory));
    }

    fn fits(&self, options: &MotorOptions, params: &Params) -> Result<()> {
        of_chosen!(self, actuator => actuator.fits(options, params))
    }

    fn equip(&self, options: &MotorOptions, params: &Params, memory: &mut [f64]) {
        of_chosen!(self, actuator => actuator.equip(options, params, memory));
    }

    #[inline(always)]
    fn torques<L: Lane>(&self, commands: Wheels<L>, wheel_speeds: Wheels<L>, memory: &mut Memory<'_, L>) -> Wheels<L> {
        of_chosen!(self, actuator => actuator.torques(commands, wheel_speeds, memory))
    }
}
