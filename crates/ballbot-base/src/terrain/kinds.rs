//! Terrains by name: seeded generators whose difficulty is a slope, never a height scaled to fit.

use super::noise::{Noise, Uniform};
use super::parameters::{Height, LENGTHS, Parameter, SLOPES, Values, parameter, smooth_step};
use super::{Recipe, Terrain, tiled};
use crate::error::{Error, Result, check};
use crate::fields::Limit;
use std::f64::consts::TAU;

/// Largest slope of (1 − q²)³ and of the quintic step, each with height and width 1.
const BUMP_SLOPE: f64 = 1.717_300_206_719_834;
const STEP_SLOPE: f64 = 1.875;

/// Minimum number of cells of the shortest wave: with fewer its slope is lost.
const FINEST: f64 = 5.0;

/// Largest number of bumps of a terrain.
const MOST_BUMPS: f64 = 1e5;

const APRON_BLEND: Parameter = parameter(
    "apron_blend",
    "m",
    0.5,
    Limit::above(0.0).to(1e4),
    "width of the ring in which the ground rises from it",
);

/// Common parameters of all generators.
const COMMON: [Parameter; 5] = [
    parameter("size_x", "m", 8.0, LENGTHS, "length along x"),
    parameter("size_y", "m", 8.0, LENGTHS, "length along y"),
    parameter("cell", "m", 0.02, Limit::from(1e-4).to(1e3), "distance of neighboring heights, at most"),
    parameter("apron", "m", 0.0, Limit::from(0.0).to(1e4), "radius of the level place around the origin; 0 for none"),
    APRON_BLEND,
];

/// A generator of terrains.
#[derive(Clone, Copy)]
pub struct TerrainKind {
    /// Its name.
    pub name: &'static str,
    /// Description of the terrain.
    pub doc: &'static str,
    /// Parameters of this kind, in addition to the common parameters.
    pub parameters: &'static [Parameter],
    make: Make,
}

/// How a kind generates a terrain.
#[derive(Clone, Copy)]
enum Make {
    /// With [`Terrain::plane`].
    Plane,
    /// With [`tiled`], which generates each tile from the height of a kind.
    Tiles(fn(&Values, u64, tiled::OfKind) -> Result<Terrain>),
    /// From its height.
    Heights {
        height: fn(&Values, u64) -> Result<Height>,
        /// Length of the shortest waves or similarly sharp features, m; 0 or infinite for none.
        shortest: fn(&Values) -> f64,
    },
}

impl TerrainKind {
    /// All kinds.
    pub const ALL: [Self; 10] = [PLANE, WAVE, BOWL, NOISE, BUMPS, CURB, COBBLES, MIX, LEVELS, HILLS];

    /// All parameters; a plane has no edges and no grid, and tiles determine theirs.
    pub fn all_parameters(&self) -> impl Iterator<Item = &'static Parameter> {
        let common = if matches!(self.make, Make::Heights { .. }) { &COMMON[..] } else { &[] };
        self.parameters.iter().chain(common)
    }

    /// A kind by its name.
    ///
    /// # Errors
    /// [`Error::UnknownName`] if it does not exist.
    pub fn named(name: &str) -> Result<Self> {
        crate::names::find("kind of terrain", name, Self::ALL, |kind| kind.name)
    }

    fn values(&self, given: &[(&str, f64)]) -> Result<Values> {
        for (name, _) in given {
            if !self.all_parameters().any(|known| known.name == *name) {
                let known: Vec<_> = self.all_parameters().map(|known| known.name).collect();
                return Err(Error::unknown("parameter of the terrain", name, &known));
            }
        }
        let value = |known: &Parameter| {
            let value =
                given.iter().rev().find(|(name, _)| *name == known.name).map_or(known.default, |(_, value)| *value);
            check(known.name, value, known.limit, |value| known.limit.contains(value))?;
            Ok((known.name, value))
        };
        self.all_parameters().map(value).collect::<Result<_>>().map(Values)
    }
}

