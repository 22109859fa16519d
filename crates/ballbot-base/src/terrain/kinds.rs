//! Terrains by name: seeded generators whose difficulty is a slope, never a height scaled to fit.

use super::noise::{self, Uniform};
use super::parameters::{Grid, Height, Kind, LENGTHS, SLOPES, Surface, smooth_step};
use super::posts::Posts;
use super::tiled::{Hills, Levels};
use super::{Recipe, STEEPEST, Terrain};
use crate::error::{Error, Result, check};
use crate::fields;
use crate::fields::{Fields, Limit, OptionDescription, describe_options};
use std::f64::consts::TAU;

/// Largest slope of (1 − q²)³ and of the quintic step, each with height and width 1.
const BUMP_SLOPE: f64 = 1.717_300_206_719_834;
const STEP_SLOPE: f64 = 1.875;

/// Largest number of bumps of a terrain.
const MOST_BUMPS: f64 = 1e5;

/// A generator of terrains.
#[derive(Clone, Copy)]
pub struct TerrainKind {
    /// Its name.
    pub name: &'static str,
    /// Description of the terrain.
    pub doc: &'static str,
    /// Its parameters, first its own; a plane has no edges and no grid, and tiles determine theirs.
    pub parameters: fn() -> Vec<OptionDescription>,
    generate: Generate,
}

/// Makes a terrain from a seed and parameters by name.
type Generate = fn(u64, &[(&str, f64)]) -> Result<Terrain>;

impl TerrainKind {
    /// All kinds.
    pub const ALL: [Self; 11] = [
        Self::of::<Plane>(),
        Self::of::<Wave>(),
        Self::of::<Bowl>(),
        Self::of::<Noise>(),
        Self::of::<Bumps>(),
        Self::of::<Curb>(),
        Self::of::<Cobbles>(),
        Self::of::<Mix>(),
        Self::of::<Levels>(),
        Self::of::<Hills>(),
        Self::of::<Posts>(),
    ];

    const fn of<K: Kind>() -> Self {
        Self { name: K::NAME, doc: K::DOC, parameters: parameters::<K>, generate: generate::<K> }
    }

    /// A kind by its name.
    ///
    /// # Errors
    /// [`Error::UnknownName`] if it does not exist.
    pub fn named(name: &str) -> Result<Self> {
        crate::names::find("kind of terrain", name, Self::ALL, |kind| kind.name)
    }
}

impl Terrain {
    /// A terrain of a kind. Equal seeds and parameters give equal terrains on every machine; an omitted parameter has
    /// its default.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for an unknown kind or parameter; [`Error::OutOfRange`] for a value outside its limit;
    /// [`Error::Inconsistent`] for a surface steeper than [`STEEPEST`].
    pub fn generate(kind: &str, seed: u64, parameters: &[(&str, f64)]) -> Result<Self> {
        (TerrainKind::named(kind)?.generate)(seed, parameters)
    }
}

fn parameters<K: Kind>() -> Vec<OptionDescription> {
    [describe_options::<K>(), describe_options::<K::Common>()].concat()
}

fn generate<K: Kind>(seed: u64, given: &[(&str, f64)]) -> Result<Terrain> {
    let (mut own, mut common) = (K::defaults(), K::Common::defaults());
    for (name, value) in given {
        match (K::index_of(name), K::Common::index_of(name)) {
            (Some(index), _) => own.values_mut(index)[0] = *value,
            (None, Some(index)) => common.values_mut(index)[0] = *value,
            (None, None) => {
                let known: Vec<_> = K::FIELDS.iter().chain(K::Common::FIELDS).map(|field| field.name).collect();
                return Err(Error::unknown("parameter of the terrain", name, &known));
            }
        }
    }
    own.check_limits()?;
    common.check_limits()?;
    let mut terrain = own.terrain(&common, seed)?;
    // A plane has its recipe, without a seed.
    terrain.recipe.get_or_insert_with(|| {
        let names = K::FIELDS.iter().chain(K::Common::FIELDS).map(|field| field.name);
        let parameters = names.zip(own.numbers().into_iter().chain(common.numbers())).collect();
        Recipe { kind: K::NAME, seed, parameters }
    });
    Ok(terrain)
}

fields! {
    /// No parameters.
    pub struct Nothing {}
}

