//! Uniform bicubic B-splines: functions of x and y with continuous second derivatives.
//!
//! A spline goes through the heights on its grid, whose rows are along y. On the edges of the grid its second
//! derivative across the edge is zero. Beyond an edge it continues straight with the slope at the nearest point of the
//! edge, so its gradient is continuous everywhere.

use super::patch::Patch;
use crate::lanes::{Lane, floor, run_one};

/// A function of x and y on a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Spline {
    /// Rows of [`Spline::columns`] coefficients.
    coefficients: Vec<f64>,
    columns: usize,
    /// Cells along x and y.
    cells: [usize; 2],
    /// Coordinates of the first node.
    corner: [f64; 2],
    cell: f64,
    cell_inverse: f64,
}

/// Height and gradient.
#[derive(Clone, Copy, Debug)]
pub struct Height<L> {
    /// Height, m.
    pub z: L,
    /// Derivatives with respect to x and y.
    pub gradient: [L; 2],
}

/// Height and its derivatives up to the second.
#[derive(Clone, Copy, Debug, Default)]
pub struct Jet {
    /// Height, m.
    pub z: f64,
    /// Derivatives with respect to x and y.
    pub gradient: [f64; 2],
    /// Second derivatives, 1/m: xx, xy, yy.
    pub hessian: [f64; 3],
}

/// Position of a coordinate in the grid.
struct Place<L> {
    /// Index of the cell.
    cell: L,
    /// Fraction of the cell.
    share: L,
    /// Signed distance beyond the grid, m.
    beyond: L,
}

impl Spline {
    /// The spline through `heights`: `nodes[1]` rows along y of `nodes[0]` numbers along x, at least two each. `corner`
    /// is the position of the first number, `cell` the distance between neighbors.
    pub fn through(heights: &[f64], nodes: [usize; 2], corner: [f64; 2], cell: f64) -> Self {
        let [nx, ny] = nodes;
        debug_assert!(nx >= 2 && ny >= 2 && heights.len() == nx * ny);
        let columns = nx + 2;
        let mut coefficients = vec![0.0; columns * (ny + 2)];
        let mut room = vec![0.0; nx.max(ny)];
        let mut line = vec![0.0; nx.max(ny) + 2];
        for (row, heights) in heights.chunks_exact(nx).enumerate() {
            interpolate(heights, &mut line[..nx + 2], &mut room);
            coefficients[(row + 1) * columns..][..columns].copy_from_slice(&line[..nx + 2]);
        }
        let mut values = vec![0.0; ny];
        for column in 0..columns {
            for (row, value) in values.iter_mut().enumerate() {
                *value = coefficients[(row + 1) * columns + column];
            }
            interpolate(&values, &mut line[..ny + 2], &mut room);
            for (row, value) in line[..ny + 2].iter().enumerate() {
                coefficients[row * columns + column] = *value;
            }
        }
        Self::of_coefficients(coefficients, nodes, corner, cell)
    }

    /// A spline from the coefficients of another spline.
    pub fn of_coefficients(coefficients: Vec<f64>, nodes: [usize; 2], corner: [f64; 2], cell: f64) -> Self {
        let [nx, ny] = nodes;
        debug_assert!(nx >= 2 && ny >= 2 && coefficients.len() == (nx + 2) * (ny + 2));
        Self { coefficients, columns: nx + 2, cells: [nx - 1, ny - 1], corner, cell, cell_inverse: cell.recip() }
    }

