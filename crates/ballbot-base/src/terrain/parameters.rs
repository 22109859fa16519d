//! Parameters and results of terrain generators.

use super::{STEEPEST, Terrain};
use crate::error::{Error, Result};
use crate::fields;
use crate::fields::{Fields, Limit};

pub(super) const SLOPES: Limit = Limit::from(0.0).to(STEEPEST);
pub(super) const LENGTHS: Limit = Limit::from(1e-3).to(1e4);
pub(super) const CELLS: Limit = Limit::from(1e-4).to(1e3);

/// Minimum number of cells of the shortest wave: with fewer its slope is lost.
const FINEST: f64 = 5.0;

fields! {
    /// Parameters of all generators of heights.
    pub struct Grid {
        /// length along x
        pub size_x: f64 = 8.0, "m", LENGTHS;
        /// length along y
        pub size_y: f64 = 8.0, "m", LENGTHS;
        /// distance of neighboring heights, at most
        pub cell: f64 = 0.02, "m", CELLS;
        /// radius of the level place around the origin; 0 for none
        pub apron: f64 = 0.0, "m", Limit::from(0.0).to(1e4);
        /// width of the ring in which the ground rises from it
        pub apron_blend: f64 = 0.5, "m", Limit::above(0.0).to(1e4);
    }
}

/// A kind of terrain, by its parameters.
pub(super) trait Kind: Fields {
    /// Its name.
    const NAME: &'static str;
    /// Description of the terrain.
    const DOC: &'static str;
    /// Parameters that it shares with other kinds.
    type Common: Fields;

    /// The terrain of valid parameters.
    ///
    /// # Errors
    /// As [`Terrain::generate`].
    fn terrain(&self, common: &Self::Common, seed: u64) -> Result<Terrain>;
}

/// A function of x and y.
pub(super) type Height = Box<dyn Fn(f64, f64) -> f64>;

/// A kind of terrain that is generated from its height.
pub(super) trait Surface: Fields {
    /// As in [`Kind`].
    const NAME: &'static str;
    /// As in [`Kind`].
    const DOC: &'static str;

    /// Its height.
    ///
    /// # Errors
    /// Errors about its parameters.
    fn height(&self, grid: &Grid, seed: u64) -> Result<Height>;

    /// Length of the shortest waves or similarly sharp features, m; 0 or infinite for none.
    fn shortest(&self) -> f64;

    /// [`Surface::height`] within the limits of the parameters.
    ///
    /// # Errors
    /// [`Error::OutOfRange`]; the errors of [`Surface::height`].
    fn checked_height(&self, grid: &Grid, seed: u64) -> Result<Height> {
        self.check_limits()?;
        self.height(grid, seed)
    }

    /// The height with the apron.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for waves that are too short for the grid; the errors of [`Surface::checked_height`].
    fn raised(&self, grid: &Grid, seed: u64) -> Result<Height> {
        self.check_limits()?;
        let (shortest, cell) = (self.shortest(), grid.cell);
        if shortest > 0.0 && shortest < FINEST * cell {
            return Err(Error::Inconsistent(format!(
                "the shortest waves, bumps or steps of the terrain '{}' are {shortest:.4} m long, which a grid of cell = {cell} m \
                 does not have: it takes {FINEST} cells at least",
                Self::NAME
            )));
        }
        let height = self.height(grid, seed)?;
        let (apron, blend) = (grid.apron, grid.apron_blend);
        if apron == 0.0 {
            return Ok(height);
        }
        let middle = height(0.0, 0.0);
        Ok(Box::new(move |x: f64, y: f64| (height(x, y) - middle) * smooth_step((x.hypot(y) - apron) / blend)))
    }
}

impl<S: Surface> Kind for S {
    const NAME: &'static str = S::NAME;
    const DOC: &'static str = S::DOC;
    type Common = Grid;

    fn terrain(&self, grid: &Grid, seed: u64) -> Result<Terrain> {
        // A blend that differs from the default has no effect without an apron.
        let blend = grid.apron_blend;
        if grid.apron == 0.0 && blend != Grid::default().apron_blend {
            return Err(Error::Inconsistent(format!(
                "apron_blend = {blend} has no effect without an apron: set apron above 0"
            )));
        }
        Terrain::from_function(self.raised(grid, seed)?, [grid.size_x, grid.size_y], grid.cell)
    }
}

/// From 0 at 0 to 1 at 1, with two zero derivatives at both ends.
pub(super) fn smooth_step(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * t * (t * (6.0 * t - 15.0) + 10.0)
}
