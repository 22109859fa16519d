//! Matrices of three rows and columns.

use super::{Lane, Vec3};

/// A 3 × 3 matrix by rows.
#[derive(Clone, Copy, Debug)]
pub struct Mat3<L> {
    /// Rows.
    pub rows: [Vec3<L>; 3],
}

impl<L: Lane> Mat3<L> {
    /// Matrix of three rows.
    #[inline(always)]
    pub fn new(a: Vec3<L>, b: Vec3<L>, c: Vec3<L>) -> Self {
        Self { rows: [a, b, c] }
    }

    /// Transposed matrix.
    #[inline(always)]
    fn transposed(&self) -> Self {
        let [a, b, c] = self.rows;
        Self::new(Vec3::new(a.x, b.x, c.x), Vec3::new(a.y, b.y, c.y), Vec3::new(a.z, b.z, c.z))
    }

    /// Product with a column vector.
    #[inline(always)]
    pub fn times(&self, v: Vec3<L>) -> Vec3<L> {
        let [a, b, c] = self.rows;
        Vec3::new(a.dot(v), b.dot(v), c.dot(v))
    }

    /// Difference self − column · row.
    #[inline(always)]
    pub fn minus_outer(&self, column: Vec3<L>, row: Vec3<L>) -> Self {
        let [a, b, c] = self.rows;
        Self::new(a.plus(row, -column.x), b.plus(row, -column.y), c.plus(row, -column.z))
    }

    /// Inverse by cofactors; not finite for a singular matrix.
    #[inline(always)]
    pub fn inverse(&self) -> Self {
        let [a, b, c] = self.rows;
        let (p, q, r) = (b.cross(c), c.cross(a), a.cross(b));
        let determinant = a.dot(p);
        let scale = determinant.splat(1.0) / determinant;
        Self::new(p * scale, q * scale, r * scale).transposed()
    }
}

impl<L: Lane> From<[[L; 3]; 3]> for Mat3<L> {
    #[inline(always)]
    fn from([a, b, c]: [[L; 3]; 3]) -> Self {
        Self::new(a.into(), b.into(), c.into())
    }
}