fields! {
    /// Parameters of planes.
    pub struct Plane {
        /// its slope
        pub slope: f64 = 0.1, "rad", SLOPES;
        /// angle from the x axis towards which it rises
        pub direction: f64 = 0.0, "rad", Limit::FINITE;
    }
}

impl Kind for Plane {
    const NAME: &'static str = "plane";
    const DOC: &'static str = "a plane through the origin, without edges";
    type Common = Nothing;

    fn terrain(&self, _: &Nothing, _: u64) -> Result<Terrain> {
        Terrain::plane(self.slope, self.direction)
    }
}

fields! {
    /// Parameters of waves.
    pub struct Wave {
        /// its steepest slope
        pub slope: f64 = 0.1, "rad", SLOPES;
        /// its length
        pub wavelength: f64 = 1.0, "m", LENGTHS;
        /// angle from the x axis along which it runs
        pub direction: f64 = 0.0, "rad", Limit::FINITE;
    }
}

impl Surface for Wave {
    const NAME: &'static str = "wave";
    const DOC: &'static str = "a sine wave; the origin is halfway up";

    fn height(&self, _: &Grid, _: u64) -> Result<Height> {
        let number = TAU / self.wavelength;
        let amplitude = self.slope.tan() / number;
        let (sin, cos) = self.direction.sin_cos();
        Ok(Box::new(move |x, y| amplitude * (number * (x * cos + y * sin)).sin()))
    }

    fn shortest(&self) -> f64 {
        self.wavelength
    }
}

fields! {
    /// Parameters of bowls.
    pub struct Bowl {
        /// the slope of the cone
        pub slope: f64 = 0.2, "rad", SLOPES;
        /// radius of curvature at the origin
        pub radius: f64 = 1.0, "m", LENGTHS;
    }
}

impl Surface for Bowl {
    const NAME: &'static str = "bowl";
    const DOC: &'static str = "a hyperboloid: a bowl at the origin that becomes a cone";

    fn height(&self, _: &Grid, _: u64) -> Result<Height> {
        let rise = self.slope.tan();
        let width = rise * self.radius;
        Ok(Box::new(move |x, y| rise * ((x * x + y * y + width * width).sqrt() - width)))
    }

    fn shortest(&self) -> f64 {
        f64::INFINITY
    }
}

fields! {
    /// Parameters of noise.
    pub struct Noise {
        /// the 95th percentile of its slope over all seeds
        pub slope: f64 = 0.15, "rad", SLOPES;
        /// length of the longest waves
        pub wavelength: f64 = 1.0, "m", LENGTHS;
        /// how many, a whole number
        pub octaves: f64 = 3.0, "", Limit::from(1.0).to(12.0);
        /// amplitude of an octave over the amplitude of the previous octave
        pub persistence: f64 = 0.25, "", Limit::above(0.0).to(1.0);
        /// wavelength of an octave over the wavelength of the next octave
        pub lacunarity: f64 = 2.0, "", Limit::from(1.0).to(10.0);
    }
}

impl Surface for Noise {
    const NAME: &'static str = "noise";
    const DOC: &'static str = "fractal noise: octaves of waves with random directions and phases";

    fn height(&self, _: &Grid, seed: u64) -> Result<Height> {
        check("octaves", self.octaves, "a whole number", |n| n.fract() == 0.0)?;
        let noise = noise::Noise::new(
            seed,
            self.slope.tan(),
            self.wavelength,
            self.octaves as usize,
            self.persistence,
            self.lacunarity,
        );
        Ok(Box::new(move |x, y| noise.at(x, y)))
    }

    fn shortest(&self) -> f64 {
        self.wavelength / self.lacunarity.powf(self.octaves - 1.0)
    }
}

fields! {
    /// Parameters of bumps.
    pub struct Bumps {
        /// the steepest slope of one bump; where bumps meet, slopes add up
        pub slope: f64 = 0.15, "rad", SLOPES;
        /// mean radius; each has from 0.7 to 1.3 times this
        pub radius: f64 = 0.4, "m", LENGTHS;
        /// bumps a square meter
        pub density: f64 = 1.0, "1/m^2", Limit::from(0.0).to(1e3);
    }
}

impl Surface for Bumps {
    const NAME: &'static str = "bumps";
    const DOC: &'static str = "round bumps at random places, half of them hollows";

