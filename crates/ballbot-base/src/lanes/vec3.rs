//! Vectors, quaternions and rotation matrices of lanes.

use super::{Lane, atan2_positive};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};
use std::ops::{Add, AddAssign, Mul, Neg, Sub};

/// A vector of three components.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Vec3<L> {
    /// First component.
    pub x: L,
    /// Second component.
    pub y: L,
    /// Third component.
    pub z: L,
}

impl<L: Lane> Vec3<L> {
    /// Vector of three components.
    #[inline(always)]
    pub fn new(x: L, y: L, z: L) -> Self {
        Self { x, y, z }
    }

    /// Loads three cells.
    #[inline(always)]
    pub fn load(token: L::Token, cells: &[L::Cell; 3]) -> Self {
        Self::new(L::load(token, &cells[0]), L::load(token, &cells[1]), L::load(token, &cells[2]))
    }

    /// Loads three cells that are not in an array.
    #[inline(always)]
    pub fn load_parts(token: L::Token, [x, y, z]: [&L::Cell; 3]) -> Self {
        Self::new(L::load(token, x), L::load(token, y), L::load(token, z))
    }

    /// Stores three cells.
    #[inline(always)]
    pub fn store(self, cells: &mut [L::Cell; 3]) {
        self.x.store(&mut cells[0]);
        self.y.store(&mut cells[1]);
        self.z.store(&mut cells[2]);
    }

    /// Zero, in the lanes of `like`.
    #[inline(always)]
    pub fn zero(like: L) -> Self {
        Self::new(like.zero(), like.zero(), like.zero())
    }

    /// Selection of `yes` where `mask` is true, of `no` elsewhere.
    #[inline(always)]
    pub fn select(mask: L::Mask, yes: Self, no: Self) -> Self {
        Self::new(L::select(mask, yes.x, no.x), L::select(mask, yes.y, no.y), L::select(mask, yes.z, no.z))
    }

    /// Scalar product.
    #[inline(always)]
    pub fn dot(self, other: Self) -> L {
        self.z.mul_add(other.z, self.y.mul_add(other.y, self.x * other.x))
    }

    /// Vector product.
    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        Self::new(
            self.y.mul_add(other.z, -(self.z * other.y)),
            self.z.mul_add(other.x, -(self.x * other.z)),
            self.x.mul_add(other.y, -(self.y * other.x)),
        )
    }

    /// Componentwise product.
    #[inline(always)]
    pub fn scaled_by(self, [x, y, z]: [L; 3]) -> Self {
        Self::new(self.x * x, self.y * y, self.z * z)
    }

    /// Sum self + direction · amount.
    #[inline(always)]
    pub fn plus(self, direction: Self, amount: L) -> Self {
        Self::new(
            direction.x.mul_add(amount, self.x),
            direction.y.mul_add(amount, self.y),
            direction.z.mul_add(amount, self.z),
        )
    }

    /// Squared length.
    #[inline(always)]
    pub fn norm_squared(self) -> L {
        self.dot(self)
    }
}

impl<L> From<[L; 3]> for Vec3<L> {
    #[inline(always)]
    fn from([x, y, z]: [L; 3]) -> Self {
        Self { x, y, z }
    }
}

impl<L> From<Vec3<L>> for [L; 3] {
    #[inline(always)]
    fn from(v: Vec3<L>) -> Self {
        [v.x, v.y, v.z]
    }
}

impl<L: Lane> Add for Vec3<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self::new(self.x + other.x, self.y + other.y, self.z + other.z)
    }
}

impl<L: Lane> AddAssign for Vec3<L> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<L: Lane> Sub for Vec3<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self::new(self.x - other.x, self.y - other.y, self.z - other.z)
    }
}

impl<L: Lane> Neg for Vec3<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self::new(-self.x, -self.y, -self.z)
    }
}

impl<L: Lane> Mul<L> for Vec3<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: L) -> Self {
        Self::new(self.x * factor, self.y * factor, self.z * factor)
    }
}

/// A unit quaternion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quat<L> {
    /// Scalar part.
    pub w: L,
    /// Vector part.
    pub v: Vec3<L>,
}

impl<L: Lane> Quat<L> {
    /// Loads `[w, x, y, z]`.
    #[inline(always)]
    pub fn load(token: L::Token, cells: &[L::Cell; 4]) -> Self {
        let [w, x, y, z] = cells;
        Self { w: L::load(token, w), v: Vec3::new(L::load(token, x), L::load(token, y), L::load(token, z)) }
    }

    /// Stores `[w, x, y, z]`.
    #[inline(always)]
    pub fn store(self, cells: &mut [L::Cell; 4]) {
        let [w, x, y, z] = cells;
        self.w.store(w);
        self.v.x.store(x);
        self.v.y.store(y);
        self.v.z.store(z);
    }

    /// Selection of `yes` where `mask` is true, of `no` elsewhere.
    #[inline(always)]
    pub fn select(mask: L::Mask, yes: Self, no: Self) -> Self {
        Self { w: L::select(mask, yes.w, no.w), v: Vec3::select(mask, yes.v, no.v) }
    }

    /// Heading of a body with this attitude, rad, in (−π, π]: the rotation about the vertical that remains once the
    /// tilt is undone, 2 atan2(z, w).
    #[inline(always)]
    pub fn yaw(self) -> L {
        // A quaternion and its negative are the same attitude; the one with z >= 0 is used.
        let zero = self.w.zero();
        let negative = self.v.z.lt(zero);
        let (w, z) = (L::select(negative, -self.w, self.w), self.v.z.abs());
        let yaw = atan2_positive(z, w) * 2.0;
        L::select(yaw.le(zero.splat(PI)), yaw, yaw - TAU)
    }

