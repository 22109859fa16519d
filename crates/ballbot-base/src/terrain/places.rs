//! A spline at several places of one robot at once: the points of a scan, or the rays of a picture.
//!
//! Weights are computed side by side, and the coefficients of each place are vectors along x. All code is inlined into
//! code dispatched by [`crate::lanes::run_one`].

use super::spline::{Spline, slopes, weights};

/// Number of places that fill the registers of a processor.
pub const PLACES: usize = 8;

/// The weights of four coefficients, or their derivatives.
type Shares<const N: usize> = [[f64; N]; 4];

/// Heights and gradients.
pub struct Slopes<const N: usize> {
    /// Heights, m.
    pub z: [f64; N],
    /// Derivatives with respect to x.
    pub gx: [f64; N],
    /// Derivatives with respect to y.
    pub gy: [f64; N],
}

/// A number for each place from its index.
#[inline(always)]
pub fn each<const N: usize>(mut number: impl FnMut(usize) -> f64) -> [f64; N] {
    let mut out = [0.0; N];
    for (i, out) in out.iter_mut().enumerate() {
        *out = number(i);
    }
    out
}

/// Cells of the grid, and fractions of the cells.
struct Cells<const N: usize> {
    cell: [f64; N],
    share: [f64; N],
}

#[inline(always)]
fn cells<const N: usize>(at: &[f64; N], corner: f64, inverse: f64, count: f64) -> Cells<N> {
    let mut out = Cells { cell: [0.0; N], share: [0.0; N] };
    for (i, at) in at.iter().enumerate() {
        let along = ((at - corner) * inverse).max(0.0).min(count);
        out.cell[i] = along.floor().min(count - 1.0);
        out.share[i] = along - out.cell[i];
    }
    out
}

/// The weights of each place, side by side.
#[inline(always)]
fn side_by_side<const N: usize>(shares: impl Fn(f64) -> [f64; 4], t: &[f64; N]) -> Shares<N> {
    let mut out = [[0.0; N]; 4];
    for (i, t) in t.iter().enumerate() {
        let [a, b, c, d] = shares(*t);
        (out[0][i], out[1][i], out[2][i], out[3][i]) = (a, b, c, d);
    }
    out
}

/// Weights of one place.
#[inline(always)]
fn at<const N: usize>(shares: &Shares<N>, i: usize) -> [f64; 4] {
    [shares[0][i], shares[1][i], shares[2][i], shares[3][i]]
}

#[inline(always)]
fn dot(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    a[3].mul_add(b[3], a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0])))
}

impl Spline {
    /// Heights at places on the grid; places beyond it are moved to its edge.
    #[inline(always)]
    pub fn heights_at<const N: usize>(&self, x: &[f64; N], y: &[f64; N]) -> [f64; N] {
        let ([cx, cy], [nx, ny], inverse) = self.grid();
        let (across, along) = (cells(x, cx, inverse, nx), cells(y, cy, inverse, ny));
        let (wx, wy) = (side_by_side(weights, &across.share), side_by_side(weights, &along.share));
        let mut z = [0.0; N];
        for (i, z) in z.iter_mut().enumerate() {
            let sums = self.sums(across.cell[i], along.cell[i], &at(&wy, i));
            *z = dot(&sums, &at(&wx, i));
        }
        z
    }

    /// Heights and gradients at places on the grid.
    #[inline(always)]
    pub fn slopes_at<const N: usize>(&self, x: &[f64; N], y: &[f64; N]) -> Slopes<N> {
        let ([cx, cy], [nx, ny], inverse) = self.grid();
        let (across, along) = (cells(x, cx, inverse, nx), cells(y, cy, inverse, ny));
        let (wx, wy) = (side_by_side(weights, &across.share), side_by_side(weights, &along.share));
        let (dx, dy) = (side_by_side(slopes, &across.share), side_by_side(slopes, &along.share));
        let mut out = Slopes { z: [0.0; N], gx: [0.0; N], gy: [0.0; N] };
        for i in 0..N {
            let (column, row) = (across.cell[i], along.cell[i]);
            let (values, slants) = (self.sums(column, row, &at(&wy, i)), self.sums(column, row, &at(&dy, i)));
            let wx = at(&wx, i);
            out.z[i] = dot(&values, &wx);
            out.gx[i] = dot(&values, &at(&dx, i)) * inverse;
            out.gy[i] = dot(&slants, &wx) * inverse;
        }
        out
    }
}
