//! The smoothest interpolating splines that start and end at rest.

use super::jet::Jet;
use ballbot_base::error::{Error, Result};
use nalgebra::{DMatrix, Vector2};

/// Degree of the polynomials: with one knot per point, the number of coefficients equals the number of points and rest
/// conditions.
const DEGREE: usize = 9;

/// Derivatives that are zero at both ends.
const AT_REST: usize = 4;

/// A B-spline of degree 9 with knots at given times, through given points, with four derivatives zero at both ends.
/// Through two points it covers the fraction 126 u⁵ − 420 u⁶ + 540 u⁷ − 315 u⁸ + 70 u⁹ of the distance.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Spline {
    knots: Vec<f64>,
    coefficients: Vec<Vector2<f64>>,
}

impl Spline {
    /// The spline z for which z − `lag` z̈ passes `points` at `times`, which increase.
    pub(super) fn new(points: &[Vector2<f64>], times: &[f64], lag: f64) -> Result<Self> {
        let (first, last) = (times[0], times[times.len() - 1]);
        let mut knots = vec![first; DEGREE];
        knots.extend_from_slice(times);
        knots.extend_from_slice(&[last; DEGREE]);
        let size = points.len() + 2 * AT_REST;
        let mut spline = Self { knots, coefficients: vec![Vector2::zeros(); size] };
        let (mut rows, mut values) = (DMatrix::zeros(size, size), DMatrix::zeros(size, 2));
        // Rows of derivatives in units of the mean interval.
        let interval = (last - first) / (times.len() - 1) as f64;
        let mut row = 0;
        for (point, &time) in points.iter().zip(times) {
            let (start, basis) = spline.basis(time);
            for (j, b) in basis.iter().enumerate() {
                rows[(row, start + j)] = b.value() - lag * b.derivative(2);
            }
            values.row_mut(row).copy_from(&point.transpose());
            row += 1;
        }
        for time in [first, last] {
            let (start, basis) = spline.basis(time);
            for order in 1..=AT_REST {
                let unit = interval.powi(i32::try_from(order).unwrap_or(0));
                basis.iter().enumerate().for_each(|(j, b)| rows[(row, start + j)] = b.derivative(order) * unit);
                row += 1;
            }
        }
        let solved = rows.full_piv_lu().solve(&values).filter(|found| found.iter().all(|x| x.is_finite()));
        let solved = solved
            .ok_or_else(|| Error::Inconsistent("there is no smooth path through these points and times".into()))?;
        spline.coefficients = solved.row_iter().map(|row| Vector2::new(row[0], row[1])).collect();
        Ok(spline)
    }

    /// Position at time t, at rest before the first knot and after the last.
    pub(super) fn at(&self, t: f64) -> [Jet; 2] {
        let (first, last) = (self.knots[0], self.knots[self.knots.len() - 1]);
        let ends = [self.coefficients[0], self.coefficients[self.coefficients.len() - 1]];
        if t <= first || t >= last {
            let end = ends[usize::from(t >= last)];
            return [Jet::constant(end.x), Jet::constant(end.y)];
        }
        let (start, basis) = self.basis(t);
        let mut sum = [Jet::default(); 2];
        for (b, c) in basis.iter().zip(&self.coefficients[start..]) {
            sum = [sum[0] + *b * c.x, sum[1] + *b * c.y];
        }
        sum
    }

    /// The basis functions that are nonzero at time t, by the Cox-de Boor recursion, and the index of the first.
    fn basis(&self, t: f64) -> (usize, [Jet; DEGREE + 1]) {
        let inner = &self.knots[DEGREE..self.knots.len() - DEGREE];
        // The last interval is closed.
        let span = inner[1..inner.len() - 1].partition_point(|knot| *knot <= t) + DEGREE;
        let (knots, t) = (&self.knots, Jet::time(t));
        let mut basis = [Jet::default(); DEGREE + 1];
        basis[0] = Jet::constant(1.0);
        for degree in 1..=DEGREE {
            let mut carried = Jet::default();
            for j in 0..degree {
                let (left, right) = (knots[span + 1 + j - degree], knots[span + 1 + j]);
                let share = basis[j] * (right - left).recip();
                basis[j] = carried + (Jet::constant(right) - t) * share;
                carried = (t - Jet::constant(left)) * share;
            }
            basis[degree] = carried;
        }
        (span - DEGREE, basis)
    }
}
