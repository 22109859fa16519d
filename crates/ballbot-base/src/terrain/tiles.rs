//! Positions of the tiles of a terrain.

/// Equal squares of a terrain: columns along x, levels along y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tiles {
    /// Number of tiles per row.
    pub columns: usize,
    /// Number of levels; level 0 is the easiest.
    pub levels: usize,
    /// Side of a tile, m.
    pub side: f64,
}

impl Tiles {
    /// Middle of a tile, m.
    pub fn center(&self, column: usize, level: usize) -> [f64; 2] {
        let along = |index: usize, count: usize| self.side * (index as f64 - 0.5 * (count as f64 - 1.0));
        [along(column, self.columns), along(level, self.levels)]
    }

    /// Column and level of the tile nearest to x and y.
    pub fn nearest(&self, x: f64, y: f64) -> [usize; 2] {
        let index = |at: f64, count: usize| {
            let place = (at / self.side + 0.5 * count as f64).floor();
            place.clamp(0.0, (count - 1) as f64) as usize
        };
        [index(x, self.columns), index(y, self.levels)]
    }
}
