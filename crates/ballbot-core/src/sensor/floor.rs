//! Whole numbers in lanes.

use crate::lanes::Lane;

/// The largest whole number up to `x`, for magnitudes below 2⁵¹.
#[inline(always)]
pub fn floor<L: Lane>(x: L) -> L {
    // Adding and subtracting 1.5 · 2⁵² rounds to a whole number.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let rounded = (x + ROUND) - ROUND;
    L::select(x.lt(rounded), rounded - 1.0, rounded)
}
