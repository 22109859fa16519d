//! Eight robots in a vector register, or in as many registers as the processor needs for eight `f64`.

use super::{Eight, Lane, rare_branch};
use fearless_simd::prelude::*;
use fearless_simd::{f64x8, mask64x8};

/// Eight `f64` with the instructions of `S`.
pub type Wide<S> = f64x8<S>;

impl<S: Simd> Lane for Wide<S> {
    type Mask = mask64x8<S>;
    type Cell = Eight;
    type Token = S;

    #[inline(always)]
    fn load(token: S, cell: &Eight) -> Self {
        Self::load_array_ref(token, &cell.0)
    }

    #[inline(always)]
    fn from_f64(token: S, value: f64) -> Self {
        SimdBase::splat(token, value)
    }

    #[inline(always)]
    fn store(self, cell: &mut Eight) {
        self.store_array(&mut cell.0);
    }

    #[inline(always)]
    fn splat(self, value: f64) -> Self {
        SimdBase::splat(self.simd, value)
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        // Rounded once on every processor, unlike the crate's plain `mul_add`.
        SimdFloat::mul_add_precise(self, factor, term)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        SimdFloat::sqrt(self)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        SimdBase::abs(self)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // Minimum and maximum on other processors differ from x86 for NaN and signed zeros.
        if cfg!(target_arch = "x86_64") {
            SimdBase::max(self, other)
        } else {
            Self::select(other.lt(self), self, other)
        }
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if cfg!(target_arch = "x86_64") {
            SimdBase::min(self, other)
        } else {
            Self::select(self.lt(other), self, other)
        }
    }

    #[inline(always)]
    fn lt(self, other: Self) -> Self::Mask {
        self.simd_lt(other)
    }

    #[inline(always)]
    fn le(self, other: Self) -> Self::Mask {
        self.simd_le(other)
    }

    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        mask.select(yes, no)
    }

    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        mask.any_true()
    }

    #[inline(always)]
    fn rarely<R>(simd: S, rare: impl FnOnce() -> R) -> R {
        rare_branch();
        simd.vectorize(rare)
    }
}
