//! The frame of the ground under a ball: its z axis is the ground's normal.

use crate::lanes::{Lane, Quat, Rotation, Vec3};

/// The smallest rotation from the inertial frame to the ground frame that takes the normal to z.
#[derive(Clone, Copy, Debug)]
pub struct Frame<L> {
    /// Upward unit normal of the ground, inertial frame.
    pub normal: Vec3<L>,
    /// From the inertial frame to the ground frame.
    pub rotation: Rotation<L>,
}

impl<L: Lane> Frame<L> {
    /// The frame of ground with a given gradient of its height.
    #[inline(always)]
    pub fn of_gradient([gx, gy]: [L; 2]) -> Self {
        let one = gx.splat(1.0);
        let up = one / gx.mul_add(gx, gy.mul_add(gy, one)).sqrt();
        Self::of_normal(Vec3::new(-gx * up, -gy * up, up))
    }

    /// The frame of ground with this upward normal.
    #[inline(always)]
    pub fn of_normal(normal: Vec3<L>) -> Self {
        let Vec3 { x, y, z } = normal;
        let one = x.splat(1.0);
        let share = one / (z + 1.0);
        let mixed = -(x * y * share);
        let rows = [
            Vec3::new((x * x).neg_mul_add(share, one), mixed, -x),
            Vec3::new(mixed, (y * y).neg_mul_add(share, one), -y),
            normal,
        ];
        Self { normal, rotation: Rotation { rows } }
    }

    /// The rotation as a quaternion.
    #[inline(always)]
    pub fn quaternion(&self) -> Quat<L> {
        let Vec3 { x, y, z } = self.normal;
        let twice = (z + 1.0) * 2.0;
        let inverse = x.splat(1.0) / twice.sqrt();
        Quat { w: (z + 1.0) * inverse, v: Vec3::new(y * inverse, -x * inverse, x.zero()) }
    }
}
