//! A spline at eight places of one robot at once: the points of a scan, or the rays of a picture.
//!
//! Shares are computed side by side, and the coefficients of each place are vectors along x. All is inlined into code that is
//! dispatched by [`crate::lanes::run_one`].

use super::spline::Spline;

/// How many places.
pub const PLACES: usize = 8;

/// A number for each place.
pub type Places = [f64; PLACES];

/// The shares of four coefficients, or their derivatives.
type Shares = [Places; 4];

/// Heights and gradients.
pub struct Slopes {
    /// Heights, m.
    pub z: Places,
    /// Derivatives by x.
    pub gx: Places,
    /// Derivatives by y.
    pub gy: Places,
}

/// A number for each place from its index.
#[inline(always)]
pub fn each(mut number: impl FnMut(usize) -> f64) -> Places {
    let mut out = [0.0; PLACES];
    for (i, out) in out.iter_mut().enumerate() {
        *out = number(i);
    }
    out
}

/// Cells of the grid, and shares of the cells.
struct Cells {
    cell: Places,
    share: Places,
}

#[inline(always)]
fn cells(at: &Places, corner: f64, inverse: f64, count: f64) -> Cells {
    let mut out = Cells { cell: [0.0; PLACES], share: [0.0; PLACES] };
    for (i, at) in at.iter().enumerate() {
        let along = ((at - corner) * inverse).max(0.0).min(count);
        out.cell[i] = along.floor().min(count - 1.0);
        out.share[i] = along - out.cell[i];
    }
    out
}

#[inline(always)]
fn weights(t: &Places) -> Shares {
    let mut out = [[0.0; PLACES]; 4];
    for i in 0..PLACES {
        let (t, rest) = (t[i], 1.0 - t[i]);
        let (square, rest_square) = (t * t, rest * rest);
        out[0][i] = rest_square * rest * (1.0 / 6.0);
        out[1][i] = t.mul_add(3.0, -6.0).mul_add(square, 4.0) * (1.0 / 6.0);
        out[2][i] = rest.mul_add(3.0, -6.0).mul_add(rest_square, 4.0) * (1.0 / 6.0);
        out[3][i] = square * t * (1.0 / 6.0);
    }
    out
}

#[inline(always)]
fn derivatives(t: &Places) -> Shares {
    let mut out = [[0.0; PLACES]; 4];
    for i in 0..PLACES {
        let (t, rest) = (t[i], 1.0 - t[i]);
        out[0][i] = -0.5 * rest * rest;
        out[1][i] = t.mul_add(1.5, -2.0) * t;
        out[2][i] = -rest.mul_add(1.5, -2.0) * rest;
        out[3][i] = 0.5 * t * t;
    }
    out
}

/// Shares of one place.
#[inline(always)]
fn at(shares: &Shares, i: usize) -> [f64; 4] {
    [shares[0][i], shares[1][i], shares[2][i], shares[3][i]]
}

#[inline(always)]
fn dot(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    a[3].mul_add(b[3], a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0])))
}

impl Spline {
    /// Heights at places on the grid; those beyond it are moved to its edge.
    #[inline(always)]
    pub fn heights_at(&self, x: &Places, y: &Places) -> Places {
        let ([cx, cy], [nx, ny], inverse) = self.grid();
        let (across, along) = (cells(x, cx, inverse, nx), cells(y, cy, inverse, ny));
        let (wx, wy) = (weights(&across.share), weights(&along.share));
        let mut z = [0.0; PLACES];
        for (i, z) in z.iter_mut().enumerate() {
            let sums = self.sums(across.cell[i], along.cell[i], &at(&wy, i));
            *z = dot(&sums, &at(&wx, i));
        }
        z
    }

    /// The same with gradients.
    #[inline(always)]
    pub fn slopes_at(&self, x: &Places, y: &Places) -> Slopes {
        let ([cx, cy], [nx, ny], inverse) = self.grid();
        let (across, along) = (cells(x, cx, inverse, nx), cells(y, cy, inverse, ny));
        let (wx, wy) = (weights(&across.share), weights(&along.share));
        let (dx, dy) = (derivatives(&across.share), derivatives(&along.share));
        let mut out = Slopes { z: [0.0; PLACES], gx: [0.0; PLACES], gy: [0.0; PLACES] };
        for i in 0..PLACES {
            let (column, row) = (across.cell[i], along.cell[i]);
            let (values, slants) = (self.sums(column, row, &at(&wy, i)), self.sums(column, row, &at(&dy, i)));
            let weights = at(&wx, i);
            out.z[i] = dot(&values, &weights);
            out.gx[i] = dot(&values, &at(&dx, i)) * inverse;
            out.gy[i] = dot(&slants, &weights) * inverse;
        }
        out
    }
}
