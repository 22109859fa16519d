//! Constants of robots in lanes: one number for all robots, or one per robot.

use super::{Cell, Eight, Lane, Registers, Wide};

/// A constant of the robots in lanes: one number for all robots (`f64`), or one per robot (`L`).
pub trait Value<L: Lane>: Copy {
    /// Whether each robot has its own number.
    const PER_ROBOT: bool;

    /// The constant of each robot, in the lanes of `like`.
    fn at(self, like: L) -> L;
}

impl<L: Lane> Value<L> for f64 {
    const PER_ROBOT: bool = L::Cell::WIDTH == 1;

    #[inline(always)]
    fn at(self, like: L) -> L {
        like.splat(self)
    }
}

/// A constant per robot, in lanes of any kind.
#[derive(Clone, Copy, Debug)]
pub struct Own<L>(pub L);

impl<L: Lane> Value<L> for Own<L> {
    const PER_ROBOT: bool = true;

    #[inline(always)]
    fn at(self, _: L) -> L {
        self.0
    }
}

/// A constant of eight robots in memory: one number for all robots (`f64`), or one per robot ([`Eight`]).
pub trait LaneValue: Copy + Send + Sync {
    /// The constant in the lanes of a vector register.
    type Wide<S: Registers>: Value<Wide<S>>;

    /// Reads the constant.
    fn wide<S: Registers>(&self, simd: S) -> Self::Wide<S>;

    /// The constant of one robot.
    fn lane(&self, index: usize) -> f64;
}

impl LaneValue for f64 {
    type Wide<S: Registers> = f64;

    #[inline(always)]
    fn wide<S: Registers>(&self, _: S) -> f64 {
        *self
    }

    #[inline(always)]
    fn lane(&self, _: usize) -> f64 {
        *self
    }
}

impl LaneValue for Eight {
    type Wide<S: Registers> = Wide<S>;

    #[inline(always)]
    fn wide<S: Registers>(&self, simd: S) -> Wide<S> {
        Lane::load(simd, self)
    }

    #[inline(always)]
    fn lane(&self, index: usize) -> f64 {
        self.0[index]
    }
}
