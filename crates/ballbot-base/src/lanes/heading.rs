//! The heading frame: a vertical z axis and the robot's yaw.

use super::{Lane, Quat};

/// Cosine and sine of the yaw.
#[derive(Clone, Copy, Debug)]
pub struct Heading<L> {
    /// Cosine of the yaw.
    pub cos: L,
    /// Sine of the yaw.
    pub sin: L,
}

impl<L: Lane> Heading<L> {
    /// Heading of a body with attitude `q`: the yaw is 2 atan2(z, w).
    #[inline(always)]
    pub fn new(q: Quat<L>) -> Self {
        let (ww, zz) = (q.w.squared(), q.v.z.squared());
        let norm = ww + zz;
        // The yaw is undefined upside down.
        let turned = norm.zero().lt(norm);
        let one = norm.splat(1.0);
        let inverse = one / L::select(turned, norm, one);
        let wz = q.w * q.v.z;
        Self { cos: L::select(turned, (ww - zz) * inverse, one), sin: (wz + wz) * inverse }
    }

    /// Components in the heading frame of a horizontal vector of the inertial frame.
    #[inline(always)]
    pub fn of(&self, x: L, y: L) -> [L; 2] {
        [self.cos.mul_add(x, self.sin * y), self.cos.mul_add(y, -(self.sin * x))]
    }

    /// Components in the inertial frame of a horizontal vector of the heading frame.
    #[inline(always)]
    pub fn to_inertial(&self, x: L, y: L) -> [L; 2] {
        [self.cos.mul_add(x, -(self.sin * y)), self.cos.mul_add(y, self.sin * x)]
    }
}