impl Terrain {
    /// A terrain of a kind. Equal seeds and parameters give equal terrains on every machine; an omitted parameter has
    /// its default.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for an unknown kind or parameter; [`Error::OutOfRange`] for a value outside its limit;
    /// [`Error::Inconsistent`] for a surface steeper than [`super::STEEPEST`].
    pub fn generate(kind: &str, seed: u64, parameters: &[(&str, f64)]) -> Result<Self> {
        let kind = TerrainKind::named(kind)?;
        let values = kind.values(parameters)?;
        let mut terrain = match kind.make {
            Make::Plane => return Self::plane(values.get("slope"), values.get("direction")),
            Make::Tiles(make) => make(&values, seed, TerrainKind::height)?,
            Make::Heights { .. } => {
                check_apron(&values)?;
                let size = [values.get("size_x"), values.get("size_y")];
                Self::from_function(kind.raised(&values, seed)?, size, values.get("cell"))?
            }
        };
        terrain.recipe = Some(Recipe { kind: kind.name, seed, parameters: values.0 });
        Ok(terrain)
    }
}

/// A blend that differs from the default has no effect without an apron.
fn check_apron(values: &Values) -> Result<()> {
    let blend = values.get(APRON_BLEND.name);
    if values.get("apron") == 0.0 && blend != APRON_BLEND.default {
        return Err(Error::Inconsistent(format!(
            "apron_blend = {blend} has no effect without an apron: set apron above 0"
        )));
    }
    Ok(())
}

impl TerrainKind {
    /// The height of a kind that is generated from a height, with the apron.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for waves that are too short for the grid; errors of the kind about its parameters.
    fn raised(&self, values: &Values, seed: u64) -> Result<Height> {
        let Make::Heights { height, shortest } = self.make else { unreachable!("it has a height") };
        let (shortest, cell) = (shortest(values), values.get("cell"));
        if shortest > 0.0 && shortest < FINEST * cell {
            return Err(Error::Inconsistent(format!(
                "the shortest waves, bumps or steps of the terrain '{}' are {shortest:.4} m long, which a grid of cell = {cell} m \
                 does not have: it takes {FINEST} cells at least",
                self.name
            )));
        }
        let height = height(values, seed)?;
        let (apron, blend) = (values.get("apron"), values.get("apron_blend"));
        if apron == 0.0 {
            return Ok(height);
        }
        let middle = height(0.0, 0.0);
        Ok(Box::new(move |x: f64, y: f64| (height(x, y) - middle) * smooth_step((x.hypot(y) - apron) / blend)))
    }

    /// The height of a kind for a tile.
    ///
    /// # Errors
    /// As [`Terrain::generate`].
    fn height(name: &str, seed: u64, parameters: &[(&str, f64)]) -> Result<Height> {
        let kind = Self::named(name)?;
        kind.raised(&kind.values(parameters)?, seed)
    }
}

const PLANE: TerrainKind = TerrainKind {
    name: "plane",
    doc: "a plane through the origin, without edges",
    parameters: &[
        parameter("slope", "rad", 0.1, SLOPES, "its slope"),
        parameter("direction", "rad", 0.0, Limit::FINITE, "angle from the x axis towards which it rises"),
    ],
    make: Make::Plane,
};

const LEVELS: TerrainKind = TerrainKind {
    name: "levels",
    doc: "tiles for curricula: a row of waves, noise, bumps and cobbles for each level of difficulty",
    parameters: &tiled::LEVELS,
    make: Make::Tiles(tiled::with_levels),
};

const HILLS: TerrainKind = TerrainKind {
    name: "hills",
    doc: "tiles of smooth hills that differ by their seeds",
    parameters: &tiled::HILLS,
    make: Make::Tiles(tiled::of_hills),
};

