//! Value types of the solver: actions, pose, velocities, and one number per contact row.

use ballbot_base::lanes::{Lane, Quat, Vec3};
use ballbot_base::wheels::Wheels;

/// External actions on robots in a step.
pub struct Actions<T> {
    /// Torques of the motors, N·m.
    pub torques: Wheels<T>,
    /// Decrease of a velocity by gravity in a step, in the floor frame.
    pub gravity_dt: [T; 3],
}

impl Actions<f64> {
    /// Torques on level ground.
    pub fn level(gravity_dt: [f64; 3], torques: Wheels<f64>) -> Self {
        Self { torques, gravity_dt }
    }
}

/// Positions and attitudes of all parts.
pub struct Pose<L> {
    pub ball: Vec3<L>,
    pub ball_quaternion: Quat<L>,
    /// CoM of the body.
    pub body: Vec3<L>,
    pub body_quaternion: Quat<L>,
    pub wheel_angles: Wheels<L>,
}

/// Velocities of all moving parts; see [`super::state::ContactState`] for the frames.
#[derive(Clone, Copy)]
pub struct Velocities<L> {
    pub ball: Vec3<L>,
    pub ball_rate: Vec3<L>,
    pub body: Vec3<L>,
    pub body_rate: Vec3<L>,
    pub spins: Wheels<L>,
}

/// One number per row: an impulse or a residual velocity.
#[derive(Clone, Copy)]
pub struct PerRow<L> {
    /// Floor rows: normal, x, y.
    pub floor: [L; 3],
    pub normals: Wheels<L>,
    pub drives: Wheels<L>,
    pub joints: Wheels<L>,
}

impl<L: Copy> PerRow<L> {
    /// The numbers with `f` applied to each.
    #[inline(always)]
    pub fn map<U>(&self, f: impl Fn(L) -> U) -> PerRow<U> {
        let [z, x, y] = self.floor;
        PerRow {
            floor: [f(z), f(x), f(y)],
            normals: self.normals.map(&f),
            drives: self.drives.map(&f),
            joints: self.joints.map(&f),
        }
    }
}

impl<L: Lane> PerRow<L> {
    /// Difference.
    #[inline(always)]
    pub fn minus(&self, other: &Self) -> Self {
        let (a, b) = (self.floor, other.floor);
        Self {
            floor: [a[0] - b[0], a[1] - b[1], a[2] - b[2]],
            normals: self.normals - other.normals,
            drives: self.drives - other.drives,
            joints: self.joints - other.joints,
        }
    }

    /// The numbers with +0 in place of −0.
    #[inline(always)]
    pub fn with_positive_zeros(&self) -> Self {
        self.map(
            #[inline(always)]
            |value| value + 0.0,
        )
    }

    /// Selection of `yes` where `mask` is true, of `no` elsewhere.
    #[inline(always)]
    pub fn select(mask: L::Mask, yes: &Self, no: &Self) -> Self {
        Self {
            floor: select3(mask, yes.floor, no.floor),
            normals: Wheels::select(mask, yes.normals, no.normals),
            drives: Wheels::select(mask, yes.drives, no.drives),
            joints: Wheels::select(mask, yes.joints, no.joints),
        }
    }
}

impl<L: Lane> Velocities<L> {
    /// Selection of `yes` where `mask` is true, of `no` elsewhere.
    #[inline(always)]
    pub fn select(mask: L::Mask, yes: &Self, no: &Self) -> Self {
        Self {
            ball: Vec3::select(mask, yes.ball, no.ball),
            ball_rate: Vec3::select(mask, yes.ball_rate, no.ball_rate),
            body: Vec3::select(mask, yes.body, no.body),
            body_rate: Vec3::select(mask, yes.body_rate, no.body_rate),
            spins: Wheels::select(mask, yes.spins, no.spins),
        }
    }

    /// The numbers with +0 in place of −0.
    #[inline(always)]
    pub fn with_positive_zeros(&self) -> Self {
        let zeros = Vec3::zero(self.ball.x);
        Self {
            ball: self.ball + zeros,
            ball_rate: self.ball_rate + zeros,
            body: self.body + zeros,
            body_rate: self.body_rate + zeros,
            spins: self.spins.map(
                #[inline(always)]
                |spin| spin + 0.0,
            ),
        }
    }

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

impl<L: Lane> Pose<L> {
    /// Selection of `yes` where `mask` is true, of `no` elsewhere.
    #[inline(always)]
    pub fn select(mask: L::Mask, yes: &Self, no: &Self) -> Self {
        Self {
            ball: Vec3::select(mask, yes.ball, no.ball),
            ball_quaternion: Quat::select(mask, yes.ball_quaternion, no.ball_quaternion),
            body: Vec3::select(mask, yes.body, no.body),
            body_quaternion: Quat::select(mask, yes.body_quaternion, no.body_quaternion),
            wheel_angles: Wheels::select(mask, yes.wheel_angles, no.wheel_angles),
        }
    }
}

/// Selection of `yes` where `mask` is true, of `no` elsewhere.
#[inline(always)]
pub fn select3<L: Lane>(mask: L::Mask, yes: [L; 3], no: [L; 3]) -> [L; 3] {
    [L::select(mask, yes[0], no[0]), L::select(mask, yes[1], no[1]), L::select(mask, yes[2], no[2])]
}
