//! Arithmetic on one robot or on eight side by side, with the same code and results equal to the last bit.
//!
//! A computation is written once over [`Lane`] and instantiated for `f64` (one robot) and for eight `f64` in a vector
//! register. All operations, including fused multiply-adds, round as specified by IEEE 754, and none mixes lanes. The
//! result for a robot therefore does not depend on its neighbors or on the vector width of the processor.

mod cells;
mod dispatch;
mod dual;
mod group;
mod halves;
mod heading;
mod mat3;
mod math;
mod memory;
pub mod normal;
mod philox;
mod scalar;
mod slopes;
mod value;
mod vec3;
mod wide;

pub use crate::lane_struct;
pub use cells::{Cell, EIGHT, Eight};
pub use dispatch::{Kernel, run_eight, run_eight_at, run_one};
pub use dual::{Dual, DualCell};
pub use group::Group;
pub use heading::Heading;
pub use mat3::Mat3;
pub use math::{atan2_positive, exp_of_negative, floor, sin_cos, sin_cos_of_step, tanh, wrapped_angle};
pub use memory::Memory;
pub use normal::Draws;
pub use philox::philox;
pub use scalar::Scalar;
pub use slopes::{Directions, SIXTEEN, Sixteen, Slopes};
pub use value::{LaneValue, Own, Value};
pub use vec3::{Quat, Rotation, Vec3};
pub use wide::{Registers, Wide};

use std::ops::{Add, AddAssign, BitAnd, BitOr, Div, Mul, Neg, Not, Sub, SubAssign};

/// One number per robot, of one robot or of eight.
///
/// Methods that create a number from a constant return the type and width of `self`. Comparisons with NaN are false.
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
    /// One boolean per robot.
    type Mask: Copy + BitAnd<Output = Self::Mask> + BitOr<Output = Self::Mask> + Not<Output = Self::Mask>;

    /// Storage of the numbers in memory.
    type Cell: Cell;

    /// Proof at compile time of the available instructions.
    type Token: Copy;

    /// Loads the numbers from memory.
    fn load(token: Self::Token, cell: &Self::Cell) -> Self;

    /// A constant with the same value for all robots.
    fn from_f64(token: Self::Token, value: f64) -> Self;

    /// Stores the numbers in memory.
    fn store(self, cell: &mut Self::Cell);

    /// A constant with the same value for all robots.
    fn splat(self, value: f64) -> Self;

    /// Fused multiply-add self · factor + term, rounded once.
    fn mul_add(self, factor: Self, term: Self) -> Self;

    /// Square root.
    fn sqrt(self) -> Self;

    /// Absolute value.
    fn abs(self) -> Self;

    /// Maximum; `other` if either is NaN.
    fn max(self, other: Self) -> Self;

    /// Minimum; `other` if either is NaN.
    fn min(self, other: Self) -> Self;

    /// Comparison self < other.
    fn lt(self, other: Self) -> Self::Mask;

    /// Comparison self <= other.
    fn le(self, other: Self) -> Self::Mask;

    /// Selection of `yes` where `mask` is true, of `no` elsewhere.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;

    /// Whether the mask is true for any robot.
    fn any(mask: Self::Mask) -> bool;

    /// Runs rarely needed code with the same instructions but separate from the surrounding code, which thus keeps its
    /// registers.
    fn rarely<R>(token: Self::Token, rare: impl FnOnce() -> R) -> R;

    /// The number `value` with the derivative of `self`: how a number computed without derivatives, or by rounding, gets
    /// the derivative that it has. Equal to `value` in lanes without derivatives.
    #[inline(always)]
    fn with_value(self, value: Self) -> Self {
        value
    }

    /// Fused multiply-add self · factor + term with the same factor for all robots, rounded once.
    #[inline(always)]
    fn mul_add_all(self, factor: f64, term: Self) -> Self {
        self.mul_add(self.splat(factor), term)
    }

    /// Fused term − self · factor, rounded once.
    #[inline(always)]
    fn neg_mul_add(self, factor: Self, term: Self) -> Self {
        (-self).mul_add(factor, term)
    }

    /// Zero for all robots.
    #[inline(always)]
    fn zero(self) -> Self {
        self.splat(0.0)
    }

    /// Square.
    #[inline(always)]
    fn squared(self) -> Self {
        self * self
    }
}

/// Applies a function to three values. `map` of an array may not be inlined, and then the function is compiled for the
/// baseline instruction set.
#[inline(always)]
pub fn map3<T, U>([a, b, c]: [T; 3], f: impl Fn(T) -> U) -> [U; 3] {
    [f(a), f(b), f(c)]
}

/// Marks the branch that calls it as rare: the compiler does not inline other calls there.
#[cold]
#[inline(never)]
fn rare_branch() {}