const WAVE: TerrainKind = TerrainKind {
    name: "wave",
    doc: "a sine wave; the origin is halfway up",
    parameters: &[
        parameter("slope", "rad", 0.1, SLOPES, "its steepest slope"),
        parameter("wavelength", "m", 1.0, LENGTHS, "its length"),
        parameter("direction", "rad", 0.0, Limit::FINITE, "angle from the x axis along which it runs"),
    ],
    make: Make::Heights {
        height: |values, _| {
            let number = TAU / values.get("wavelength");
            let amplitude = values.get("slope").tan() / number;
            let (sin, cos) = values.get("direction").sin_cos();
            Ok(Box::new(move |x, y| amplitude * (number * (x * cos + y * sin)).sin()))
        },
        shortest: |values| values.get("wavelength"),
    },
};

const BOWL: TerrainKind = TerrainKind {
    name: "bowl",
    doc: "a hyperboloid: a bowl at the origin that becomes a cone",
    parameters: &[
        parameter("slope", "rad", 0.2, SLOPES, "the slope of the cone"),
        parameter("radius", "m", 1.0, LENGTHS, "radius of curvature at the origin"),
    ],
    make: Make::Heights {
        height: |values, _| {
            let rise = values.get("slope").tan();
            let width = rise * values.get("radius");
            Ok(Box::new(move |x, y| rise * ((x * x + y * y + width * width).sqrt() - width)))
        },
        shortest: |_| f64::INFINITY,
    },
};

const NOISE: TerrainKind = TerrainKind {
    name: "noise",
    doc: "fractal noise: octaves of waves with random directions and phases",
    parameters: &[
        parameter("slope", "rad", 0.15, SLOPES, "the 95th percentile of its slope over all seeds"),
        parameter("wavelength", "m", 1.0, LENGTHS, "length of the longest waves"),
        parameter("octaves", "", 3.0, Limit::from(1.0).to(12.0), "how many, a whole number"),
        parameter("persistence", "", 0.25, Limit::above(0.0).to(1.0), "amplitude of an octave over that of the last"),
        parameter("lacunarity", "", 2.0, Limit::from(1.0).to(10.0), "wavelength of an octave over that of the next"),
    ],
    make: Make::Heights {
        height: |values, seed| {
            let octaves = values.get("octaves");
            check("octaves", octaves, "a whole number", |n| n.fract() == 0.0)?;
            let noise = Noise::new(
                seed,
                values.get("slope").tan(),
                values.get("wavelength"),
                octaves as usize,
                values.get("persistence"),
                values.get("lacunarity"),
            );
            Ok(Box::new(move |x, y| noise.at(x, y)))
        },
        shortest: |values| values.get("wavelength") / values.get("lacunarity").powf(values.get("octaves") - 1.0),
    },
};

const BUMPS: TerrainKind = TerrainKind {
    name: "bumps",
    doc: "round bumps at random places, half of them hollows",
    parameters: &[
        parameter("slope", "rad", 0.15, SLOPES, "the steepest slope of one bump; where bumps meet, slopes add up"),
        parameter("radius", "m", 0.4, LENGTHS, "mean radius; each has from 0.7 to 1.3 times this"),
        parameter("density", "1/m^2", 1.0, Limit::from(0.0).to(1e3), "bumps a square meter"),
    ],
    make: Make::Heights {
        height: |values, seed| {
            let (rise, radius) = (values.get("slope").tan(), values.get("radius"));
            let half = [0.5 * values.get("size_x"), 0.5 * values.get("size_y")];
            let count = (values.get("density") * 4.0 * half[0] * half[1]).round();
            check("number of bumps, density times the area,", count, format_args!("at most {MOST_BUMPS}"), |n| {
                n <= MOST_BUMPS
            })?;
            let mut random = Uniform::new(seed, 1);
            // Strips along y, as wide as the largest bump: a point is reached from its strip and the two neighbors.
            let largest = 1.3 * radius;
            let strip = move |x: f64| ((x + half[0]) / largest).max(0.0) as usize;
            let mut strips = vec![Vec::new(); strip(half[0]) + 3];
            for _ in 0..count as usize {
                let [x, y] = half.map(|half| random.within([-half, half]));
                let radius = radius * random.within([0.7, 1.3]);
                let up = if random.draw() < 0.5 { 1.0 } else { -1.0 };
                let height = up * rise * random.within([0.5, 1.0]) * radius / BUMP_SLOPE;
                (0..3).for_each(|beside| strips[strip(x) + beside].push((x, y, radius, height)));
            }
            Ok(Box::new(move |x, y| {
                let bump = |(bx, by, radius, height): &(f64, f64, f64, f64)| {
                    let left = 1.0 - ((x - bx).powi(2) + (y - by).powi(2)) / (radius * radius);
                    if left > 0.0 { height * left.powi(3) } else { 0.0 }
                };
                strips.get(strip(x) + 1).map_or(0.0, |strip| strip.iter().map(bump).sum())
            }))
        },
        shortest: |values| 1.4 * values.get("radius"),
    },
};

