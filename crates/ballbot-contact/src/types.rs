//! Value types of the solver: actions, pose, velocities, and one number per contact row.

use ballbot_base::lanes::{Lane, Quat, Vec3};

/// External actions on robots in a step.
pub struct Actions<T> {
    /// Torques of the motors, N·m.
    pub torques: [T; 3],
    /// Decrease of a velocity by gravity in a step, in the floor frame.
    pub gravity_dt: [T; 3],
}

impl Actions<f64> {
    /// Torques on level ground.
    pub fn level(gravity_dt: [f64; 3], torques: &[f64; 3]) -> Self {
        Self { torques: *torques, gravity_dt }
    }
}

/// Positions and attitudes of all parts.
pub struct Pose<L> {
    pub ball: Vec3<L>,
    pub ball_quaternion: Quat<L>,
    /// CoM of the body.
    pub body: Vec3<L>,
    pub body_quaternion: Quat<L>,
    pub wheel_angles: [L; 3],
}

/// Velocities of all moving parts; see [`super::state::ContactState`] for the frames.
#[derive(Clone, Copy)]
pub struct Velocities<L> {
    pub ball: Vec3<L>,
    pub ball_rate: Vec3<L>,
    pub body: Vec3<L>,
    pub body_rate: Vec3<L>,
    pub spins: [L; 3],
}

/// One number per row: an impulse or a residual velocity.
#[derive(Clone, Copy)]
pub struct PerRow<L> {
    /// Floor rows: normal, x, y.
    pub floor: [L; 3],
    pub normals: [L; 3],
    pub drives: [L; 3],
    pub joints: [L; 3],
}

impl<L: Copy> PerRow<L> {
    /// The numbers with `f` applied to each.
    #[inline(always)]
    pub fn map<U>(&self, f: impl Fn(L) -> U) -> PerRow<U> {
        let three = |[a, b, c]: [L; 3]| [f(a), f(b), f(c)];
        PerRow {
            floor: three(self.floor),
            normals: three(self.normals),
            drives: three(self.drives),
            joints: three(self.joints),
        }
    }
}

impl<L: Lane> PerRow<L> {
    /// Difference.
    #[inline(always)]
    pub fn minus(&self, other: &Self) -> Self {
        let less = |a: [L; 3], b: [L; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
        Self {
            floor: less(self.floor, other.floor),
            normals: less(self.normals, other.normals),
            drives: less(self.drives, other.drives),
            joints: less(self.joints, other.joints),
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
            normals: select3(mask, yes.normals, no.normals),
            drives: select3(mask, yes.drives, no.drives),
            joints: select3(mask, yes.joints, no.joints),
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
            spins: select3(mask, yes.spins, no.spins),
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
            spins: [self.spins[0] + 0.0, self.spins[1] + 0.0, self.spins[2] + 0.0],
        }
    }

    /// Sum of the squares of all speeds and rates.
    #[inline(always)]
    pub fn norm_squared(&self) -> L {
        let [a, b, c] = self.spins;
        self.ball.norm_squared()
            + self.ball_rate.norm_squared()
            + self.body.norm_squared()
            + self.body_rate.norm_squared()
            + Vec3::new(a, b, c).norm_squared()
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
            wheel_angles: select3(mask, yes.wheel_angles, no.wheel_angles),
        }
    }
}

/// Selection of `yes` where `mask` is true, of `no` elsewhere.
#[inline(always)]
pub fn select3<L: Lane>(mask: L::Mask, yes: [L; 3], no: [L; 3]) -> [L; 3] {
    [L::select(mask, yes[0], no[0]), L::select(mask, yes[1], no[1]), L::select(mask, yes[2], no[2])]
}
