//! Lanes of one robot: `f64`.

use super::{Lane, rare_branch, run_one};

/// Token of scalar code, which needs no special instructions.
#[derive(Clone, Copy, Debug)]
pub struct Scalar;

impl Lane for f64 {
    type Mask = bool;
    type Cell = f64;
    type Token = Scalar;

    #[inline(always)]
    fn load(_: Scalar, cell: &f64) -> Self {
        *cell
    }

    #[inline(always)]
    fn from_f64(_: Scalar, value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn store(self, cell: &mut f64) {
        *cell = self;
    }

    #[inline(always)]
    fn splat(self, value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        f64::mul_add(self, factor, term)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }

    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }

    #[inline(always)]
    fn le(self, other: Self) -> bool {
        self <= other
    }

    #[inline(always)]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }

    #[inline(always)]
    fn any(mask: bool) -> bool {
        mask
    }

    #[inline(always)]
    fn rarely<R>(_: Scalar, rare: impl FnOnce() -> R) -> R {
        rare_branch();
        run_one(rare)
    }
}
