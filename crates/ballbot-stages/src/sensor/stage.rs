//! The stage between the state of the model and the state that a task observes.

use super::options::SensorOptions;
use super::readings::Readings;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Lane, Memory};
use ballbot_base::state::State;

/// Input of a stage at the start of an episode.
pub struct EpisodeStart<'a> {
    /// Acceleration of gravity, inertial frame, m/s²: (0, 0, −g) on a level floor.
    pub gravity: [f64; 3],
    /// Angular velocity of the floor, in its frame, rad/s.
    pub floor_rate: [f64; 3],
    /// The true first state.
    pub state: &'a LaneState<f64>,
    /// Key of the environment's random numbers.
    pub key: [u32; 2],
    /// Options of the robot's sensors where events change them; `None`: the options of all robots.
    pub options: Option<&'a SensorOptions>,
}

/// The stage between the true state and the observation, once per control step. Written once over lanes.
pub trait Sensor: Clone + Send + Sync + 'static {
    /// Count of numbers that the stage keeps from one reading to the next.
    const MEMORY: usize;

    /// [`Sensor::MEMORY`], or another number where it follows from the options of the stage.
    fn memory_len(&self) -> usize {
        Self::MEMORY
    }

    /// Whether events may give each robot individual options.
    fn is_individual(&self) -> bool {
        false
    }

    /// Whether the measured state is the true state, so that nothing has to be read.
    fn is_exact(&self) -> bool {
        false
    }

    /// Begins an episode, before its first reading. `memory` holds what the last episode left; zeros before the first.
    fn begin(&self, start: &EpisodeStart<'_>, memory: &mut [f64]) {
        let _ = start;
        memory.fill(0.0);
    }

    /// Changes the robot's gravity (frame of the floor, m/s²) and the angular velocity of its floor (rad/s) from the next
    /// reading on.
    fn set_gravity(&self, gravity: [f64; 3], floor_rate: [f64; 3], memory: &mut [f64]) {
        let _ = (gravity, floor_rate, memory);
    }

    /// The random numbers of the environment are reseeded with its next episode.
    fn seeded(&self, memory: &mut [f64]) {
        let _ = memory;
    }

    /// The measured state.
    fn read<L: Lane>(&self, state: &LaneState<L>, memory: &mut Memory<'_, L>) -> LaneState<L>;

    /// The state that the last [`Sensor::read`] returned; `state` is the true state. The memory is unchanged.
    #[inline(always)]
    fn last<L: Lane>(&self, state: &LaneState<L>, memory: &mut Memory<'_, L>) -> LaneState<L> {
        let _ = memory;
        *state
    }

    /// The last readings, from the numbers of the memory by their index; `None` if the stage has none.
    fn readings(&self, number: impl Fn(usize) -> f64) -> Option<Readings<f64>> {
        let _ = number;
        None
    }

    /// The state estimated from the last readings, from the numbers of the memory by their index; `None` if the stage
    /// estimates none.
    fn estimate(&self, number: impl Fn(usize) -> f64) -> Option<State> {
        let _ = number;
        None
    }
}
