//! Sensors: from the state of the model to the state that a task observes.

pub mod estimator;
mod exact;
mod readings;

pub use exact::Exact;
pub use readings::Readings;

use crate::lane_state::LaneState;
use crate::lanes::{Lane, Memory};

/// The stage between the true state and the observation, once a control step. Written once over lanes.
pub trait Sensor: Clone + Send + Sync + 'static {
    /// How many numbers the stage keeps from one reading to the next; zeros at the start of an episode.
    const MEMORY: usize;

    /// The state as it is measured.
    fn read<L: Lane>(&self, state: &LaneState<L>, memory: &mut Memory<'_, L>) -> LaneState<L>;
}
