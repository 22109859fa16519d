//! Bounds of friction in a step: of wheels, floor and wheel joints.

use super::constants::Constants;
use super::rows::Rows;
use super::types::Velocities;
use ballbot_base::friction::stribeck;
use ballbot_base::lanes::{Lane, Value, lane_struct};
use ballbot_base::wheels::{WHEELS, Wheels};

lane_struct! {
    /// Friction coefficients in this step.
    #[derive(Clone, Copy)]
    pub struct Friction<T> {
        pub wheels: Wheels<T>,
        pub floor: T,
    }
}

impl<L: Lane> Friction<L> {
    /// Friction coefficients at the present slip.
    #[inline(always)]
    pub fn new<V: Value<L>>(c: &Constants<V>, rows: &Rows<L>, v: &Velocities<L>) -> Self {
        let like = v.ball.x;
        let (wheel_static, wheel_dynamic) = (c.wheel_static_friction.at(like), c.wheel_dynamic_friction.at(like));
        let (floor_static, floor_dynamic) = (c.floor_static_friction.at(like), c.floor_dynamic_friction.at(like));
        let mut out = Self { wheels: Wheels::all(wheel_dynamic), floor: floor_dynamic };
        let scale = c.critical_velocity_inverse_squared.at(like);
        // Where static and dynamic coefficients are equal, the law gives exactly this value, so those lanes keep their
        // bits.
        if L::any(wheel_dynamic.lt(wheel_static)) {
            for i in 0..WHEELS {
                let slip = rows.slip_speed(c, v, i).squared() * scale;
                out.wheels[i] = stribeck(wheel_static, wheel_dynamic, slip);
            }
        }
        if L::any(floor_dynamic.lt(floor_static)) {
            let [x, y] = rows.floor_slip(c, v);
            let slip = x.mul_add(x, y.squared()) * scale;
            out.floor = stribeck(floor_static, floor_dynamic, slip);
        }
        out
    }
}

lane_struct! {
    /// Joint friction over one step.
    #[derive(Clone, Copy)]
    pub struct JointFriction<T> {
        /// Largest angular impulse of dry friction, N·m·s.
        pub dry: T,
        /// Angular impulse of viscous friction per rad/s, N·m·s².
        pub viscous: T,
    }
}

impl<L: Lane> JointFriction<L> {
    #[inline(always)]
    pub fn new<V: Value<L>>(c: &Constants<V>, like: L) -> Self {
        Self { dry: c.joint_dry_impulse.at(like), viscous: c.joint_viscous_impulse.at(like) }
    }

    /// Whether any robot has joint friction.
    #[inline(always)]
    pub fn any(&self) -> bool {
        let zero = self.dry.zero();
        L::any(zero.lt(self.dry) | zero.lt(self.viscous))
    }
}

/// Radial projection of a pair on the disc of radius `limit`.
#[inline(always)]
pub fn in_disc<L: Lane>([x, y]: [L; 2], limit: L) -> [L; 2] {
    let squared = x.mul_add(x, y.squared());
    let outside = limit.squared().lt(squared);
    // The branch skips a root and a division; slip on the floor is rare, and lanes inside keep their bits either way.
    if !L::any(outside) {
        return [x, y];
    }
    let scale = L::select(outside, limit / squared.sqrt(), limit.splat(1.0));
    [x * scale, y * scale]
}
