//! Encoders of the wheels.

use ballbot_base::lanes::{Lane, Memory, floor, lane_struct};
use ballbot_base::wheels::{WHEELS, Wheels};

lane_struct! {
    /// Three encoders that count ticks unless their angles are exact.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Encoders<T> {
        /// Angle of a tick, rad; 0 for exact angles.
        pub tick: T,
        /// Ticks in a radian; 0 for exact angles.
        pub ticks: T,
        /// Inverse of the time between two samples, 1/s.
        pub rate: T,
    }
}

/// Indices in the memory, from the first number of the encoders on.
const PHASE: usize = 0;
const ORIGIN: usize = 3;
const LAST: usize = 6;

/// Count of numbers that they keep.
pub const MEMORY: usize = 9;

impl<L: Lane> Encoders<L> {
    /// Begins an episode at given wheel angles, each with a phase within a tick in [0, 1); the wheels have turned by
    /// `turned` in the previous period.
    #[inline(always)]
    pub fn begin(
        &self,
        angles: Wheels<L>,
        turned: Wheels<L>,
        phases: Wheels<L>,
        memory: &mut Memory<'_, L>,
        first: usize,
    ) {
        memory.set_wheels(first + PHASE, phases);
        memory.set_wheels(first + ORIGIN, angles);
        for wheel in 0..WHEELS {
            memory.set(first + LAST + wheel, self.measured(-turned[wheel], phases[wheel]));
        }
    }

    /// Angles since the start of the episode and rates of the wheels. Where no sample is due, the last angles and no
    /// rates.
    #[inline(always)]
    pub fn read(
        &self,
        angles: Wheels<L>,
        due: Option<L::Mask>,
        memory: &mut Memory<'_, L>,
        first: usize,
    ) -> (Wheels<L>, Wheels<L>) {
        let (mut read, mut rates) = (angles, angles);
        for wheel in 0..WHEELS {
            let (phase, origin) = (memory.get(first + PHASE + wheel), memory.get(first + ORIGIN + wheel));
            let last = memory.get(first + LAST + wheel);
            let mut angle = self.measured(angles[wheel] - origin, phase);
            if let Some(due) = due {
                angle = L::select(due, angle, last);
            }
            memory.set(first + LAST + wheel, angle);
            read[wheel] = angle;
            rates[wheel] = (angle - last) * self.rate;
        }
        (read, rates)
    }

    /// The whole ticks in an angle.
    #[inline(always)]
    fn measured(&self, angle: L, phase: L) -> L {
        let counted = floor(angle.mul_add(self.ticks, phase)) * self.tick;
        L::select(self.tick.le(angle.zero()), angle, counted)
    }
}
