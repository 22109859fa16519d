//! Terrains of tiles: squares, each with a level place in its middle where robots start, and level edges.

use super::kinds::{Bumps, Cobbles, Noise, Wave};
use super::parameters::{CELLS, Grid, Height, Kind, LENGTHS, SLOPES, Surface, smooth_step};
use super::{Terrain, Tiles};
use crate::error::{Result, check};
use crate::fields;
use crate::fields::Limit;

/// The height of a tile from its slope, wavelength, grid and seed.
type Tile = fn(f64, f64, &Grid, u64) -> Result<Height>;

/// Columns of a terrain with levels.
const COLUMNS: [Tile; 4] = [
    |slope, wavelength, grid, seed| Wave { slope, wavelength, ..Wave::default() }.raised(grid, seed),
    |slope, wavelength, grid, seed| Noise { slope, wavelength, octaves: 2.0, ..Noise::default() }.raised(grid, seed),
    |slope, length, grid, seed| Bumps { slope, radius: 0.35 * length, ..Bumps::default() }.raised(grid, seed),
    |slope, length, grid, seed| Cobbles { slope, wavelength: 0.5 * length }.raised(grid, seed),
];

/// Every tile of hills.
const HILL: Tile =
    |slope, wavelength, grid, seed| Noise { slope, wavelength, octaves: 1.0, ..Noise::default() }.raised(grid, seed);

fields! {
    /// Parameters of all kinds with tiles.
    pub struct Tiling {
        /// side of a tile
        pub tile: f64 = 8.0, "m", LENGTHS;
        /// distance of neighboring heights, at most
        pub cell: f64 = 0.05, "m", CELLS;
        /// radius of the level place in the middle of a tile
        pub apron: f64 = 0.3, "m", Limit::above(0.0).to(1e4);
        /// width of the ring around it, and of the edges, in which the ground rises
        pub blend: f64 = 1.0, "m", Limit::above(0.0).to(1e4);
    }
}

fields! {
    /// Parameters of tiles of all kinds in rows of increasing difficulty.
    pub struct Levels {
        /// slope of the tiles of the highest level, as their kinds take it
        pub slope: f64 = 0.15, "rad", SLOPES;
        /// how many levels, a whole number; slopes are multiples of the first
        pub levels: f64 = 5.0, "", Limit::from(1.0).to(100.0);
        /// length of waves and of the longest noise; bumps and cobbles are shorter
        pub wavelength: f64 = 1.5, "m", LENGTHS;
    }
}

impl Kind for Levels {
    const NAME: &'static str = "levels";
    const DOC: &'static str =
        "tiles for curricula: a row of waves, noise, bumps and cobbles for each level of difficulty";
    type Common = Tiling;

    fn terrain(&self, tiling: &Tiling, seed: u64) -> Result<Terrain> {
        let levels = check("levels", self.levels, "a whole number", |n| n.fract() == 0.0)?;
        let tiles = Tiles { columns: COLUMNS.len(), levels: levels as usize, side: tiling.tile };
        made(tiling, self.wavelength, seed, tiles, |column, level| {
            (COLUMNS[column], self.slope * (level + 1) as f64 / levels)
        })
    }
}

fields! {
    /// Parameters of tiles of one kind and one level, which differ by their seeds.
    pub struct Hills {
        /// the 95th percentile of its slope over all seeds
        pub slope: f64 = 0.15, "rad", SLOPES;
        /// how many, a whole number
        pub tiles: f64 = 4.0, "", Limit::from(1.0).to(100.0);
        /// length of the hills
        pub wavelength: f64 = 1.0, "m", LENGTHS;
    }
}

impl Kind for Hills {
    const NAME: &'static str = "hills";
    const DOC: &'static str = "tiles of smooth hills that differ by their seeds";
    type Common = Tiling;

    fn terrain(&self, tiling: &Tiling, seed: u64) -> Result<Terrain> {
        let count = check("tiles", self.tiles, "a whole number", |n| n.fract() == 0.0)?;
        let tiles = Tiles { columns: count as usize, levels: 1, side: tiling.tile };
        made(tiling, self.wavelength, seed, tiles, |_, _| (HILL, self.slope))
    }
}

fn made(
    tiling: &Tiling,
    wavelength: f64,
    seed: u64,
    tiles: Tiles,
    tile: impl Fn(usize, usize) -> (Tile, f64),
) -> Result<Terrain> {
    let Tiling { tile: side, blend, apron, cell } = *tiling;
    let least = 2.0 * (apron + 2.0 * blend);
    check("tile", side, format_args!("at least 2 (apron + 2 blend) = {least} m"), |side| side >= least)?;
    let size = [side * tiles.columns as f64, side * tiles.levels as f64];
    // Before tiles are generated.
    Terrain::grid(size, cell)?;
    let grid = Grid { size_x: side, size_y: side, cell, apron, apron_blend: blend };
    let mut heights = Vec::<Height>::with_capacity(tiles.columns * tiles.levels);
    for level in 0..tiles.levels {
        for column in 0..tiles.columns {
            let (height, slope) = tile(column, level);
            // Neighboring seeds have no tile in common.
            let seed = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(heights.len() as u64);
            heights.push(height(slope, wavelength, &grid, seed)?);
        }
    }
    let height = |x: f64, y: f64| {
        let [column, level] = tiles.nearest(x, y);
        let [cx, cy] = tiles.center(column, level);
        let (x, y) = (x - cx, y - cy);
        let [by_x, by_y] = [x, y].map(|along| smooth_step((0.5 * side - along.abs()) / blend));
        let rise = by_x * by_y;
        if rise > 0.0 { rise * heights[level * tiles.columns + column](x, y) } else { 0.0 }
    };
    let mut terrain = Terrain::from_function(height, size, cell)?;
    terrain.tiles = Some(tiles);
    Ok(terrain)
}