    /// Coefficients in rows along y, with two more per row than nodes along x, and two more rows than nodes along y.
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients
    }

    /// FNV-1a hash of the numbers that define it.
    pub(super) fn fingerprint(&self) -> u64 {
        let own = [self.columns as f64, self.corner[0], self.corner[1], self.cell];
        hash(0xcbf2_9ce4_8422_2325, own.iter().chain(&self.coefficients).copied())
    }

    /// Distance between neighboring nodes, m.
    pub fn cell(&self) -> f64 {
        self.cell
    }

    /// Nodes along x and y.
    pub fn nodes(&self) -> [usize; 2] {
        self.cells.map(|cells| cells + 1)
    }

    /// Coordinates of a node.
    pub fn node(&self, i: usize, j: usize) -> [f64; 2] {
        [self.corner[0] + i as f64 * self.cell, self.corner[1] + j as f64 * self.cell]
    }

    #[inline(always)]
    fn place<L: Lane>(&self, axis: usize, x: L) -> Place<L> {
        let cells = self.cells[axis] as f64;
        let along = (x - self.corner[axis]) * self.cell_inverse;
        let within = along.max(x.zero()).min(x.splat(cells));
        let cell = floor(within).min(x.splat(cells - 1.0));
        Place { cell, share: within - cell, beyond: (along - within) * self.cell }
    }

    /// Height and gradient at x and y; `patch` keeps the coefficients from one call to the next.
    #[inline(always)]
    pub fn at<L: Lane>(&self, token: L::Token, [x, y]: [L; 2], patch: &mut Patch<L::Cell>) -> Height<L> {
        let (across, along) = (self.place(0, x), self.place(1, y));
        let index = along.cell.mul_add(x.splat(self.columns as f64), across.cell);
        patch.move_to(token, index, &self.coefficients, self.columns);
        let (wx, wy) = (weights(across.share), weights(along.share));
        let (dx, dy) = (slopes(across.share), slopes(along.share));
        let rows = [patch.row(token, 0), patch.row(token, 1), patch.row(token, 2), patch.row(token, 3)];
        let values = of_rows(&rows, &wx);
        let slants = of_rows(&rows, &dx);
        let scale = x.splat(self.cell_inverse);
        let mut height = Height {
            z: product(&values, &wy),
            gradient: [product(&slants, &wy) * scale, product(&values, &dy) * scale],
        };
        let [bx, by] = [across.beyond, along.beyond];
        if L::any(x.zero().lt(bx.abs() + by.abs())) {
            let twist = product(&slants, &dy) * (scale * scale);
            let [gx, gy] = height.gradient;
            height.gradient = [twist.mul_add(by, gx), twist.mul_add(bx, gy)];
            height.z = height.gradient[1].mul_add(by, gx.mul_add(bx, height.z));
        }
        height
    }

    /// Coordinates of the first node, cells along x and y, and the inverse of the node distance.
    #[inline(always)]
    pub(super) fn grid(&self) -> ([f64; 2], [f64; 2], f64) {
        (self.corner, self.cells.map(|cells| cells as f64), self.cell_inverse)
    }

    /// Sums of the coefficients of a cell along y: four columns side by side, as vectors of the processor.
    #[inline(always)]
    pub(super) fn sums(&self, column: f64, row: f64, weights: &[f64; 4]) -> [f64; 4] {
        let first = (row as usize) * self.columns + column as usize;
        let mut sums = [0.0; 4];
        for (row, weight) in weights.iter().enumerate() {
            let coefficients = &self.coefficients[first + row * self.columns..][..4];
            for (sum, coefficient) in sums.iter_mut().zip(coefficients) {
                *sum = coefficient.mul_add(*weight, *sum);
            }
        }
        sums
    }

    /// Height and derivatives at x and y.
    pub fn jet(&self, x: f64, y: f64) -> Jet {
        run_one(
            #[inline(always)]
            || self.jet_of_one(x, y),
        )
    }

    #[inline(always)]
    fn jet_of_one(&self, x: f64, y: f64) -> Jet {
        let (across, along) = (self.place(0, x), self.place(1, y));
        let first = (along.cell as usize) * self.columns + across.cell as usize;
        let rows = [0, 1, 2, 3].map(|row| {
            let start = first + row * self.columns;
            [0, 1, 2, 3].map(|column| self.coefficients[start + column])
        });
        let (wx, wy) = (weights(across.share), weights(along.share));
        let (dx, dy) = (slopes(across.share), slopes(along.share));
        let (cx, cy) = (bends(across.share), bends(along.share));
        let (values, slants) = (of_rows(&rows, &wx), of_rows(&rows, &dx));
        let scale = self.cell_inverse;
        let twist = product(&slants, &dy) * scale * scale;
        let [gx, gy] = [product(&slants, &wy) * scale, product(&values, &dy) * scale];
        let (bx, by) = (across.beyond, along.beyond);
        // Beyond an edge, the second derivative along the edge changes with the distance from it.
        let bend = |beyond: f64, bend: f64, other: f64, change: f64| {
            if beyond == 0.0 { (change * scale).mul_add(other, bend) * scale * scale } else { 0.0 }
        };
        let bent = of_rows(&rows, &cx);
        let along_y = twist.mul_add(bx, gy);
        Jet {
            z: along_y.mul_add(by, gx.mul_add(bx, product(&values, &wy))),
            gradient: [twist.mul_add(by, gx), along_y],
            hessian: [
                bend(bx, product(&bent, &wy), by, product(&bent, &dy)),
                twist,
                bend(by, product(&values, &cy), bx, product(&slants, &cy)),
            ],
        }
    }
}

