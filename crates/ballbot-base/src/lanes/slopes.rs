//! Derivatives of a number along several directions, side by side.

use super::{Cell, Scalar, rare_branch, run_one};
use fearless_simd::f64x4;
use fearless_simd::prelude::*;
use std::ops::{Add, AddAssign, Mul, Neg, Sub, SubAssign};

/// Number of directions of [`Twelve`].
pub const TWELVE: usize = 12;

/// Derivatives of a number along several directions: what [`Dual`](super::Dual) needs of them.
pub trait Slopes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Neg<Output = Self> + Mul<f64, Output = Self> + AddAssign + SubAssign
{
    /// Storage in memory.
    type Cell: Cell;

    /// Proof at compile time of the available instructions.
    type Token: Copy;

    /// Loads the derivatives from memory.
    fn load(token: Self::Token, cell: &Self::Cell) -> Self;

    /// Stores the derivatives in memory.
    fn store(self, cell: &mut Self::Cell);

    /// The derivatives of a constant.
    fn none(token: Self::Token) -> Self;

    /// The derivatives of a constant.
    fn zero(self) -> Self;

    /// Fused multiply-add self · factor + term, rounded once.
    fn mul_add(self, factor: f64, term: Self) -> Self;

    /// Runs rarely needed code, as [`Lane::rarely`](super::Lane::rarely).
    fn rarely<R>(token: Self::Token, rare: impl FnOnce() -> R) -> R;
}

/// Along one direction.
impl Slopes for f64 {
    type Cell = Self;
    type Token = Scalar;

    #[inline(always)]
    fn load(_: Scalar, cell: &Self) -> Self {
        *cell
    }

    #[inline(always)]
    fn store(self, cell: &mut Self) {
        *cell = self;
    }

    #[inline(always)]
    fn none(_: Scalar) -> Self {
        0.0
    }

    #[inline(always)]
    fn zero(self) -> Self {
        0.0
    }

    #[inline(always)]
    fn mul_add(self, factor: f64, term: Self) -> Self {
        f64::mul_add(self, factor, term)
    }

    #[inline(always)]
    fn rarely<R>(_: Scalar, rare: impl FnOnce() -> R) -> R {
        rare_branch();
        run_one(rare)
    }
}

/// Derivatives along twelve directions: the state of a robot that rolls and its torques.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Twelve(pub [f64; TWELVE]);

impl Cell for Twelve {
    const WIDTH: usize = TWELVE;

    #[inline(always)]
    fn get(&self, index: usize) -> f64 {
        self.0[index]
    }

    #[inline(always)]
    fn set(&mut self, index: usize, value: f64) {
        self.0[index] = value;
    }
}

/// Derivatives along twelve directions in three vector registers.
#[derive(Clone, Copy, Debug)]
pub struct Thirds<S: Simd>([f64x4<S>; 3]);

/// Operations part by part. Written out, so that the parts are numbers or registers, not arrays in memory.
macro_rules! by_parts {
    ([$($generic:tt)*] $type:ty: $($i:literal)*) => {
        impl<$($generic)*> Add for $type {
            type Output = Self;

            #[inline(always)]
            fn add(self, other: Self) -> Self {
                Self([$(self.0[$i] + other.0[$i]),*])
            }
        }

        impl<$($generic)*> Sub for $type {
            type Output = Self;

            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                Self([$(self.0[$i] - other.0[$i]),*])
            }
        }

        impl<$($generic)*> Neg for $type {
            type Output = Self;

            #[inline(always)]
            fn neg(self) -> Self {
                Self([$(-self.0[$i]),*])
            }
        }

        impl<$($generic)*> Mul<f64> for $type {
            type Output = Self;

            #[inline(always)]
            fn mul(self, factor: f64) -> Self {
                Self([$(self.0[$i] * factor),*])
            }
        }

        impl<$($generic)*> AddAssign for $type {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = *self + other;
            }
        }

        impl<$($generic)*> SubAssign for $type {
            #[inline(always)]
            fn sub_assign(&mut self, other: Self) {
                *self = *self - other;
            }
        }
    };
}

by_parts!([] Twelve: 0 1 2 3 4 5 6 7 8 9 10 11);
by_parts!([S: Simd] Thirds<S>: 0 1 2);

impl Slopes for Twelve {
    type Cell = Self;
    type Token = Scalar;

    #[inline(always)]
    fn load(_: Scalar, cell: &Self) -> Self {
        *cell
    }

    #[inline(always)]
    fn store(self, cell: &mut Self) {
        *cell = self;
    }

    #[inline(always)]
    fn none(_: Scalar) -> Self {
        Self::default()
    }

    #[inline(always)]
    fn zero(self) -> Self {
        Self::default()
    }

    #[inline(always)]
    fn mul_add(self, factor: f64, mut term: Self) -> Self {
        for (sum, slope) in term.0.iter_mut().zip(self.0) {
            *sum = slope.mul_add(factor, *sum);
        }
        term
    }

    #[inline(always)]
    fn rarely<R>(token: Scalar, rare: impl FnOnce() -> R) -> R {
        f64::rarely(token, rare)
    }
}

impl<S: Simd> Slopes for Thirds<S> {
    type Cell = Twelve;
    type Token = S;

    #[inline(always)]
    fn load(token: S, Twelve([a, b, c, d, e, f, g, h, i, j, k, l]): &Twelve) -> Self {
        Self([[*a, *b, *c, *d].simd_into(token), [*e, *f, *g, *h].simd_into(token), [*i, *j, *k, *l].simd_into(token)])
    }

    #[inline(always)]
    fn store(self, cell: &mut Twelve) {
        let [a, b, c] = self.0;
        a.store_slice(&mut cell.0[..4]);
        b.store_slice(&mut cell.0[4..8]);
        c.store_slice(&mut cell.0[8..]);
    }

    #[inline(always)]
    fn none(token: S) -> Self {
        Self([SimdBase::splat(token, 0.0); 3])
    }

    #[inline(always)]
    fn zero(self) -> Self {
        Self::none(self.0[0].simd)
    }

    #[inline(always)]
    fn mul_add(self, factor: f64, term: Self) -> Self {
        let ([a, b, c], [d, e, f]) = (self.0, term.0);
        let factor: f64x4<S> = SimdBase::splat(a.simd, factor);
        // Rounded once on every processor, unlike the library's plain `mul_add`.
        Self([
            SimdFloat::mul_add_precise(a, factor, d),
            SimdFloat::mul_add_precise(b, factor, e),
            SimdFloat::mul_add_precise(c, factor, f),
        ])
    }

    #[inline(always)]
    fn rarely<R>(simd: S, rare: impl FnOnce() -> R) -> R {
        rare_branch();
        simd.vectorize(rare)
    }
}
