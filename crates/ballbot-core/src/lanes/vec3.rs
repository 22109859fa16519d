//! Vectors and rotations of lanes.

use super::Lane;
use std::ops::{Add, AddAssign, Mul, Neg, Sub};

/// A vector of three.
#[derive(Clone, Copy, Debug)]
pub struct Vec3<L> {
    /// First component, and so on.
    pub x: L,
    pub y: L,
    pub z: L,
}

impl<L: Lane> Vec3<L> {
    /// From its components.
    #[inline(always)]
    pub fn new(x: L, y: L, z: L) -> Self {
        Self { x, y, z }
    }

    /// From three cells.
    #[inline(always)]
    pub fn load(token: L::Token, cells: &[L::Cell; 3]) -> Self {
        Self::new(L::load(token, &cells[0]), L::load(token, &cells[1]), L::load(token, &cells[2]))
    }

    /// From three cells that are not in one array.
    #[inline(always)]
    pub fn load_parts(token: L::Token, [x, y, z]: [&L::Cell; 3]) -> Self {
        Self::new(L::load(token, x), L::load(token, y), L::load(token, z))
    }

    /// Into three cells.
    #[inline(always)]
    pub fn store(self, cells: &mut [L::Cell; 3]) {
        self.x.store(&mut cells[0]);
        self.y.store(&mut cells[1]);
        self.z.store(&mut cells[2]);
    }

    /// The same vector for all robots, in the lanes of `like`.
    #[inline(always)]
    pub fn splat(like: L, values: &[f64; 3]) -> Self {
        Self::new(like.splat(values[0]), like.splat(values[1]), like.splat(values[2]))
    }

    /// `yes` where `mask` is true, `no` elsewhere.
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

    /// Component by component.
    #[inline(always)]
    pub fn scaled_by(self, factors: &[f64; 3]) -> Self {
        Self::new(self.x * factors[0], self.y * factors[1], self.z * factors[2])
    }

    /// self + direction · amount.
    #[inline(always)]
    pub fn plus(self, direction: Self, amount: L) -> Self {
        Self::new(
            direction.x.mul_add(amount, self.x),
            direction.y.mul_add(amount, self.y),
            direction.z.mul_add(amount, self.z),
        )
    }

    /// self + direction · amount, the amount being that of all robots.
    #[inline(always)]
    pub fn plus_all(self, direction: Self, amount: f64) -> Self {
        self.plus(direction, self.x.splat(amount))
    }

    /// Its squared length.
    #[inline(always)]
    pub fn norm_squared(self) -> L {
        self.dot(self)
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
#[derive(Clone, Copy, Debug)]
pub struct Quat<L> {
    /// Scalar part.
    pub w: L,
    /// Vector part.
    pub v: Vec3<L>,
}

impl<L: Lane> Quat<L> {
    /// From `[w, x, y, z]`.
    #[inline(always)]
    pub fn load(token: L::Token, cells: &[L::Cell; 4]) -> Self {
        let [w, x, y, z] = cells;
        Self { w: L::load(token, w), v: Vec3::new(L::load(token, x), L::load(token, y), L::load(token, z)) }
    }

    /// Into `[w, x, y, z]`.
    #[inline(always)]
    pub fn store(self, cells: &mut [L::Cell; 4]) {
        let [w, x, y, z] = cells;
        self.w.store(w);
        self.v.x.store(x);
        self.v.y.store(y);
        self.v.z.store(z);
    }

    /// `yes` where `mask` is true, `no` elsewhere.
    #[inline(always)]
    pub fn select(mask: L::Mask, yes: Self, no: Self) -> Self {
        Self { w: L::select(mask, yes.w, no.w), v: Vec3::select(mask, yes.v, no.v) }
    }

    #[inline(always)]
    fn times(self, other: Self) -> Self {
        Self {
            w: self.w.mul_add(other.w, -self.v.dot(other.v)),
            v: self.v.cross(other.v).plus(other.v, self.w).plus(self.v, other.w),
        }
    }

    /// Turned by `half` · 2 in its own frame: right multiplication by the rotation whose vector is twice `half`, rad.
    #[inline(always)]
    pub fn turned_in_own_frame(self, half: Vec3<L>) -> Self {
        self.times(step_rotation(half)).normalized()
    }

    /// Turned by the rotation vector 2 · `half` of the frame that it maps to, rad.
    #[inline(always)]
    pub fn turned(self, half: Vec3<L>) -> Self {
        step_rotation(half).times(self).normalized()
    }

    #[inline(always)]
    fn normalized(self) -> Self {
        let inverse = self.w.splat(1.0) / self.w.mul_add(self.w, self.v.norm_squared()).sqrt();
        Self { w: self.w * inverse, v: self.v * inverse }
    }

    /// As a matrix.
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
/// tangent is exact to rounding for steps up to 0.1 rad; far beyond, the step turns too little but in the right sense.
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
    /// Its rows.
    pub rows: [Vec3<L>; 3],
}

impl<L: Lane> Rotation<L> {
    /// The vector turned.
    #[inline(always)]
    pub fn apply(&self, v: Vec3<L>) -> Vec3<L> {
        Vec3::new(self.rows[0].dot(v), self.rows[1].dot(v), self.rows[2].dot(v))
    }

    /// The vector turned back.
    #[inline(always)]
    pub fn apply_transposed(&self, v: Vec3<L>) -> Vec3<L> {
        (self.rows[0] * v.x).plus(self.rows[1], v.y).plus(self.rows[2], v.z)
    }
}
