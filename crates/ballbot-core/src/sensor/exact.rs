//! The exact sensor.

use super::Sensor;
use crate::lane_state::LaneState;
use crate::lanes::{Lane, Memory};

/// Measures the true state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exact;

impl Sensor for Exact {
    const MEMORY: usize = 0;

    #[inline(always)]
    fn read<L: Lane>(&self, state: &LaneState<L>, _: &mut Memory<'_, L>) -> LaneState<L> {
        *state
    }
}
