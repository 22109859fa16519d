//! Value types of the solver: actions, pose, velocities, and one number per contact row.

use ballbot_base::lanes::{Lane, Quat, Vec3, lane_struct};
use ballbot_base::wheels::Wheels;

/// External actions on robots in a step.
pub struct Actions<T> {
    /// Torques of the motors, N·m.
    pub torques: Wheels<T>,
    /// Decrease of a velocity by gravity in a step, in the floor frame.
    pub gravity_dt: [T; 3],
    /// Decrease of the velocity of the ball by gravity and preload in a step, in the floor frame.
    pub ball_fall: [T; 3],
    /// Decrease of the velocity of the body's CoM.
    pub body_fall: [T; 3],
}

impl<T: Copy> Actions<T> {
    /// Torques and gravity, without preload.
    pub fn new(gravity_dt: [T; 3], torques: Wheels<T>) -> Self {
        Self { torques, gravity_dt, ball_fall: gravity_dt, body_fall: gravity_dt }
    }
}

lane_struct! {
    /// Positions and attitudes of all parts.
    pub struct Pose<T> {
        pub ball: Vec3<T>,
        pub ball_quaternion: Quat<T>,
        /// CoM of the body.
        pub body: Vec3<T>,
        pub body_quaternion: Quat<T>,
        pub wheel_angles: Wheels<T>,
    }
}

lane_struct! {
    /// Velocities of all moving parts; see [`super::state::ContactState`] for the frames.
    #[derive(Clone, Copy)]
    pub struct Velocities<T> {
        pub ball: Vec3<T>,
        pub ball_rate: Vec3<T>,
        pub body: Vec3<T>,
        pub body_rate: Vec3<T>,
        pub spins: Wheels<T>,
    }
}

lane_struct! {
    /// One number per row: an impulse or a residual velocity.
    #[derive(Clone, Copy)]
    pub struct PerRow<T> {
        /// Floor rows: normal, x, y.
        pub floor: [T; 3],
        pub normals: Wheels<T>,
        pub drives: Wheels<T>,
        pub joints: Wheels<T>,
    }
}

impl<L: Lane> PerRow<L> {
    /// Difference.
    #[inline(always)]
    pub fn minus(&self, other: &Self) -> Self {
        let mut out = *self;
        out.zip_mut(
            other,
            #[inline(always)]
            |out, other| *out -= *other,
        );
        out
    }
}

impl<L: Lane> Velocities<L> {
    /// Sum of the squares of all speeds and rates.
    #[inline(always)]
    pub fn norm_squared(&self) -> L {
        self.ball.norm_squared()
            + self.ball_rate.norm_squared()
            + self.body.norm_squared()
            + self.body_rate.norm_squared()
            + self.spins.dot(self.spins)
    }
}

/// A number with +0 in place of −0.
#[inline(always)]
pub fn with_positive_zero<L: Lane>(number: &L) -> L {
    *number + 0.0
}

/// Selection of `yes` where `mask` is true, of `no` elsewhere.
#[inline(always)]
pub fn select3<L: Lane>(mask: L::Mask, yes: [L; 3], no: [L; 3]) -> [L; 3] {
    [L::select(mask, yes[0], no[0]), L::select(mask, yes[1], no[1]), L::select(mask, yes[2], no[2])]
}
