//! The states that sensors give now, for tasks, and gave last, for controllers; for one robot or eight.

use crate::sensor::Sensor;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::{Cell, EIGHT, Eight, Kernel, Lane, Memory, Registers, Scalar, Wide, run_eight, run_one};

/// Cells in which a sensor keeps its numbers.
pub trait Measured: Cell {
    /// Replaces true states by the last states of the sensor; `one` is scratch space for its numbers of one robot.
    fn measure<S: Sensor>(sensor: &S, memory: &mut [Self], one: &mut [f64], states: &mut LaneState<Self>);

    /// Replaces true states by states that the sensor reads; `one` is scratch space for its numbers of one robot.
    fn read<S: Sensor>(sensor: &S, memory: &mut [Self], one: &mut [f64], states: &mut LaneState<Self>);
}

impl Measured for f64 {
    fn measure<S: Sensor>(sensor: &S, memory: &mut [f64], _: &mut [f64], states: &mut LaneState<f64>) {
        sense_one::<S, false>(sensor, memory, states);
    }

    // Compiled once for all tasks.
    #[inline(never)]
    fn read<S: Sensor>(sensor: &S, memory: &mut [f64], _: &mut [f64], states: &mut LaneState<f64>) {
        sense_one::<S, true>(sensor, memory, states);
    }
}

impl Measured for Eight {
    fn measure<S: Sensor>(sensor: &S, memory: &mut [Eight], one: &mut [f64], states: &mut LaneState<Eight>) {
        run_eight(Sense::<S, false> { sensor, memory, one, states });
    }

    #[inline(never)]
    fn read<S: Sensor>(sensor: &S, memory: &mut [Eight], one: &mut [f64], states: &mut LaneState<Eight>) {
        run_eight(Sense::<S, true> { sensor, memory, one, states });
    }
}

/// A new reading, or without `READ` the last one.
#[inline(always)]
fn sense<L: Lane, S: Sensor, const READ: bool>(
    sensor: &S,
    state: &LaneState<L>,
    memory: &mut Memory<'_, L>,
) -> LaneState<L> {
    if READ { sensor.read(state, memory) } else { sensor.last(state, memory) }
}

#[inline(always)]
fn sense_one<S: Sensor, const READ: bool>(sensor: &S, memory: &mut [f64], state: &mut LaneState<f64>) {
    run_one(
        #[inline(always)]
        || *state = sense::<f64, S, READ>(sensor, state, &mut Memory::new(Scalar, memory)),
    );
}

struct Sense<'a, S, const READ: bool> {
    sensor: &'a S,
    memory: &'a mut [Eight],
    one: &'a mut [f64],
    states: &'a mut LaneState<Eight>,
}

impl<S: Sensor, const READ: bool> Kernel for Sense<'_, S, READ> {
    #[inline(always)]
    fn run<V: Registers>(self, simd: V) {
        let state: LaneState<Wide<V>> = self.states.load(simd);
        self.states.store(&sense::<_, S, READ>(self.sensor, &state, &mut Memory::new(simd, self.memory)));
    }

    fn run_one_by_one(self) {
        for i in 0..EIGHT {
            self.one.iter_mut().zip(&*self.memory).for_each(|(one, all)| *one = all.0[i]);
            let mut state = self.states.lane(i);
            sense_one::<S, READ>(self.sensor, self.one, &mut state);
            self.states.set_lane(i, &state);
            self.memory.iter_mut().zip(&*self.one).for_each(|(all, one)| all.0[i] = *one);
        }
    }
}
