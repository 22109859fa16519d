//! Encoder rates of the wheels.

use super::constants::Constants;
use super::types::Velocities;
use ballbot_base::lanes::{Lane, Value};
use ballbot_base::wheels::Wheels;

/// Rate of wheel `i` relative to the body.
#[inline(always)]
pub fn encoder_rate<L: Lane, V: Value<L>>(c: &Constants<V>, v: &Velocities<L>, i: usize) -> L {
    c.u(i, v.spins[i]).dot(v.body_rate) + v.spins[i]
}

/// Rates of all wheels relative to the body.
#[inline(always)]
pub fn encoder_rates<L: Lane, V: Value<L>>(c: &Constants<V>, v: &Velocities<L>) -> Wheels<L> {
    Wheels([encoder_rate(c, v, 0), encoder_rate(c, v, 1), encoder_rate(c, v, 2)])
}
