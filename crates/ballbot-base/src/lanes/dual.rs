//! Numbers with derivatives: forward differentiation of code over lanes.
//!
//! A [`Dual`] is a number of one robot and its derivatives along several directions, side by side ([`Slopes`]). Code
//! over [`Lane`] computes with it what it computes with `f64`, to the last bit, and the derivatives follow by the chain
//! rule. Where a function has a kink, the derivative is the one of the branch taken.

use super::{Cell, Lane, Slopes};
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// A number with derivatives along several directions.
#[derive(Clone, Copy, Debug)]
pub struct Dual<D> {
    /// The number.
    pub value: f64,
    /// Its derivatives.
    pub derivatives: D,
}

/// Storage of a [`Dual`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DualCell<C> {
    /// The number.
    pub value: f64,
    /// Its derivative along each direction.
    pub derivatives: C,
}

/// One robot; `get` and `set` are of its number, and a number that is set has no derivatives.
impl<C: Cell> Cell for DualCell<C> {
    const WIDTH: usize = 1;

    #[inline(always)]
    fn get(&self, _: usize) -> f64 {
        self.value
    }

    #[inline(always)]
    fn set(&mut self, _: usize, value: f64) {
        *self = Self { value, derivatives: C::default() };
    }
}

impl<D: Slopes> Dual<D> {
    /// `value`, a function of the number whose slope there is `factor`.
    #[inline(always)]
    fn chained(self, value: f64, factor: f64) -> Self {
        Self { value, derivatives: self.derivatives * factor }
    }
}

impl<D: Slopes> Add for Dual<D> {
    type Output = Self;

    #[inline(always)]
    fn add(mut self, other: Self) -> Self {
        self += other;
        self
    }
}

impl<D: Slopes> AddAssign for Dual<D> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        self.value += other.value;
        self.derivatives += other.derivatives;
    }
}

impl<D: Slopes> Sub for Dual<D> {
    type Output = Self;

    #[inline(always)]
    fn sub(mut self, other: Self) -> Self {
        self -= other;
        self
    }
}

impl<D: Slopes> SubAssign for Dual<D> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        self.value -= other.value;
        self.derivatives -= other.derivatives;
    }
}

impl<D: Slopes> Mul for Dual<D> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        let derivatives = other.derivatives.mul_add(self.value, self.derivatives * other.value);
        Self { value: self.value * other.value, derivatives }
    }
}

impl<D: Slopes> Div for Dual<D> {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let (quotient, inverse) = (self.value / other.value, 1.0 / other.value);
        let derivatives = other.derivatives.mul_add(-quotient * inverse, self.derivatives * inverse);
        Self { value: quotient, derivatives }
    }
}

impl<D: Slopes> Neg for Dual<D> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self { value: -self.value, derivatives: -self.derivatives }
    }
}

impl<D: Slopes> Add<f64> for Dual<D> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: f64) -> Self {
        Self { value: self.value + other, ..self }
    }
}

impl<D: Slopes> Sub<f64> for Dual<D> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: f64) -> Self {
        Self { value: self.value - other, ..self }
    }
}

impl<D: Slopes> Mul<f64> for Dual<D> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: f64) -> Self {
        self.chained(self.value * other, other)
    }
}

impl<D: Slopes> Div<f64> for Dual<D> {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: f64) -> Self {
        self.chained(self.value / other, 1.0 / other)
    }
}

impl<D: Slopes> Lane for Dual<D> {
    type Mask = bool;
    type Cell = DualCell<D::Cell>;
    type Token = D::Token;

    #[inline(always)]
    fn load(token: D::Token, cell: &Self::Cell) -> Self {
        Self { value: cell.value, derivatives: D::load(token, &cell.derivatives) }
    }

    #[inline(always)]
    fn from_f64(token: D::Token, value: f64) -> Self {
        Self { value, derivatives: D::none(token) }
    }

    #[inline(always)]
    fn store(self, cell: &mut Self::Cell) {
        cell.value = self.value;
        self.derivatives.store(&mut cell.derivatives);
    }

    #[inline(always)]
    fn splat(self, value: f64) -> Self {
        Self { value, derivatives: self.derivatives.zero() }
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        let of_self = self.derivatives.mul_add(factor.value, term.derivatives);
        let derivatives = factor.derivatives.mul_add(self.value, of_self);
        Self { value: self.value.mul_add(factor.value, term.value), derivatives }
    }

    #[inline(always)]
    fn mul_add_all(self, factor: f64, term: Self) -> Self {
        let derivatives = self.derivatives.mul_add(factor, term.derivatives);
        Self { value: self.value.mul_add(factor, term.value), derivatives }
    }

    /// At zero the derivative is zero: the square root of a sum of squares has a kink there.
    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chained(root, if root > 0.0 { 0.5 / root } else { 0.0 })
    }

    #[inline(always)]
    fn abs(self) -> Self {
        if self.value < 0.0 { -self } else { Self { value: self.value.abs(), ..self } }
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self.value > other.value { self } else { other }
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self.value < other.value { self } else { other }
    }

    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self.value < other.value
    }

    #[inline(always)]
    fn le(self, other: Self) -> bool {
        self.value <= other.value
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
    fn rarely<R>(token: D::Token, rare: impl FnOnce() -> R) -> R {
        D::rarely(token, rare)
    }

    #[inline(always)]
    fn with_value(self, value: Self) -> Self {
        Self { value: value.value, ..self }
    }
}
