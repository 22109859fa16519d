//! The exact sensor.

use super::{EpisodeStart, Readings, Sensor};
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Lane, Memory};
use ballbot_base::state::State;

/// Measures the true state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exact;

impl Sensor for Exact {
    const MEMORY: usize = 0;

    fn is_exact(&self) -> bool {
        true
    }

    #[inline(always)]
    fn read<L: Lane>(&self, state: &LaneState<L>, _: &mut Memory<'_, L>) -> LaneState<L> {
        *state
    }
}

/// Optional sensors of an environment; `None` is [`Exact`]. A stage is read once per control step, so the run-time
/// choice costs less than compiling another copy of the step.
impl<S: Sensor> Sensor for Option<S> {
    const MEMORY: usize = 0;

    fn memory_len(&self) -> usize {
        self.as_ref().map_or(0, Sensor::memory_len)
    }

    fn is_individual(&self) -> bool {
        self.as_ref().is_some_and(Sensor::is_individual)
    }

    fn is_exact(&self) -> bool {
        self.as_ref().is_none_or(Sensor::is_exact)
    }

    fn begin(&self, start: &EpisodeStart<'_>, memory: &mut [f64]) {
        if let Some(sensor) = self {
            sensor.begin(start, memory);
        }
    }

    fn set_gravity(&self, gravity: [f64; 3], floor_rate: [f64; 3], memory: &mut [f64]) {
        if let Some(sensor) = self {
            sensor.set_gravity(gravity, floor_rate, memory);
        }
    }

    fn seeded(&self, memory: &mut [f64]) {
        if let Some(sensor) = self {
            sensor.seeded(memory);
        }
    }

    #[inline(always)]
    fn read<L: Lane>(&self, state: &LaneState<L>, memory: &mut Memory<'_, L>) -> LaneState<L> {
        match self {
            None => *state,
            Some(sensor) => sensor.read(state, memory),
        }
    }

    #[inline(always)]
    fn last<L: Lane>(&self, state: &LaneState<L>, memory: &mut Memory<'_, L>) -> LaneState<L> {
        match self {
            None => *state,
            Some(sensor) => sensor.last(state, memory),
        }
    }

    fn readings(&self, number: impl Fn(usize) -> f64) -> Option<Readings<f64>> {
        self.as_ref()?.readings(number)
    }

    fn estimate(&self, number: impl Fn(usize) -> f64) -> Option<State> {
        self.as_ref()?.estimate(number)
    }
}
