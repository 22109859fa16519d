//! Encoders of the wheels.

use super::floor::floor;
use super::period::Period;
use crate::lanes::{Lane, Memory};
use std::f64::consts::TAU;

/// Three encoders that count ticks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encoders {
    /// Angle of a tick, rad; `None` for exact angles.
    tick: Option<f64>,
    /// Time between two samples, s.
    period: f64,
}

/// Numbers of the memory, from the first one of the encoders on.
const PHASE: usize = 0;
const ORIGIN: usize = 3;
const LAST: usize = 6;

impl Encoders {
    /// How many numbers they keep.
    pub const MEMORY: usize = 9;

    /// Encoders with `ticks` a turn (0: exact) that are sampled once in a `period`.
    pub fn new(ticks: f64, period: Period) -> Self {
        Self { tick: (ticks > 0.0).then(|| TAU / ticks), period: period.duration() }
    }

    /// Begins an episode at given angles and speeds of the wheels, each at a place within a tick in [0, 1); the wheels
    /// count as having turned at these speeds in the period before.
    pub fn begin(&self, angles: [f64; 3], speeds: [f64; 3], phases: [f64; 3], memory: &mut [f64]) {
        for wheel in 0..3 {
            memory[PHASE + wheel] = phases[wheel];
            memory[ORIGIN + wheel] = angles[wheel];
            memory[LAST + wheel] = self.measured(-speeds[wheel] * self.period, phases[wheel]);
        }
    }

    /// Angles since the start of the episode and rates of the wheels. Where a sample is not due, the last angles and no
    /// rates.
    #[inline(always)]
    pub fn read<L: Lane>(
        &self,
        angles: [L; 3],
        due: Option<L::Mask>,
        memory: &mut Memory<'_, L>,
        first: usize,
    ) -> ([L; 3], [L; 3]) {
        let (mut read, mut rates) = (angles, angles);
        for wheel in 0..3 {
            let (phase, origin) = (memory.get(first + PHASE + wheel), memory.get(first + ORIGIN + wheel));
            let last = memory.get(first + LAST + wheel);
            let mut angle = self.measured(angles[wheel] - origin, phase);
            if let Some(due) = due {
                angle = L::select(due, angle, last);
            }
            memory.set(first + LAST + wheel, angle);
            read[wheel] = angle;
            rates[wheel] = (angle - last) * (1.0 / self.period);
        }
        (read, rates)
    }

    /// The whole ticks in an angle.
    #[inline(always)]
    fn measured<L: Lane>(&self, angle: L, phase: L) -> L {
        match self.tick {
            Some(tick) => floor(angle.mul_add_all(1.0 / tick, phase)) * tick,
            None => angle,
        }
    }
}
