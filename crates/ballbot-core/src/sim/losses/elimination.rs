//! The linear equations of given laws.

use super::law::Laws;
use super::problem::Problem;
use super::rows::{ROWS, load, partner};
use crate::lanes::Lane;

impl<L: Lane> Problem<L> {
    /// Impulses that meet linearized laws; the speeds of friction count `weight` times. By elimination without pivots:
    /// the rows before the wheels' are those of a symmetric positive matrix, or have a one on the diagonal.
    #[inline(always)]
    pub fn solve(&self, laws: &Laws<L>, weight: f64) -> [L; ROWS] {
        let zero = self.static_impulse.zero();
        let rows = self.present.rows();
        let mut matrix = [[zero; ROWS]; ROWS];
        let mut right = [zero; ROWS];
        for (a, &row) in rows.iter().enumerate() {
            self.equation(laws, weight, row, &mut matrix[a], &mut right[a]);
        }
        for a in 0..rows.len() {
            let inverse = zero.splat(1.0) / matrix[a][a];
            let (done, rest) = matrix.split_at_mut(a + 1);
            let pivot = &done[a];
            for (b, equation) in (a + 1..).zip(&mut rest[..rows.len() - a - 1]) {
                let factor = equation[a] * inverse;
                for c in a + 1..rows.len() {
                    equation[c] = factor.neg_mul_add(pivot[c], equation[c]);
                }
                right[b] = factor.neg_mul_add(right[a], right[b]);
            }
        }
        let mut impulses = [zero; ROWS];
        for a in (0..rows.len()).rev() {
            let mut rest = right[a];
            for b in a + 1..rows.len() {
                rest = matrix[a][b].neg_mul_add(impulses[rows[b]], rest);
            }
            impulses[rows[a]] = rest / matrix[a][a];
        }
        impulses
    }

    /// The equation of a row: its impulse less the linearized law of it is zero. Columns are in the order of the rows that
    /// are present.
    #[inline(always)]
    fn equation(&self, laws: &Laws<L>, weight: f64, row: usize, equation: &mut [L; ROWS], right: &mut L) {
        let weight = if load(row).is_some() { weight } else { 1.0 };
        let own = laws.own[row] * self.masses[row] * weight;
        let other = partner(row);
        let cross = match other {
            Some(other) => laws.cross[row] * self.masses[other] * weight,
            None => own.zero(),
        };
        *right = own.neg_mul_add(self.residuals[row], laws.constant[row]);
        if let Some(other) = other {
            *right = cross.neg_mul_add(self.residuals[other], *right);
        }
        for (entry, &column) in equation.iter_mut().zip(self.present.rows()) {
            *entry = own * self.coupling[row][column];
            if let Some(other) = other {
                *entry = cross.mul_add(self.coupling[other][column], *entry);
                if column == other {
                    *entry -= laws.cross[row];
                }
            }
            if column == row {
                *entry += -laws.own[row] + 1.0;
            }
            if Some(column) == load(row) {
                *entry -= laws.share[row];
            }
        }
    }
}