    /// Components of the tilt about the inertial x and y axes, rad: the rotation vector that takes the vertical to the
    /// body's z axis. Upside down, the rotation is about x.
    #[inline(always)]
    pub fn tilt_components(self) -> [L; 2] {
        let rows = self.rotation().rows;
        let (x, y, z) = (rows[0].z, rows[1].z, rows[2].z);
        let zero = x.zero();
        let one = x.splat(1.0);
        let sine = x.mul_add(x, y.squared()).sqrt();
        let tilt = atan2_positive(sine, z);
        let tilted = zero.lt(sine);
        let ratio = tilt / L::select(tilted, sine, one);
        [L::select(tilted, -(y * ratio), tilt), L::select(tilted, x * ratio, zero)]
    }

    /// Product: the rotation `other`, then this one.
    #[inline(always)]
    pub fn times(self, other: Self) -> Self {
        Self {
            w: self.w.mul_add(other.w, -self.v.dot(other.v)),
            v: self.v.cross(other.v).plus(other.v, self.w).plus(self.v, other.w),
        }
    }

    /// The inverse rotation.
    #[inline(always)]
    pub fn conjugated(self) -> Self {
        Self { w: self.w, v: -self.v }
    }

    /// Rotated in its own frame by the rotation vector 2 · `half`, rad: multiplication from the right.
    #[inline(always)]
    pub fn turned_in_own_frame(self, half: Vec3<L>) -> Self {
        self.times(step_rotation(half)).normalized()
    }

    /// Rotated by the rotation vector 2 · `half` in the frame that the quaternion maps to, rad.
    #[inline(always)]
    pub fn turned(self, half: Vec3<L>) -> Self {
        step_rotation(half).times(self).normalized()
    }

    /// The rotation halfway to another rotation, along the shorter way.
    #[inline(always)]
    pub fn halfway(self, other: Self) -> Self {
        let product = self.w.mul_add(other.w, self.v.dot(other.v));
        let opposite = product.lt(product.zero());
        let (w, v) = (L::select(opposite, -other.w, other.w), Vec3::select(opposite, -other.v, other.v));
        Self { w: self.w + w, v: self.v + v }.normalized()
    }

    #[inline(always)]
    fn normalized(self) -> Self {
        let inverse = self.w.splat(1.0) / self.w.mul_add(self.w, self.v.norm_squared()).sqrt();
        Self { w: self.w * inverse, v: self.v * inverse }
    }

    /// Rotation matrix.
    #[inline(always)]
    pub fn rotation(self) -> Rotation<L> {
        let (w, v) = (self.w, self.v);
        let (dx, dy, dz) = (v.x + v.x, v.y + v.y, v.z + v.z);
        let one = w.splat(1.0);
        let (xx, yy, zz) = (v.x * dx, v.y * dy, v.z * dz);
        let (wx, wy, wz) = (w * dx, w * dy, w * dz);
        let (xy, xz, yz) = (v.x * dy, v.x * dz, v.y * dz);
        Rotation {
            rows: [
                Vec3::new(one - (yy + zz), xy - wz, xz + wy),
                Vec3::new(xy + wz, one - (xx + zz), yz - wx),
                Vec3::new(xz - wy, yz + wx, one - (xx + yy)),
            ],
        }
    }
}

/// A quaternion, not of unit length, of the rotation vector 2 · `half`: (1, half · tan|half|/|half|). The series of the
/// tangent is exact to rounding for steps up to 0.1 rad; for much larger steps, the angle is too small but has the
/// right sign.
#[inline(always)]
fn step_rotation<L: Lane>(half: Vec3<L>) -> Quat<L> {
    let squared = half.norm_squared();
    let one = squared.splat(1.0);
    let mut series = squared.splat(1382.0 / 155_925.0);
    for coefficient in [62.0 / 2835.0, 17.0 / 315.0, 2.0 / 15.0, 1.0 / 3.0] {
        series = series.mul_add(squared, squared.splat(coefficient));
    }
    Quat { w: one, v: half * series.mul_add(squared, one) }
}

/// A rotation matrix.
#[derive(Clone, Copy, Debug)]
pub struct Rotation<L> {
    /// Rows of the matrix.
    pub rows: [Vec3<L>; 3],
}

impl<L: Lane> Rotation<L> {
    /// Rotated vector.
    #[inline(always)]
    pub fn apply(&self, v: Vec3<L>) -> Vec3<L> {
        Vec3::new(self.rows[0].dot(v), self.rows[1].dot(v), self.rows[2].dot(v))
    }

    /// The inverse.
    #[inline(always)]
    pub fn transposed(&self) -> Self {
        let [a, b, c] = self.rows;
        Self { rows: [Vec3::new(a.x, b.x, c.x), Vec3::new(a.y, b.y, c.y), Vec3::new(a.z, b.z, c.z)] }
    }

    /// Vector rotated by the inverse.
    #[inline(always)]
    pub fn apply_transposed(&self, v: Vec3<L>) -> Vec3<L> {
        (self.rows[0] * v.x).plus(self.rows[1], v.y).plus(self.rows[2], v.z)
    }
}
