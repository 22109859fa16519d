//! Friction model of `contact` and `rigid`.

use crate::lanes::{Lane, exp_of_negative};

/// Friction coefficient of the Stribeck law, μ_d + (μ_s − μ_d) exp(−(v / v_c)²), with μ_s `fixed`, μ_d `moving` and
/// (v / v_c)² `squared_ratio` (Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30(7), 1994, eq. (4)).
#[inline(always)]
pub fn stribeck<L: Lane>(fixed: L, moving: L, squared_ratio: L) -> L {
    /// Argument below which four terms of the exponential series are exact to rounding.
    const SERIES_LIMIT: f64 = 1e-3;
    let one = squared_ratio.splat(1.0);
    let x = -squared_ratio;
    let mut share = x.mul_add_all(0.25, one);
    for n in [3.0, 2.0, 1.0] {
        share = (share * x).mul_add_all(1.0 / n, one);
    }
    let large = !squared_ratio.le(squared_ratio.splat(SERIES_LIMIT));
    if L::any(large) {
        share = L::select(large, exp_of_negative(squared_ratio), share);
    }
    share.mul_add(fixed - moving, one * moving)
}
