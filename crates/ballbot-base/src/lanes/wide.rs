//! Eight robots in vector registers.

use super::halves::Halves;
use super::{Eight, Lane, Value, rare_branch};
use fearless_simd::prelude::*;
#[cfg(target_arch = "x86_64")]
use fearless_simd::{Avx2, Avx512};
use fearless_simd::{f64x8, mask64x8};

/// Instructions of a processor, with the registers in which they hold eight `f64`.
pub trait Registers: Simd {
    /// Eight `f64`.
    type Wide: Lane<Token = Self, Cell = Eight> + Value<Self::Wide>;
}

/// Eight `f64` with the instructions of `S`.
pub type Wide<S> = <S as Registers>::Wide;

#[cfg(target_arch = "x86_64")]
impl Registers for Avx512 {
    type Wide = f64x8<Avx512>;
}

#[cfg(target_arch = "x86_64")]
impl Registers for Avx2 {
    type Wide = Halves<Avx2>;
}

#[cfg(target_arch = "aarch64")]
impl Registers for fearless_simd::Neon {
    type Wide = Halves<fearless_simd::Neon>;
}

impl<S: Simd> Value<Self> for f64x8<S> {
    const PER_ROBOT: bool = true;

    #[inline(always)]
    fn at(self, _: Self) -> Self {
        self
    }
}

impl<S: Simd> Lane for f64x8<S> {
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
