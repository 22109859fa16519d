//! The coefficients of a spline near one place or eight, kept from one evaluation to the next: a robot stays in a cell
//! for many steps.

use crate::lanes::{Cell, Lane};

/// Coefficients of the cell of each robot. They depend only on the cell, so no result depends on what was kept.
#[derive(Clone, Debug)]
pub struct Patch<T> {
    /// Index of the first coefficient; NaN for none.
    pub(super) index: T,
    /// Rows of four coefficients.
    pub(super) coefficients: [[T; 4]; 4],
}

impl<T: Cell> Default for Patch<T> {
    fn default() -> Self {
        let mut index = T::default();
        (0..T::WIDTH).for_each(|i| index.set(i, f64::NAN));
        Self { index, coefficients: [[T::default(); 4]; 4] }
    }
}

impl<T: Cell> Patch<T> {
    /// Loads the coefficients of the cells whose first coefficient is at `index` of `all`, with rows of `columns`.
    #[inline(always)]
    pub(super) fn move_to<L: Lane<Cell = T>>(&mut self, token: L::Token, index: L, all: &[f64], columns: usize) {
        let kept = L::load(token, &self.index);
        if L::any(!(index.le(kept) & kept.le(index))) {
            let mut requested = T::default();
            index.store(&mut requested);
            self.refill(&requested, all, columns);
        }
    }

    #[cold]
    #[inline(never)]
    fn refill(&mut self, requested: &T, all: &[f64], columns: usize) {
        for i in 0..T::WIDTH {
            if requested.get(i) == self.index.get(i) {
                continue;
            }
            let first = requested.get(i) as usize;
            for (row, cells) in self.coefficients.iter_mut().enumerate() {
                let from = &all[first + row * columns..][..4];
                for (cell, value) in cells.iter_mut().zip(from) {
                    cell.set(i, *value);
                }
            }
        }
        self.index = *requested;
    }

    /// Coefficients of a row.
    #[inline(always)]
    pub(super) fn row<L: Lane<Cell = T>>(&self, token: L::Token, row: usize) -> [L; 4] {
        let [a, b, c, d] = &self.coefficients[row];
        [L::load(token, a), L::load(token, b), L::load(token, c), L::load(token, d)]
    }
}
