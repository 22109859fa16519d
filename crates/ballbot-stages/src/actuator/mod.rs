//! Actuators: from the commands of a control step to the torques of each model step.

mod chain;
mod drive;
mod ideal;
mod line;
mod motors;
mod options;

pub use drive::Drive;
pub use ideal::Ideal;
pub use motors::Motors;
pub use options::MotorOptions;

use ballbot_base::error::Result;
use ballbot_base::lanes::{Lane, Memory};
use ballbot_base::params::Params;
use ballbot_base::wheels::Wheels;

/// The stage between a command in [-1, 1] and the torque at a wheel's shaft. Written once over lanes.
pub trait Actuator: Clone + Send + Sync + 'static {
    /// Count of numbers that the stage keeps from one model step to the next; zeros at the start of an episode.
    const MEMORY: usize;

    /// Whether the torques depend only on the commands, so that they are constant over a control step.
    #[inline(always)]
    fn is_held(&self) -> bool {
        false
    }

    /// Whether each robot has individual options, set by [`Actuator::equip`]; events may then change them.
    fn is_individual(&self) -> bool {
        false
    }

    /// [`Actuator::MEMORY`], or another number where it follows from the options of the stage.
    fn memory_len(&self) -> usize {
        Self::MEMORY
    }

    /// Begins an episode of one robot, in a memory of zeros. Random numbers of the stage follow from the key of the
    /// environment's seed and the episode, which counts from the seed.
    fn begin(&self, key: [u32; 2], episode: u32, memory: &mut [f64]) {
        let _ = (key, episode, memory);
    }

    /// Checks that a robot may have these options.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] or [`ballbot_base::Error::Inconsistent`] naming the value and the limit.
    fn fits(&self, options: &MotorOptions, params: &Params) -> Result<()> {
        let _ = (options, params);
        Ok(())
    }

    /// Gives one robot its options, which fit, at the start of an episode or within it.
    fn equip(&self, options: &MotorOptions, params: &Params, memory: &mut [f64]) {
        let _ = (options, params, memory);
    }

    /// Torques of the next model step, N·m. `wheel_speeds` are the encoder rates, rad/s. An episode begins with the
    /// first model step of a control step; the commands are the same in all model steps of a control step.
    fn torques<L: Lane>(&self, commands: Wheels<L>, wheel_speeds: Wheels<L>, memory: &mut Memory<'_, L>) -> Wheels<L>;
}
