//! Constants of robots in lanes: one number for all robots, or one per robot.

use super::{Eight, Lane, Wide};
use fearless_simd::Simd;

/// A constant of the robots in lanes: one number for all robots (`f64`), or one per robot (`L`).
pub trait Value<L: Lane>: Copy {
    /// The constant of each robot, in the lanes of `like`.
    fn at(self, like: L) -> L;
}

impl<L: Lane> Value<L> for f64 {
    #[inline(always)]
    fn at(self, like: L) -> L {
        like.splat(self)
    }
}

impl<S: Simd> Value<Wide<S>> for Wide<S> {
    #[inline(always)]
    fn at(self, _: Wide<S>) -> Wide<S> {
        self
    }
}

/// A constant per robot, in lanes of any kind.
#[derive(Clone, Copy, Debug)]
pub struct Own<L>(pub L);

impl<L: Lane> Value<L> for Own<L> {
    #[inline(always)]
    fn at(self, _: L) -> L {
        self.0
    }
}

/// A constant of eight robots in memory: one number for all robots (`f64`), or one per robot ([`Eight`]).
pub trait LaneValue: Copy + Send + Sync {
    /// The constant in the lanes of a vector register.
    type Wide<S: Simd>: Value<Wide<S>>;

    /// Reads the constant.
    fn wide<S: Simd>(&self, simd: S) -> Self::Wide<S>;

    /// The constant of one robot.
    fn lane(&self, index: usize) -> f64;
}

impl LaneValue for f64 {
    type Wide<S: Simd> = f64;

    #[inline(always)]
    fn wide<S: Simd>(&self, _: S) -> f64 {
        *self
    }

    #[inline(always)]
    fn lane(&self, _: usize) -> f64 {
        *self
    }
}

impl LaneValue for Eight {
    type Wide<S: Simd> = Wide<S>;

    #[inline(always)]
    fn wide<S: Simd>(&self, simd: S) -> Wide<S> {
        Lane::load(simd, self)
    }

    #[inline(always)]
    fn lane(&self, index: usize) -> f64 {
        self.0[index]
    }
}
