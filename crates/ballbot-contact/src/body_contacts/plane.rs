//! The planes that parts of the robot touch: tangent to the floor or to an obstacle.

use crate::constants::Constants;
use crate::footing::Relief;
use crate::phases::Start;
use crate::rows::allowance;
use ballbot_base::lanes::{Lane, Value, Vec3, map3};
use ballbot_base::terrain::{Frame, Prism};

/// Slowest approach after which a part bounces, m/s.
const SLOWEST_BOUNCE: f64 = 0.01;

/// Largest speed of recovery from an overlap with an obstacle, m/s.
const FASTEST_RECOVERY: f64 = 0.1;

/// The plane tangent to a surface near a point of the robot.
pub struct Plane<L> {
    /// Outward normal and two tangents, inertial frame.
    pub axes: [Vec3<L>; 3],
    /// The axes in the principal frame.
    pub turned: [Vec3<L>; 3],
    /// Distance of the point, m, negative below the surface.
    pub height: L,
}

impl<L: Lane> Plane<L> {
    #[inline(always)]
    fn of_normal(start: &Start<L>, normal: Vec3<L>, height: L) -> Self {
        // The smallest rotation from z to the normal.
        let [x, y, _] = Frame::of_normal(normal).rotation.rows;
        let axes = [normal, x, y];
        let turned = map3(
            axes,
            #[inline(always)]
            |axis| start.rotation.apply_transposed(axis),
        );
        Self { axes, turned, height }
    }
}

/// What a part of the robot may touch.
pub trait Surface<L: Lane> {
    /// The plane near a point of the bot (principal frame, from the CoM).
    fn near_bot(&self, start: &Start<L>, point: Vec3<L>) -> Plane<L>;
}

/// The floor: a relief, or the plane z = 0.
pub struct Floor<'a, 'b, L: Lane>(pub Option<&'a Relief<'b, L>>);

impl<L: Lane> Surface<L> for Floor<'_, '_, L> {
    #[inline(always)]
    fn near_bot(&self, start: &Start<L>, point: Vec3<L>) -> Plane<L> {
        let rotation = &start.rotation;
        let Some(relief) = self.0 else {
            let (zero, one) = (point.x.zero(), point.x.splat(1.0));
            let [x, y, z] = rotation.rows;
            return Plane {
                axes: [Vec3::new(zero, zero, one), Vec3::new(one, zero, zero), Vec3::new(zero, one, zero)],
                turned: [z, x, y],
                height: start.pose.body.z + z.dot(point),
            };
        };
        let (height, normal) = relief.below(start.pose.body + rotation.apply(point));
        Plane::of_normal(start, normal, height)
    }
}

/// An obstacle.
pub struct Obstacle<'a, 'b, L: Lane> {
    pub prism: &'a Prism<L>,
    pub relief: &'a Relief<'b, L>,
}

impl<L: Lane> Obstacle<'_, '_, L> {
    /// A point of the bot (principal frame, from the CoM) in the inertial frame.
    #[inline(always)]
    pub fn place(&self, start: &Start<L>, point: Vec3<L>) -> Vec3<L> {
        self.relief.place(start.pose.body + start.rotation.apply(point))
    }

    /// The plane near a point of the frame of the step.
    #[inline(always)]
    pub fn near(&self, start: &Start<L>, point: Vec3<L>) -> Plane<L> {
        let (height, normal) = self.prism.distance(self.relief.place(point));
        Plane::of_normal(start, self.relief.in_frame(normal), height)
    }
}

impl<L: Lane> Surface<L> for Obstacle<'_, '_, L> {
    #[inline(always)]
    fn near_bot(&self, start: &Start<L>, point: Vec3<L>) -> Plane<L> {
        self.near(start, start.pose.body + start.rotation.apply(point))
    }
}

/// The least velocity along the normal at the end of a step, negated, of a contact with this `gap` and `speed` at its
/// start.
#[inline(always)]
pub fn required<L: Lane, V: Value<L>>(c: &Constants<V>, gap: L, speed: L, restitution: L) -> L {
    let closes = speed.mul_add(c.sim_dt.at(gap), gap).lt(gap.zero());
    let bounces = closes & speed.lt(gap.splat(-SLOWEST_BOUNCE)) & gap.zero().lt(restitution);
    // A robot that is wedged in, and is pushed out of an overlap, gains energy with this speed.
    let out = allowance(c, gap).max(gap.splat(-FASTEST_RECOVERY));
    L::select(bounces, speed * restitution, out)
}
