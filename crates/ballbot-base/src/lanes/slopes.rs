//! Derivatives of a number along several directions, side by side.

use super::{Cell, EIGHT, Eight, Lane, Registers, Scalar, Wide, rare_branch, run_one};
use std::ops::{Add, AddAssign, Mul, Neg, Sub, SubAssign};

/// Number of directions of [`Sixteen`].
pub const SIXTEEN: usize = 2 * EIGHT;

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

/// Derivatives along sixteen directions.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sixteen(pub [Eight; 2]);

impl Cell for Sixteen {
    const WIDTH: usize = SIXTEEN;

    #[inline(always)]
    fn get(&self, index: usize) -> f64 {
        self.0[index / EIGHT].0[index % EIGHT]
    }

    #[inline(always)]
    fn set(&mut self, index: usize, value: f64) {
        self.0[index / EIGHT].0[index % EIGHT] = value;
    }
}

/// Derivatives along sixteen directions in vector registers.
#[derive(Clone, Copy)]
pub struct Directions<S: Registers>([Wide<S>; 2]);

impl<S: Registers> Add for Directions<S> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let ([a, b], [c, d]) = (self.0, other.0);
        Self([a + c, b + d])
    }
}

impl<S: Registers> Sub for Directions<S> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let ([a, b], [c, d]) = (self.0, other.0);
        Self([a - c, b - d])
    }
}

impl<S: Registers> Neg for Directions<S> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        let [a, b] = self.0;
        Self([-a, -b])
    }
}

impl<S: Registers> Mul<f64> for Directions<S> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        let [a, b] = self.0;
        Self([a * factor, b * factor])
    }
}

impl<S: Registers> AddAssign for Directions<S> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<S: Registers> SubAssign for Directions<S> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<S: Registers> Slopes for Directions<S> {
    type Cell = Sixteen;
    type Token = S;

    #[inline(always)]
    fn load(token: S, Sixteen([a, b]): &Sixteen) -> Self {
        Self([Lane::load(token, a), Lane::load(token, b)])
    }

    #[inline(always)]
    fn store(self, Sixteen([a, b]): &mut Sixteen) {
        self.0[0].store(a);
        self.0[1].store(b);
    }

    #[inline(always)]
    fn none(token: S) -> Self {
        Self([Lane::from_f64(token, 0.0); 2])
    }

    #[inline(always)]
    fn zero(self) -> Self {
        Self([self.0[0].zero(); 2])
    }

    #[inline(always)]
    fn mul_add(self, factor: f64, term: Self) -> Self {
        let ([a, b], [c, d]) = (self.0, term.0);
        Self([a.mul_add_all(factor, c), b.mul_add_all(factor, d)])
    }

    #[inline(always)]
    fn rarely<R>(simd: S, rare: impl FnOnce() -> R) -> R {
        Wide::<S>::rarely(simd, rare)
    }
}