    fn height(&self, grid: &Grid, seed: u64) -> Result<Height> {
        let (rise, radius) = (self.slope.tan(), self.radius);
        let half = [0.5 * grid.size_x, 0.5 * grid.size_y];
        let count = (self.density * 4.0 * half[0] * half[1]).round();
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
            (0..3).for_each(|offset| strips[strip(x) + offset].push((x, y, radius, height)));
        }
        Ok(Box::new(move |x, y| {
            let bump = |(bx, by, radius, height): &(f64, f64, f64, f64)| {
                let left = 1.0 - ((x - bx).powi(2) + (y - by).powi(2)) / (radius * radius);
                if left > 0.0 { height * left.powi(3) } else { 0.0 }
            };
            strips.get(strip(x) + 1).map_or(0.0, |strip| strip.iter().map(bump).sum())
        }))
    }

    fn shortest(&self) -> f64 {
        1.4 * self.radius
    }
}

fields! {
    /// Parameters of curbs.
    pub struct Curb {
        /// its steepest slope
        pub slope: f64 = 0.15, "rad", Limit::above(0.0).to(STEEPEST);
        /// how high it rises
        pub height: f64 = 0.01, "m", Limit::from(-10.0).to(10.0);
        /// x of its middle
        pub distance: f64 = 1.0, "m", Limit::FINITE;
    }
}

impl Surface for Curb {
    const NAME: &'static str = "curb";
    const DOC: &'static str = "a rounded step across the x axis";

    fn height(&self, _: &Grid, _: u64) -> Result<Height> {
        let (height, distance, width) = (self.height, self.distance, self.shortest());
        if width == 0.0 {
            return Ok(Box::new(|_, _| 0.0));
        }
        Ok(Box::new(move |x, _| height * smooth_step((x - distance) / width + 0.5)))
    }

    fn shortest(&self) -> f64 {
        STEP_SLOPE * self.height.abs() / self.slope.tan()
    }
}

fields! {
    /// Parameters of cobbles.
    pub struct Cobbles {
        /// its steepest slope
        pub slope: f64 = 0.1, "rad", SLOPES;
        /// distance of two cobbles
        pub wavelength: f64 = 0.3, "m", LENGTHS;
    }
}

impl Surface for Cobbles {
    const NAME: &'static str = "cobbles";
    const DOC: &'static str = "a regular field of short crossed waves, shifted at random";

    fn height(&self, _: &Grid, seed: u64) -> Result<Height> {
        let number = TAU / self.wavelength;
        let mut random = Uniform::new(seed, 2);
        let phases = [random.draw() * TAU, random.draw() * TAU];
        // The slope of cos u cos v is at most k times the amplitude.
        let amplitude = self.slope.tan() / number;
        Ok(Box::new(move |x, y| amplitude * (number * x + phases[0]).cos() * (number * y + phases[1]).cos()))
    }

    fn shortest(&self) -> f64 {
        self.wavelength
    }
}

fields! {
    /// Parameters of mixed terrains.
    pub struct Mix {
        /// the sum of the nominal slopes of its parts
        pub slope: f64 = 0.15, "rad", SLOPES;
        /// length of the waves
        pub wavelength: f64 = 1.0, "m", LENGTHS;
    }
}

impl Surface for Mix {
    const NAME: &'static str = "mix";
    const DOC: &'static str = "noise, bumps and waves across each other, each with a share of the slope";

    fn height(&self, grid: &Grid, seed: u64) -> Result<Height> {
        let (share, wavelength) = (|share: f64| (share * self.slope.tan()).atan(), self.wavelength);
        let direction = Uniform::new(seed, 3).draw() * TAU;
        let noise = Noise { slope: share(0.5), wavelength, ..Noise::default() };
        let bumps = Bumps { slope: share(0.25), radius: 0.5 * wavelength, ..Bumps::default() };
        let wave = Wave { slope: share(0.25), wavelength: 1.5 * wavelength, direction };
        let (noise, bumps) = (noise.checked_height(grid, seed)?, bumps.checked_height(grid, seed)?);
        let wave = wave.checked_height(grid, seed)?;
        Ok(Box::new(move |x, y| noise(x, y) + bumps(x, y) + wave(x, y)))
    }

    fn shortest(&self) -> f64 {
        self.wavelength
    }
}
