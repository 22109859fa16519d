//! Arithmetic on one robot or on eight side by side: the same code, the same results to the last bit.
//!
//! A computation is written once over [`Lane`] and instantiated for `f64` (one robot) and for eight `f64` in a vector
//! register. All operations round as IEEE 754 says, fused multiply-adds included, and none mixes lanes, so that what
//! comes out for a robot depends neither on its neighbors nor on the processor's vector width.

mod cells;
mod dispatch;
mod heading;
mod math;
mod memory;
mod scalar;
#[cfg(test)]
mod tests;
mod value;
mod vec3;
mod wide;

pub use crate::cells;
pub use cells::{AsCells, Cell, EIGHT, Eight};
pub use dispatch::{Kernel, run_eight, run_one};
pub use heading::Heading;
pub use math::{atan2_positive, exp_of_negative, wrapped_angle};
pub use memory::Memory;
pub use scalar::Scalar;
pub use value::{LaneValue, Value};
pub use vec3::{Quat, Rotation, Vec3};
pub use wide::Wide;

use std::ops::{Add, AddAssign, BitAnd, BitOr, Div, Mul, Neg, Not, Sub, SubAssign};

/// One number of each of some robots.
///
/// Methods that make a number from a constant take the lanes of `self` for their model. Comparisons with NaN are false.
pub trait Lane:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
    + AddAssign
    + SubAssign
{
    /// One truth of each robot.
    type Mask: Copy + BitAnd<Output = Self::Mask> + BitOr<Output = Self::Mask> + Not<Output = Self::Mask>;

    /// How the numbers lie in memory.
    type Cell: Cell;

    /// What the processor can do, known to the compiler.
    type Token: Copy;

    /// Reads the numbers.
    fn load(token: Self::Token, cell: &Self::Cell) -> Self;

    /// The same number for all robots.
    fn from_f64(token: Self::Token, value: f64) -> Self;

    /// Writes the numbers.
    fn store(self, cell: &mut Self::Cell);

    /// The same number for all robots.
    fn splat(self, value: f64) -> Self;

    /// self · factor + term, rounded once.
    fn mul_add(self, factor: Self, term: Self) -> Self;

    /// The root.
    fn sqrt(self) -> Self;

    /// The magnitude.
    fn abs(self) -> Self;

    /// The larger; `other` if either is NaN.
    fn max(self, other: Self) -> Self;

    /// The smaller; `other` if either is NaN.
    fn min(self, other: Self) -> Self;

    /// self < other.
    fn lt(self, other: Self) -> Self::Mask;

    /// self <= other.
    fn le(self, other: Self) -> Self::Mask;

    /// `yes` where `mask` is true, `no` elsewhere.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;

    /// Whether any robot's truth is true.
    fn any(mask: Self::Mask) -> bool;

    /// self · factor + term with the same factor for all robots, rounded once.
    #[inline(always)]
    fn mul_add_all(self, factor: f64, term: Self) -> Self {
        self.mul_add(self.splat(factor), term)
    }

    /// term − self · factor, rounded once.
    #[inline(always)]
    fn neg_mul_add(self, factor: Self, term: Self) -> Self {
        (-self).mul_add(factor, term)
    }

    /// Zero for all robots.
    #[inline(always)]
    fn zero(self) -> Self {
        self.splat(0.0)
    }

    /// Its square.
    #[inline(always)]
    fn squared(self) -> Self {
        self * self
    }
}

/// Three numbers from three cells.
#[inline(always)]
pub fn load3<L: Lane>(token: L::Token, [a, b, c]: &[L::Cell; 3]) -> [L; 3] {
    [L::load(token, a), L::load(token, b), L::load(token, c)]
}

/// Three numbers into three cells.
#[inline(always)]
pub fn store3<L: Lane>([a, b, c]: [L; 3], cells: &mut [L::Cell; 3]) {
    a.store(&mut cells[0]);
    b.store(&mut cells[1]);
    c.store(&mut cells[2]);
}
