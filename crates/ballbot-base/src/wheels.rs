//! Quantities with one value per wheel, which are not vectors (x, y, z), although both have three numbers.

use crate::lanes::Lane;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use std::array;
use std::ops::{Add, Div, Index, IndexMut, Mul, Neg, Sub};
use std::slice;

/// Number of wheels.
pub const WHEELS: usize = 3;

/// One value per wheel, in the order of the wheels.
///
/// It does not convert to a vector (x, y, z):
///
/// ```compile_fail,E0277
/// use ballbot_base::lanes::Vec3;
/// use ballbot_base::wheels::Wheels;
///
/// let torque_on_body: Vec3<f64> = Wheels([0.1, -0.2, 0.1]).into();
/// ```
///
/// The geometry of the wheels, [`Omniwheels`](crate::kinematics::Omniwheels), is between the two:
///
/// ```
/// use ballbot_base::kinematics::Omniwheels;
/// use ballbot_base::params::Params;
/// use ballbot_base::wheels::Wheels;
///
/// let torques = Wheels([0.1, -0.2, 0.1]);
/// let virtual_torques = Omniwheels::new(&Params::paper()).virtual_torques(torques);
/// assert!(virtual_torques.z.abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Wheels<T>(pub [T; WHEELS]);

/// A matrix by rows, whose rows and columns both belong to wheels.
pub type WheelMatrix<T> = Wheels<Wheels<T>>;

impl<T> Wheels<T> {
    /// Values computed from the index of the wheel.
    #[inline(always)]
    pub fn from_fn(mut f: impl FnMut(usize) -> T) -> Self {
        Self([f(0), f(1), f(2)])
    }

    /// Applies a function to the value of each wheel.
    #[inline(always)]
    pub fn map<U>(self, mut f: impl FnMut(T) -> U) -> Wheels<U> {
        let [a, b, c] = self.0;
        Wheels([f(a), f(b), f(c)])
    }

    /// Pairs of the values of each wheel.
    #[inline(always)]
    pub fn zip<U>(self, other: Wheels<U>) -> Wheels<(T, U)> {
        let ([a, b, c], [p, q, r]) = (self.0, other.0);
        Wheels([(a, p), (b, q), (c, r)])
    }

    /// The values in the order of the wheels.
    #[inline(always)]
    pub fn iter(&self) -> slice::Iter<'_, T> {
        self.0.iter()
    }

    /// The values in the order of the wheels, mutable.
    #[inline(always)]
    pub fn iter_mut(&mut self) -> slice::IterMut<'_, T> {
        self.0.iter_mut()
    }

    /// The values as a slice.
    #[inline(always)]
    pub fn as_slice(&self) -> &[T] {
        &self.0
    }
}

impl<T: Copy> Wheels<T> {
    /// The same value for all wheels.
    #[inline(always)]
    pub const fn all(value: T) -> Self {
        Self([value; WHEELS])
    }
}

impl Wheels<f64> {
    /// The values as a column, for products with matrices.
    #[inline(always)]
    pub fn column(self) -> Vector3<f64> {
        self.0.into()
    }

    /// The values in a column whose rows belong to wheels.
    #[inline(always)]
    pub fn of_column(column: Vector3<f64>) -> Self {
        Self(column.into())
    }
}

impl Wheels<Vector3<f64>> {
    /// The vectors as the rows of a matrix.
    pub fn rows(self) -> Matrix3<f64> {
        Matrix3::from_columns(&self.0).transpose()
    }
}

impl<L: Lane> Wheels<L> {
    /// Loads a number per wheel.
    #[inline(always)]
    pub fn load(token: L::Token, Wheels([a, b, c]): &Wheels<L::Cell>) -> Self {
        Self([L::load(token, a), L::load(token, b), L::load(token, c)])
    }

    /// Stores a number per wheel.
    #[inline(always)]
    pub fn store(self, cells: &mut Wheels<L::Cell>) {
        self[0].store(&mut cells[0]);
        self[1].store(&mut cells[1]);
        self[2].store(&mut cells[2]);
    }

    /// Zero for all wheels, in the lanes of `like`.
    #[inline(always)]
    pub fn zero(like: L) -> Self {
        Self([like.zero(); WHEELS])
    }

    /// Selection of `yes` where `mask` is true, of `no` elsewhere.
    #[inline(always)]
    pub fn select(mask: L::Mask, Self(yes): Self, Self(no): Self) -> Self {
        Self([L::select(mask, yes[0], no[0]), L::select(mask, yes[1], no[1]), L::select(mask, yes[2], no[2])])
    }

    /// Sum of the products of each wheel.
    #[inline(always)]
    pub fn dot(self, other: Self) -> L {
        self[2].mul_add(other[2], self[1].mul_add(other[1], self[0] * other[0]))
    }

    /// Sum self + direction · amount.
    #[inline(always)]
    pub fn plus(self, direction: Self, amount: L) -> Self {
        Self([
            direction[0].mul_add(amount, self[0]),
            direction[1].mul_add(amount, self[1]),
            direction[2].mul_add(amount, self[2]),
        ])
    }

