//! Access in lanes to the internal numbers of a stage, a task or a controller.

use super::Lane;

/// Numbers of one robot or of eight.
pub struct Memory<'a, L: Lane> {
    token: L::Token,
    cells: &'a mut [L::Cell],
}

impl<'a, L: Lane> Memory<'a, L> {
    /// Access to the numbers in `cells`.
    #[inline(always)]
    pub fn new(token: L::Token, cells: &'a mut [L::Cell]) -> Self {
        Self { token, cells }
    }

    /// Number `index`.
    #[inline(always)]
    pub fn get(&self, index: usize) -> L {
        L::load(self.token, &self.cells[index])
    }

    /// Replaces number `index`.
    #[inline(always)]
    pub fn set(&mut self, index: usize, value: L) {
        value.store(&mut self.cells[index]);
    }

    /// Numbers from elsewhere.
    #[inline(always)]
    pub fn load(&self, cell: &L::Cell) -> L {
        L::load(self.token, cell)
    }

    /// A constant with the same value for all robots.
    #[inline(always)]
    pub fn splat(&self, value: f64) -> L {
        L::from_f64(self.token, value)
    }
}
