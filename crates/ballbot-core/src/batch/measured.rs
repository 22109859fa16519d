//! The states that controllers take: those that the sensors gave last, of one robot or of eight.

use super::chunk::Environments;
use super::robots::Robots;
use crate::actuator::Actuator;
use crate::lane_state::{LaneState, StateCells};
use crate::lanes::{Cell, EIGHT, Eight, Kernel, Memory, Scalar, Wide, run_eight, run_one};
use crate::sensor::Sensor;
use crate::task::Task;
use fearless_simd::Simd;

/// Cells in which a sensor keeps its numbers.
pub trait Measured: Cell {
    /// Replaces true states by those that the sensor gave last; `one` is room for its numbers of one robot.
    fn measure<S: Sensor>(sensor: &S, memory: &mut [Self], one: &mut [f64], states: &mut StateCells<Self>);
}

impl Measured for f64 {
    fn measure<S: Sensor>(sensor: &S, memory: &mut [f64], _: &mut [f64], states: &mut StateCells<f64>) {
        run_one(
            #[inline(always)]
            || {
                let state: LaneState<f64> = states.load(Scalar);
                sensor.last(&state, &mut Memory::new(Scalar, memory)).store(states);
            },
        );
    }
}

impl Measured for Eight {
    fn measure<S: Sensor>(sensor: &S, memory: &mut [Eight], one: &mut [f64], states: &mut StateCells<Eight>) {
        run_eight(Last { sensor, memory, one, states });
    }
}

struct Last<'a, S> {
    sensor: &'a S,
    memory: &'a mut [Eight],
    one: &'a mut [f64],
    states: &'a mut StateCells<Eight>,
}

impl<S: Sensor> Kernel for Last<'_, S> {
    #[inline(always)]
    fn run<V: Simd>(self, simd: V) {
        let state: LaneState<Wide<V>> = self.states.load(simd);
        self.sensor.last(&state, &mut Memory::new(simd, self.memory)).store(self.states);
    }

    fn run_one_by_one(self) {
        for i in 0..EIGHT {
            self.one.iter_mut().zip(&*self.memory).for_each(|(one, all)| *one = all.0[i]);
            let mut state = self.states.lane(i);
            f64::measure(self.sensor, self.one, &mut [], &mut state);
            self.states.set_lane(i, &state);
        }
    }
}

impl<R: Robots, T: Task, A: Actuator, S: Sensor> Environments<R, T, A, S> {
    /// Writes the states of all robots as the task observes them. Of a robot before its first episode it is that at rest.
    pub(super) fn read_measured(&mut self, states: &mut StateCells<R::Cell>) {
        self.robots.read(states);
        let (sensor, one) = (&self.step.sensor, &mut self.one.sensor);
        if self.episodes.iter().all(|episodes| *episodes > 0) {
            R::Cell::measure(sensor, &mut self.ledger.sensor, one, states);
            return;
        }
        let mut memory = self.ledger.sensor.clone();
        for i in 0..self.used {
            let number = self.sensor_numbers(i);
            memory.iter_mut().enumerate().for_each(|(k, cell)| cell.set(i, number(k)));
        }
        R::Cell::measure(&self.step.sensor, &mut memory, &mut self.one.sensor, states);
    }
}