const CURB: TerrainKind = TerrainKind {
    name: "curb",
    doc: "a rounded step across the x axis",
    parameters: &[
        parameter("slope", "rad", 0.15, Limit::above(0.0).to(super::STEEPEST), "its steepest slope"),
        parameter("height", "m", 0.01, Limit::from(-10.0).to(10.0), "how high it rises"),
        parameter("distance", "m", 1.0, Limit::FINITE, "x of its middle"),
    ],
    make: Make::Heights {
        height: |values, _| {
            let (height, distance) = (values.get("height"), values.get("distance"));
            let width = STEP_SLOPE * height.abs() / values.get("slope").tan();
            if width == 0.0 {
                return Ok(Box::new(|_, _| 0.0));
            }
            Ok(Box::new(move |x, _| height * smooth_step((x - distance) / width + 0.5)))
        },
        shortest: |values| STEP_SLOPE * values.get("height").abs() / values.get("slope").tan(),
    },
};

const COBBLES: TerrainKind = TerrainKind {
    name: "cobbles",
    doc: "a regular field of short crossed waves, shifted at random",
    parameters: &[
        parameter("slope", "rad", 0.1, SLOPES, "its steepest slope"),
        parameter("wavelength", "m", 0.3, LENGTHS, "distance of two cobbles"),
    ],
    make: Make::Heights {
        height: |values, seed| {
            let number = TAU / values.get("wavelength");
            let mut random = Uniform::new(seed, 2);
            let phases = [random.draw() * TAU, random.draw() * TAU];
            // The slope of cos u cos v is at most k times the amplitude.
            let amplitude = values.get("slope").tan() / number;
            Ok(Box::new(move |x, y| amplitude * (number * x + phases[0]).cos() * (number * y + phases[1]).cos()))
        },
        shortest: |values| values.get("wavelength"),
    },
};

const MIX: TerrainKind = TerrainKind {
    name: "mix",
    doc: "noise, bumps and waves across each other, each with a share of the slope",
    parameters: &[
        parameter("slope", "rad", 0.15, SLOPES, "the sum of the slopes that its parts are asked for"),
        parameter("wavelength", "m", 1.0, LENGTHS, "length of the waves"),
    ],
    make: Make::Heights {
        height: |values, seed| {
            let (slope, wavelength) = (values.get("slope"), values.get("wavelength"));
            let share = |share: f64| (share * slope.tan()).atan();
            let size = [("size_x", values.get("size_x")), ("size_y", values.get("size_y"))];
            let part = |kind: &TerrainKind, own: &[(&str, f64)]| {
                let given: Vec<_> = own.iter().copied().chain(size).collect();
                let Make::Heights { height, .. } = kind.make else { unreachable!("it has a height") };
                height(&kind.values(&given)?, seed)
            };
            let turn = Uniform::new(seed, 3).draw() * TAU;
            let noise = part(&NOISE, &[("slope", share(0.5)), ("wavelength", wavelength)])?;
            let bumps = part(&BUMPS, &[("slope", share(0.25)), ("radius", 0.5 * wavelength)])?;
            let wave = part(&WAVE, &[("slope", share(0.25)), ("wavelength", 1.5 * wavelength), ("direction", turn)])?;
            Ok(Box::new(move |x, y| noise(x, y) + bumps(x, y) + wave(x, y)))
        },
        shortest: |values| values.get("wavelength"),
    },
};