/// Coefficients of the cubic spline through `values` with zero curvature at its ends; `room` has the same length.
fn interpolate(values: &[f64], coefficients: &mut [f64], room: &mut [f64]) {
    let last = values.len() - 1;
    let inner = &mut coefficients[1..=last + 1];
    inner[0] = values[0];
    inner[last] = values[last];
    // (c[i-1] + 4 c[i] + c[i+1]) / 6 = values[i] by elimination and substitution.
    let mut pivot = 0.0;
    for i in 1..last {
        let factor = 1.0 / (4.0 - pivot);
        let known = if i + 1 == last { values[last] } else { 0.0 };
        inner[i] = (6.0f64.mul_add(values[i], -inner[i - 1]) - known) * factor;
        room[i] = factor;
        pivot = factor;
    }
    for i in (1..last.saturating_sub(1)).rev() {
        inner[i] -= room[i] * inner[i + 1];
    }
    coefficients[0] = 2.0f64.mul_add(values[0], -coefficients[2]);
    let end = coefficients.len() - 1;
    coefficients[end] = 2.0f64.mul_add(values[last], -coefficients[end - 2]);
}

/// Weights of four coefficients in the height.
#[inline(always)]
pub(super) fn weights<L: Lane>(t: L) -> [L; 4] {
    let (sixth, one) = (1.0 / 6.0, t.splat(1.0));
    let rest = one - t;
    let (square, rest_square) = (t.squared(), rest.squared());
    let middle = t.mul_add_all(3.0, t.splat(-6.0)).mul_add(square, t.splat(4.0)) * sixth;
    let other = rest.mul_add_all(3.0, t.splat(-6.0)).mul_add(rest_square, t.splat(4.0)) * sixth;
    [rest_square * rest * sixth, middle, other, square * t * sixth]
}

/// Derivatives of the weights with respect to the position in the cell.
#[inline(always)]
pub(super) fn slopes<L: Lane>(t: L) -> [L; 4] {
    let rest = t.splat(1.0) - t;
    let middle = t.mul_add_all(1.5, t.splat(-2.0)) * t;
    let other = rest.mul_add_all(1.5, t.splat(-2.0)) * rest;
    [-(rest.squared() * 0.5), middle, -other, t.squared() * 0.5]
}

/// Second derivatives of the weights.
fn bends(t: f64) -> [f64; 4] {
    [1.0 - t, 3.0 * t - 2.0, 1.0 - 3.0 * t, t]
}

#[inline(always)]
fn product<L: Lane>(values: &[L; 4], weights: &[L; 4]) -> L {
    let [a, b, c, d] = values;
    let [p, q, r, s] = weights;
    d.mul_add(*s, c.mul_add(*r, b.mul_add(*q, *a * *p)))
}

#[inline(always)]
fn of_rows<L: Lane>(rows: &[[L; 4]; 4], weights: &[L; 4]) -> [L; 4] {
    [product(&rows[0], weights), product(&rows[1], weights), product(&rows[2], weights), product(&rows[3], weights)]
}

/// A hash of numbers that continues from another.
pub(super) fn hash(start: u64, numbers: impl Iterator<Item = f64>) -> u64 {
    numbers.fold(start, |hash, number| (hash ^ number.to_bits()).wrapping_mul(0x0000_0100_0000_01b3))
}
