//! Transcendental functions from IEEE operations only, so that results are equal on all processors.

use super::Lane;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

/// The largest whole number up to `x`, for magnitudes below 2⁵¹.
#[inline(always)]
pub fn floor<L: Lane>(x: L) -> L {
    // Adding and subtracting 1.5 · 2⁵² rounds to a whole number.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let rounded = (x + ROUND) - ROUND;
    // A whole number has no derivative.
    let rounded = x.zero().with_value(rounded);
    L::select(x.lt(rounded), rounded - 1.0, rounded)
}

/// Exponential e^(−x) for x ≥ 0, relative error 4e-14; e^(−64) for x > 64.
#[inline(always)]
pub fn exp_of_negative<L: Lane>(x: L) -> L {
    const HALVINGS: i32 = 7;
    /// 1/n for n from 14 to 1: computed here, as the division would take longer than all else.
    const INVERSES: [f64; 14] = {
        let mut inverses = [0.0; 14];
        let mut n = 14;
        while n > 0 {
            inverses[14 - n] = 1.0 / n as f64;
            n -= 1;
        }
        inverses
    };
    let x = x.min(x.splat(64.0)) * (-1.0 / f64::from(1 << HALVINGS));
    // Taylor series for x up to 1/2, error 1e-16.
    let mut series = x.splat(1.0);
    for inverse in INVERSES {
        series = (series * x).mul_add_all(inverse, x.splat(1.0));
    }
    for _ in 0..HALVINGS {
        series = series.squared();
    }
    series
}

/// Hyperbolic tangent, error 2e-14.
#[inline(always)]
pub fn tanh<L: Lane>(x: L) -> L {
    let falling = exp_of_negative(x.abs() * 2.0);
    let magnitude = (-falling + 1.0) / (falling + 1.0);
    L::select(x.lt(x.zero()), -magnitude, magnitude)
}

/// Angle of the point (x, y) from the x axis for y ≥ 0, in [0, π], error 1e-15; zero for (0, 0).
#[inline(always)]
pub fn atan2_positive<L: Lane>(y: L, x: L) -> L {
    let across = x.abs();
    let (small, large) = (y.min(across), y.max(across));
    let zero = y.zero();
    let one = y.splat(1.0);
    let ratio = small / L::select(zero.lt(large), large, one);
    // Above tan(π/8) the angle is measured from π/4.
    let steep = y.splat(0.414_213_562_373_095_03).lt(ratio);
    let t = L::select(steep, (ratio - 1.0) / (ratio + 1.0), ratio);
    let mut angle = arctangent(t);
    angle = L::select(steep, angle + FRAC_PI_4, angle);
    angle = L::select(across.lt(y), -angle + FRAC_PI_2, angle);
    L::select(x.lt(zero), -angle + std::f64::consts::PI, angle)
}

/// Angle in [−π, π] that differs from `angle` by whole turns, for |angle| below 1e9 rad.
#[inline(always)]
pub fn wrapped_angle<L: Lane>(angle: L) -> L {
    // Adding and subtracting 1.5 · 2⁵² rounds to a whole number.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let turns = angle.zero().with_value((angle * (1.0 / TAU) + ROUND) - ROUND);
    turns.mul_add_all(-TAU, angle)
}

/// Sine and cosine of an angle limited to ±1 rad, the rotation in one step; error 1e-12.
#[inline(always)]
pub fn sin_cos_of_step<L: Lane>(angle: L) -> (L, L) {
    let angle = angle.min(angle.splat(1.0)).max(angle.splat(-1.0));
    let minus = -angle.squared();
    let (mut sin, mut cos) = (angle.splat(1.0), angle.splat(1.0));
    for n in (1..=7).rev() {
        let n = f64::from(n);
        sin = (sin * minus).mul_add_all(1.0 / (2.0 * n * (2.0 * n + 1.0)), angle.splat(1.0));
        cos = (cos * minus).mul_add_all(1.0 / (2.0 * n * (2.0 * n - 1.0)), angle.splat(1.0));
    }
    (angle * sin, cos)
}

/// Sine and cosine of any angle below 1e9 rad, error 1e-11 at 1e4 turns.
#[inline(always)]
pub fn sin_cos<L: Lane>(angle: L) -> (L, L) {
    let (mut sin, mut cos) = sin_cos_of_step(wrapped_angle(angle) * 0.25);
    for _ in 0..2 {
        let twice = sin + sin;
        (cos, sin) = (sin.neg_mul_add(twice, cos.splat(1.0)), twice * cos);
    }
    (sin, cos)
}

/// Series of the arctangent for |t| ≤ tan(π/8).
#[inline(always)]
fn arctangent<L: Lane>(t: L) -> L {
    let squared = t.squared();
    let mut series = t.zero();
    for n in (0..=20).rev() {
        let sign = if n % 2 == 0 { 1.0 } else { -1.0 };
        series = series.mul_add(squared, t.splat(sign / f64::from(2 * n + 1)));
    }
    series * t
}
