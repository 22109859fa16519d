//! Eight robots in two vector registers of four. The types of eight that the vector library offers for processors with
//! narrower registers split and combine at each operation, which the compiler has to take apart again.

use super::{Eight, Lane, Value, rare_branch};
use fearless_simd::prelude::*;
use fearless_simd::{f64x4, mask64x4};
use std::ops::{Add, AddAssign, BitAnd, BitOr, Div, Mul, Neg, Not, Sub, SubAssign};

/// Eight `f64` with the instructions of `S`: lanes 0 to 3, and 4 to 7.
#[derive(Clone, Copy, Debug)]
pub struct Halves<S: Simd>(f64x4<S>, f64x4<S>);

/// Eight booleans, as [`Halves`].
#[derive(Clone, Copy, Debug)]
pub struct HalfMasks<S: Simd>(mask64x4<S>, mask64x4<S>);

macro_rules! by_halves {
    ($($trait:ident $function:ident $type:ident;)*) => {$(
        impl<S: Simd> $trait for $type<S> {
            type Output = Self;

            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                Self($trait::$function(self.0, other.0), $trait::$function(self.1, other.1))
            }
        }
    )*};
}

by_halves! {
    Add add Halves;
    Sub sub Halves;
    Mul mul Halves;
    Div div Halves;
    BitAnd bitand HalfMasks;
    BitOr bitor HalfMasks;
}

macro_rules! with_a_number {
    ($($trait:ident $function:ident;)*) => {$(
        impl<S: Simd> $trait<f64> for Halves<S> {
            type Output = Self;

            #[inline(always)]
            fn $function(self, other: f64) -> Self {
                $trait::$function(self, self.splat(other))
            }
        }
    )*};
}

with_a_number! {
    Add add;
    Sub sub;
    Mul mul;
    Div div;
}

impl<S: Simd> Neg for Halves<S> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0, -self.1)
    }
}

impl<S: Simd> AddAssign for Halves<S> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<S: Simd> SubAssign for Halves<S> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<S: Simd> Not for HalfMasks<S> {
    type Output = Self;

    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0, !self.1)
    }
}

impl<S: Simd> Value<Self> for Halves<S> {
    const PER_ROBOT: bool = true;

    #[inline(always)]
    fn at(self, _: Self) -> Self {
        self
    }
}

impl<S: Simd> Lane for Halves<S> {
    type Mask = HalfMasks<S>;
    type Cell = Eight;
    type Token = S;

    #[inline(always)]
    fn load(token: S, cell: &Eight) -> Self {
        let [a, b, c, d, e, f, g, h] = cell.0;
        Self([a, b, c, d].simd_into(token), [e, f, g, h].simd_into(token))
    }

    #[inline(always)]
    fn from_f64(token: S, value: f64) -> Self {
        let half = SimdBase::splat(token, value);
        Self(half, half)
    }

    #[inline(always)]
    fn store(self, cell: &mut Eight) {
        let (low, high) = cell.0.split_at_mut(4);
        self.0.store_slice(low);
        self.1.store_slice(high);
    }

    #[inline(always)]
    fn splat(self, value: f64) -> Self {
        Self::from_f64(self.0.simd, value)
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        // Rounded once on every processor, unlike the library's plain `mul_add`.
        Self(SimdFloat::mul_add_precise(self.0, factor.0, term.0), SimdFloat::mul_add_precise(self.1, factor.1, term.1))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(SimdFloat::sqrt(self.0), SimdFloat::sqrt(self.1))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(SimdBase::abs(self.0), SimdBase::abs(self.1))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // Minimum and maximum on other processors differ from x86 for NaN and signed zeros.
        if cfg!(target_arch = "x86_64") {
            Self(SimdBase::max(self.0, other.0), SimdBase::max(self.1, other.1))
        } else {
            Self::select(other.lt(self), self, other)
        }
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if cfg!(target_arch = "x86_64") {
            Self(SimdBase::min(self.0, other.0), SimdBase::min(self.1, other.1))
        } else {
            Self::select(self.lt(other), self, other)
        }
    }

    #[inline(always)]
    fn lt(self, other: Self) -> HalfMasks<S> {
        HalfMasks(self.0.simd_lt(other.0), self.1.simd_lt(other.1))
    }

    #[inline(always)]
    fn le(self, other: Self) -> HalfMasks<S> {
        HalfMasks(self.0.simd_le(other.0), self.1.simd_le(other.1))
    }

    #[inline(always)]
    fn select(mask: HalfMasks<S>, yes: Self, no: Self) -> Self {
        Self(mask.0.select(yes.0, no.0), mask.1.select(yes.1, no.1))
    }

    #[inline(always)]
    fn any(mask: HalfMasks<S>) -> bool {
        (mask.0 | mask.1).any_true()
    }

    #[inline(always)]
    fn rarely<R>(simd: S, rare: impl FnOnce() -> R) -> R {
        rare_branch();
        simd.vectorize(rare)
    }
}
