//! Actuators: from the commands of a control step to the torques of each model step.

mod ideal;
mod motors;
mod options;

pub use ideal::Ideal;
pub use motors::Motors;
pub use options::MotorOptions;

use crate::lanes::{Lane, Memory};

/// The stage between a command in [-1, 1] and the torque at a wheel's shaft. Written once over lanes.
pub trait Actuator: Clone + Send + Sync + 'static {
    /// Whether the torques depend on the commands alone, so that they hold over a control step.
    const HELD: bool;

    /// How many numbers the stage keeps from one model step to the next; zeros at the start of an episode.
    const MEMORY: usize;

    /// [`Actuator::MEMORY`], or another number where it follows from the options of the stage.
    fn memory_len(&self) -> usize {
        Self::MEMORY
    }

    /// Torques of the next model step, N·m. `wheel_speeds` are those of the encoders, rad/s. An episode begins with the
    /// first model step of a control step; the commands are the same in all model steps of a control step.
    fn torques<L: Lane>(&self, commands: [L; 3], wheel_speeds: [L; 3], memory: &mut Memory<'_, L>) -> [L; 3];
}
