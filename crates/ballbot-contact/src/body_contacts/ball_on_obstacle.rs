//! Contact of the ball and an obstacle, with friction.

use super::plane::{Plane, required};
use crate::constants::Constants;
use crate::friction::in_disc;
use crate::phases::Start;
use crate::types::{Velocities, select3};
use ballbot_base::lanes::{Lane, Value, Vec3};

/// The contact.
pub struct BallOnObstacle<L: Lane> {
    /// Outward normal of the obstacle and two tangents, inertial frame.
    axes: [Vec3<L>; 3],
    gap: L,
    /// Velocity of the normal row at least.
    required: L,
    candidate: L::Mask,
    /// Impulses on the ball along the axes, N·s.
    impulses: [L; 3],
}

impl<L: Lane> BallOnObstacle<L> {
    #[inline(always)]
    pub fn new<V: Value<L>>(c: &Constants<V>, start: &Start<L>, plane: &Plane<L>, restitution: L, limit: L) -> Self {
        let zero = limit.zero();
        let gap = plane.height - c.ball_radius.at(limit);
        let speed = plane.axes[0].dot(start.velocities.ball);
        Self {
            axes: plane.axes,
            gap,
            required: required(c, gap, speed, restitution),
            candidate: gap.lt(limit),
            impulses: [zero; 3],
        }
    }

    /// Whether any robot may touch the obstacle with its ball.
    #[inline(always)]
    pub fn may_touch(&self) -> bool {
        L::any(self.candidate)
    }

    /// Robots whose ball reaches the obstacle at these velocities.
    #[inline(always)]
    pub fn closes(&self, v: &Velocities<L>) -> L::Mask {
        self.candidate & (self.axes[0].dot(v.ball) + self.required).lt(self.gap.zero())
    }

    /// Velocity along a tangent of the ball's surface at the contact.
    #[inline(always)]
    fn slip<V: Value<L>>(&self, c: &Constants<V>, axis: Vec3<L>, v: &Velocities<L>) -> L {
        axis.dot(v.ball) - axis.dot(v.ball_rate.cross(self.axes[0])) * c.ball_radius.at(self.gap)
    }

    /// One Gauss-Seidel sweep, after which robots outside of `open` have their impulses from before. Returns the sum of the
    /// squared changes of the impulses.
    #[inline(always)]
    pub fn sweep_open<V: Value<L>>(
        &mut self,
        c: &Constants<V>,
        friction: L,
        open: L::Mask,
        v: &mut Velocities<L>,
    ) -> L {
        let zero = self.gap.zero();
        let [n, tx, ty] = self.impulses;
        let (mass, tangent) = (c.ball_mass.at(zero), c.floor_compliance_inverse.at(zero));
        let pressed = (self.axes[0].dot(v.ball) + self.required).neg_mul_add(mass, n).max(zero);
        let pressed = L::select(self.candidate, pressed, zero);
        let stick_x = self.slip(c, self.axes[1], v).neg_mul_add(tangent, tx);
        let stick_y = self.slip(c, self.axes[2], v).neg_mul_add(tangent, ty);
        let [x, y] = in_disc([stick_x, stick_y], friction * pressed);
        let change = Vec3::new(pressed - n, x - tx, y - ty);
        let along = self.along_axes([zero, change.y, change.z]);
        v.ball = v.ball.plus(self.axes[0] * change.x + along, c.ball_mass_inverse.at(zero));
        v.ball_rate = v.ball_rate.plus(along.cross(self.axes[0]), c.ball_rim_ratio.at(zero));
        self.impulses = select3(open, [pressed, x, y], self.impulses);
        change.norm_squared()
    }

    /// Impulse of the obstacle on the ball, N·s.
    #[inline(always)]
    pub fn impulse(&self) -> Vec3<L> {
        self.along_axes(self.impulses)
    }

    #[inline(always)]
    fn along_axes(&self, [n, x, y]: [L; 3]) -> Vec3<L> {
        let [up, across, along] = self.axes;
        up * n + across * x + along * y
    }

    /// Mask of the robots whose ball presses on the obstacle or overlaps it.
    #[inline(always)]
    pub fn touches(&self) -> L::Mask {
        let zero = self.gap.zero();
        zero.lt(self.impulses[0]) | self.gap.le(zero)
    }
}
