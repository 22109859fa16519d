//! A sensor that measures the state of the previous control step.

use ballbot_core::LaneState;
use ballbot_core::lanes::{Lane, Memory};
use ballbot_core::sensor::Sensor;

#[derive(Clone)]
pub struct Delay;

/// How many numbers a state has; the memory begins with the last state.
const NUMBERS: usize = LaneState::<f64>::LEN;
/// Whether there was a reading.
const STARTED: usize = NUMBERS;
/// The last state that was output.
const GIVEN: usize = STARTED + 1;

impl Sensor for Delay {
    const MEMORY: usize = GIVEN + NUMBERS;

    #[inline(always)]
    fn read<L: Lane>(&self, state: &LaneState<L>, memory: &mut Memory<'_, L>) -> LaneState<L> {
        let started = state.ball_position.x.zero().lt(memory.get(STARTED));
        let given = LaneState::select(started, &memory.group(0), state);
        memory.set_group(0, state);
        memory.set_group(GIVEN, &given);
        memory.set(STARTED, memory.splat(1.0));
        given
    }

    #[inline(always)]
    fn last<L: Lane>(&self, _: &LaneState<L>, memory: &mut Memory<'_, L>) -> LaneState<L> {
        memory.group(GIVEN)
    }
}