    /// Cofactors of the row of a matrix whose other rows are `self` and `other`.
    #[inline(always)]
    fn cofactors(self, other: Self) -> Self {
        Self([
            self[1].mul_add(other[2], -(self[2] * other[1])),
            self[2].mul_add(other[0], -(self[0] * other[2])),
            self[0].mul_add(other[1], -(self[1] * other[0])),
        ])
    }
}

impl<L: Lane> WheelMatrix<L> {
    /// Transposed matrix.
    #[inline(always)]
    pub fn transposed(&self) -> Self {
        let [a, b, c] = self.0;
        Self([Wheels([a[0], b[0], c[0]]), Wheels([a[1], b[1], c[1]]), Wheels([a[2], b[2], c[2]])])
    }

    /// Product with a column.
    #[inline(always)]
    pub fn times(&self, column: Wheels<L>) -> Wheels<L> {
        let [a, b, c] = self.0;
        Wheels([a.dot(column), b.dot(column), c.dot(column)])
    }

    /// Product with a matrix.
    #[inline(always)]
    pub fn times_matrix(&self, other: &Self) -> Self {
        let [a, b, c] = self.0;
        Self([other.combined(a), other.combined(b), other.combined(c)])
    }

    /// Sum of the rows with factors: the row `factors` times the matrix.
    #[inline(always)]
    fn combined(&self, factors: Wheels<L>) -> Wheels<L> {
        let [a, b, c] = self.0;
        (a * factors[0]).plus(b, factors[1]).plus(c, factors[2])
    }

    /// The rows times factors.
    #[inline(always)]
    pub fn scaled(&self, factors: Wheels<L>) -> Self {
        let [a, b, c] = self.0;
        Self([a * factors[0], b * factors[1], c * factors[2]])
    }

    /// Difference self − column · row.
    #[inline(always)]
    pub fn minus_outer(&self, column: Wheels<L>, row: Wheels<L>) -> Self {
        let [a, b, c] = self.0;
        Self([a.plus(row, -column[0]), b.plus(row, -column[1]), c.plus(row, -column[2])])
    }

    /// Difference of two matrices.
    #[inline(always)]
    pub fn minus(&self, other: &Self) -> Self {
        let ([a, b, c], [d, e, f]) = (self.0, other.0);
        Self([a - d, b - e, c - f])
    }

    /// Inverse by cofactors; not finite for a singular matrix.
    #[inline(always)]
    pub fn inverse(&self) -> Self {
        let [a, b, c] = self.0;
        let (p, q, r) = (b.cofactors(c), c.cofactors(a), a.cofactors(b));
        let determinant = a.dot(p);
        let scale = determinant.splat(1.0) / determinant;
        Self([p * scale, q * scale, r * scale]).transposed()
    }
}

impl<T> From<[T; WHEELS]> for Wheels<T> {
    #[inline(always)]
    fn from(values: [T; WHEELS]) -> Self {
        Self(values)
    }
}

impl<T> Index<usize> for Wheels<T> {
    type Output = T;
    #[inline(always)]
    fn index(&self, wheel: usize) -> &T {
        &self.0[wheel]
    }
}

impl<T> IndexMut<usize> for Wheels<T> {
    #[inline(always)]
    fn index_mut(&mut self, wheel: usize) -> &mut T {
        &mut self.0[wheel]
    }
}

impl<T> IntoIterator for Wheels<T> {
    type Item = T;
    type IntoIter = array::IntoIter<T, WHEELS>;
    #[inline(always)]
    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}

impl<'a, T> IntoIterator for &'a Wheels<T> {
    type Item = &'a T;
    type IntoIter = slice::Iter<'a, T>;
    #[inline(always)]
    fn into_iter(self) -> Self::IntoIter {
        self.0.iter()
    }
}

impl<'a, T> IntoIterator for &'a mut Wheels<T> {
    type Item = &'a mut T;
    type IntoIter = slice::IterMut<'a, T>;
    #[inline(always)]
    fn into_iter(self) -> Self::IntoIter {
        self.0.iter_mut()
    }
}

impl<L: Lane> Add for Wheels<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self([self[0] + other[0], self[1] + other[1], self[2] + other[2]])
    }
}

impl<L: Lane> Sub for Wheels<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self([self[0] - other[0], self[1] - other[1], self[2] - other[2]])
    }
}

impl<L: Lane> Neg for Wheels<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self([-self[0], -self[1], -self[2]])
    }
}

impl<L: Lane> Mul<L> for Wheels<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: L) -> Self {
        Self([self[0] * factor, self[1] * factor, self[2] * factor])
    }
}

impl<L: Lane> Div<L> for Wheels<L> {
    type Output = Self;
    #[inline(always)]
    fn div(self, divisor: L) -> Self {
        Self([self[0] / divisor, self[1] / divisor, self[2] / divisor])
    }
}
