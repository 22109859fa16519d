//! Ripple of the wheel rims, which consist of rollers: `docs/rollers.md`.

use super::constants::{Constants, at3};
use super::encoder::encoder_rate;
use super::types::{Pose, Velocities};
use ballbot_base::lanes::{Lane, Value, sin_cos};
use ballbot_base::wheels::Wheels;

/// The rims at the start of a step.
pub struct Ripple<L: Lane> {
    /// Robots whose wheels have a ripple. The others keep the bits of a batch of round wheels.
    pub on: L::Mask,
    /// Depth of each wheel's rim below its nominal radius, m.
    pub depths: Wheels<L>,
    /// Change of the depth with the wheel angle, m/rad.
    pub slopes: Wheels<L>,
    /// Contribution of the change of the slopes within the step to the mean speeds of the gaps, m/s.
    pub bends: Wheels<L>,
}

impl<L: Lane> Ripple<L> {
    /// Round wheels.
    #[inline(always)]
    pub fn none(like: L) -> Self {
        let zeros = Wheels::zero(like);
        Self { on: like.lt(like), depths: zeros, slopes: zeros, bends: zeros }
    }

    #[inline(always)]
    pub fn new<V: Value<L>>(c: &Constants<V>, pose: &Pose<L>, v: &Velocities<L>) -> Self {
        let amplitude = c.ripple_amplitude.at(v.ball.x);
        let count = c.roller_count.at(amplitude);
        let zero = amplitude.zero();
        let mut ripple = Self::none(zero);
        ripple.on = zero.lt(amplitude);
        if !L::any(ripple.on) {
            return ripple;
        }
        for (i, phase) in at3(c.roller_phases.0, amplitude).into_iter().enumerate() {
            let (sin, cos) = sin_cos(pose.wheel_angles[i].mul_add(count, phase));
            let speed = encoder_rate(c, v, i);
            let rate = speed * count;
            ripple.depths[i] = cos.neg_mul_add(amplitude, amplitude);
            ripple.slopes[i] = L::select(ripple.on, sin * amplitude * count, zero);
            let bend = cos * amplitude * rate.squared() * c.half_dt.at(zero);
            // However far a wheel turns in a step, its rim ends within its range of depths.
            let turning = ripple.slopes[i] * speed;
            let to_crest = -(ripple.depths[i] * c.sim_dt_inverse.at(zero) + turning);
            let to_notch = (amplitude + amplitude - ripple.depths[i]).mul_add(c.sim_dt_inverse.at(zero), -turning);
            ripple.bends[i] = bend.max(to_crest).min(to_notch);
        }
        ripple
    }

    /// `yes` for the robots with a ripple, `no` for the others.
    #[inline(always)]
    pub fn select(&self, yes: L, no: L) -> L {
        L::select(self.on, yes, no)
    }
}
