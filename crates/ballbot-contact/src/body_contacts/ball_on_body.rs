//! Contact of the ball and the body's cylinder, without friction.

use super::mast::MastFrame;
use crate::constants::{Constants, at3};
use crate::phases::Start;
use crate::rows::allowance;
use crate::types::Velocities;
use ballbot_base::lanes::{Lane, Value, Vec3};

/// The contact.
pub struct BallOnBody<L> {
    gap: L,
    /// Normal from body to ball, inertial frame.
    normal: Vec3<L>,
    /// Factor of the body rate, principal frame, m.
    arm: Vec3<L>,
    /// Change of the body rate per impulse, principal frame.
    effect: Vec3<L>,
    inverse: L,
    /// Normal impulse, N·s.
    pub impulse: L,
}

impl<L: Lane> BallOnBody<L> {
    #[inline(always)]
    pub fn new<V: Value<L>>(c: &Constants<V>, start: &Start<L>) -> Self {
        let ball = start.rows.ball_in_body;
        let (zero, one) = (ball.x.zero(), ball.x.splat(1.0));
        let frame = MastFrame::new(c, zero);
        let ball = frame.point(ball);
        let radius = c.body_radius.at(zero);
        let radial = ball.x.mul_add(ball.x, ball.y.squared()).sqrt();
        let outside = radius.lt(radial);
        let share = L::select(outside, radius / L::select(outside, radial, one), one);
        let height = ball.z.max(c.body_bottom.at(zero)).min(c.body_top.at(zero));
        let nearest = Vec3::new(ball.x * share, ball.y * share, height);
        let offset = ball - nearest;
        let distance = offset.norm_squared().sqrt();
        // A ball center inside the cylinder is pushed out through the lower end.
        let apart = zero.lt(distance);
        let inverse = one / L::select(apart, distance, one);
        let normal = Vec3::select(apart, offset * inverse, Vec3::new(zero, zero, -one));
        let (normal, nearest) = (frame.principal_vector(normal), frame.principal_point(nearest));
        let arm = normal.cross(nearest);
        let effect = arm.scaled_by(at3(c.body_inertia_inverse, zero));
        Self {
            gap: distance - c.ball_radius.at(zero),
            normal: start.rotation.apply(normal),
            arm,
            effect,
            inverse: one / (effect.dot(arm) + c.relative_mass_inverse.at(zero)),
            impulse: zero,
        }
    }

    /// Speed at which the gap opens minus the required speed.
    #[inline(always)]
    fn excess<V: Value<L>>(&self, c: &Constants<V>, v: &Velocities<L>) -> L {
        self.normal.dot(v.ball - v.body) + self.arm.dot(v.body_rate) + allowance(c, self.gap)
    }

    /// Robots whose gap closes at these velocities.
    #[inline(always)]
    pub fn closes<V: Value<L>>(&self, c: &Constants<V>, v: &Velocities<L>) -> L::Mask {
        self.excess(c, v).lt(self.gap.zero())
    }

    /// Updates the impulse of the robots in `mask`; the others have zero impulse. Returns the change.
    #[inline(always)]
    pub fn sweep<V: Value<L>>(&mut self, c: &Constants<V>, mask: L::Mask, v: &mut Velocities<L>) -> L {
        let zero = self.gap.zero();
        let pressed = self.excess(c, v).neg_mul_add(self.inverse, self.impulse).max(zero);
        let pressed = L::select(mask, pressed, zero);
        let change = pressed - self.impulse;
        self.push(c, change, v);
        self.impulse = pressed;
        change
    }

    #[inline(always)]
    fn push<V: Value<L>>(&self, c: &Constants<V>, impulse: L, v: &mut Velocities<L>) {
        v.ball = v.ball.plus(self.normal, impulse * c.ball_mass_inverse.at(impulse));
        v.body = v.body.plus(self.normal, -(impulse * c.body_mass_inverse.at(impulse)));
        v.body_rate = v.body_rate.plus(self.effect, impulse);
    }
}
