//! Terrains of tiles: squares, each with a level place in its middle where robots start, and level edges.

use super::parameters::{Height, LENGTHS, Parameter, SLOPES, Values, parameter, smooth_step};
use super::{Terrain, Tiles};
use crate::error::{Result, check};
use crate::fields::Limit;

/// The height of a kind by name, seed and parameters.
pub(super) type OfKind = fn(&str, u64, &[(&str, f64)]) -> Result<Height>;

/// The surface of a tile.
struct Surface {
    kind: &'static str,
    /// The parameter for its length, as a fraction of the wavelength.
    length: (&'static str, f64),
    own: &'static [(&'static str, f64)],
}

/// Columns of a terrain with levels.
const COLUMNS: [Surface; 4] = [
    Surface { kind: "wave", length: ("wavelength", 1.0), own: &[] },
    Surface { kind: "noise", length: ("wavelength", 1.0), own: &[("octaves", 2.0)] },
    Surface { kind: "bumps", length: ("radius", 0.35), own: &[] },
    Surface { kind: "cobbles", length: ("wavelength", 0.5), own: &[] },
];

/// Every tile of hills.
const HILL: Surface = Surface { kind: "noise", length: ("wavelength", 1.0), own: &[("octaves", 1.0)] };

const TILE: Parameter = parameter("tile", "m", 8.0, LENGTHS, "side of a tile");
const CELL: Parameter =
    parameter("cell", "m", 0.05, Limit::from(1e-4).to(1e3), "distance of neighboring heights, at most");
const APRON: Parameter =
    parameter("apron", "m", 0.3, Limit::above(0.0).to(1e4), "radius of the level place in the middle of a tile");
const BLEND: Parameter = parameter(
    "blend",
    "m",
    1.0,
    Limit::above(0.0).to(1e4),
    "width of the ring around it, and of the edges, in which the ground rises",
);

/// Parameters of the kind with levels.
pub(super) const LEVELS: [Parameter; 7] = [
    parameter("slope", "rad", 0.15, SLOPES, "slope of the tiles of the highest level, as their kinds take it"),
    parameter(
        "levels",
        "",
        5.0,
        Limit::from(1.0).to(100.0),
        "how many levels, a whole number; slopes are multiples of the first",
    ),
    parameter(
        "wavelength",
        "m",
        1.5,
        LENGTHS,
        "length of waves and of the longest noise; bumps and cobbles are shorter",
    ),
    TILE,
    CELL,
    APRON,
    BLEND,
];

/// Parameters of the kind of hills.
pub(super) const HILLS: [Parameter; 7] = [
    parameter("slope", "rad", 0.15, SLOPES, "the 95th percentile of its slope over all seeds"),
    parameter("tiles", "", 4.0, Limit::from(1.0).to(100.0), "how many, a whole number"),
    parameter("wavelength", "m", 1.0, LENGTHS, "length of the hills"),
    TILE,
    CELL,
    APRON,
    BLEND,
];

/// Tiles of all kinds in rows of increasing difficulty.
///
/// # Errors
/// As [`Terrain::generate`].
pub(super) fn with_levels(values: &Values, seed: u64, of_kind: OfKind) -> Result<Terrain> {
    let levels = check("levels", values.get("levels"), "a whole number", |n| n.fract() == 0.0)?;
    let tiles = Tiles { columns: COLUMNS.len(), levels: levels as usize, side: values.get("tile") };
    made(values, seed, of_kind, tiles, |column, level| {
        (&COLUMNS[column], values.get("slope") * (level + 1) as f64 / levels)
    })
}

/// Tiles of one kind and one level, which differ by their seeds.
///
/// # Errors
/// As [`Terrain::generate`].
pub(super) fn of_hills(values: &Values, seed: u64, of_kind: OfKind) -> Result<Terrain> {
    let count = check("tiles", values.get("tiles"), "a whole number", |n| n.fract() == 0.0)?;
    let tiles = Tiles { columns: count as usize, levels: 1, side: values.get("tile") };
    made(values, seed, of_kind, tiles, |_, _| (&HILL, values.get("slope")))
}

fn made(
    values: &Values,
    seed: u64,
    of_kind: OfKind,
    tiles: Tiles,
    surface: impl Fn(usize, usize) -> (&'static Surface, f64),
) -> Result<Terrain> {
    let (side, blend, apron, cell) = (tiles.side, values.get("blend"), values.get("apron"), values.get("cell"));
    let least = 2.0 * (apron + 2.0 * blend);
    check("tile", side, format_args!("at least 2 (apron + 2 blend) = {least} m"), |side| side >= least)?;
    let size = [side * tiles.columns as f64, side * tiles.levels as f64];
    // Before tiles are generated.
    Terrain::grid(size, cell)?;
    let mut heights = Vec::<Height>::with_capacity(tiles.columns * tiles.levels);
    for level in 0..tiles.levels {
        for column in 0..tiles.columns {
            let (surface, slope) = surface(column, level);
            let (length, share) = surface.length;
            let common = [
                ("slope", slope),
                (length, share * values.get("wavelength")),
                ("size_x", side),
                ("size_y", side),
                ("cell", cell),
                ("apron", apron),
                ("apron_blend", blend),
            ];
            let parameters: Vec<_> = surface.own.iter().copied().chain(common).collect();
            // Neighboring seeds have no tile in common.
            let seed = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(heights.len() as u64);
            heights.push(of_kind(surface.kind, seed, &parameters)?);
        }
    }
    let height = |x: f64, y: f64| {
        let [column, level] = tiles.nearest(x, y);
        let [cx, cy] = tiles.center(column, level);
        let (x, y) = (x - cx, y - cy);
        let [beside, before] = [x, y].map(|along| smooth_step((0.5 * side - along.abs()) / blend));
        let rise = beside * before;
        if rise > 0.0 { rise * heights[level * tiles.columns + column](x, y) } else { 0.0 }
    };
    let mut terrain = Terrain::from_function(height, size, cell)?;
    terrain.tiles = Some(tiles);
    Ok(terrain)
}
