//! The ground: one smooth surface for models, sensors, pictures and export.
//!
//! A [`Terrain`] is the height of the ground over x and y, a spline with continuous second derivatives. A [`Ground`] is
//! a terrain with the surface on which the centers of balls of one radius move. Both are immutable and shared by all
//! robots on them.

mod frame;
mod ground;
mod kinds;
mod limits;
mod noise;
mod obstacles;
mod parameters;
mod patch;
mod placement;
mod places;
mod posts;
mod prism;
mod ray;
mod sharing;
mod spline;
mod tiled;
mod tiles;

pub use frame::Frame;
pub use ground::Ground;
pub use kinds::TerrainKind;
pub use limits::SlopeLimits;
pub use obstacles::{Block, MOST_OBSTACLES, Obstacle, Obstacles, Post, Wall, obstacle_kinds};
pub use patch::Patch;
pub use placement::static_lean;
pub use placement::upright_on;
pub use places::{PLACES, each};
pub use prism::Prism;
pub use ray::Rays;
pub use spline::{Height, Jet, Spline};
pub use tiles::Tiles;

use crate::error::{Error, Result, check};
use nalgebra::Vector3;

/// Steepest slope of a terrain, rad.
pub const STEEPEST: f64 = 1.05;

/// Largest height of a terrain, m.
const HIGHEST: f64 = 1000.0;

/// Distances of neighboring heights, m.
const CELLS: std::ops::RangeInclusive<f64> = 1e-4..=1e3;

/// Largest number of heights of a terrain: 40 m by 40 m in steps of 2 cm, which takes seconds.
pub const MOST_NODES: usize = 1 << 22;

/// The ground's height over x and y.
#[derive(Clone, Debug, PartialEq)]
pub struct Terrain {
    surface: Spline,
    /// Half lengths along x and y, m; infinite for a plane.
    half_size: [f64; 2],
    /// Gradient of a plane.
    plane: Option<[f64; 2]>,
    steepness: Steepness,
    fingerprint: u64,
    recipe: Option<Recipe>,
    tiles: Option<Tiles>,
    obstacles: Obstacles,
    /// Number of the obstacles that are not of its recipe.
    added: usize,
}

/// Inputs from which a generator creates a terrain.
#[derive(Clone, Debug, PartialEq)]
pub struct Recipe {
    /// Name of its [`TerrainKind`].
    pub kind: &'static str,
    /// Seed of its random numbers.
    pub seed: u64,
    /// All parameters of the kind.
    pub parameters: Vec<(&'static str, f64)>,
}

/// Extremes of a terrain.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Steepness {
    /// Steepest slope, rad, and its tangent.
    slope: f64,
    rise: f64,
    /// Largest curvature of valleys, 1/m.
    valley: f64,
    /// Largest curvature of crests, 1/m.
    crest: f64,
    /// Largest second derivative in any direction, 1/m; at least zero.
    bend: f64,
    lowest: f64,
    highest: f64,
}

impl Terrain {
    /// A plane through the origin with the angle `slope`, rad, that rises towards `direction`, an angle from the x
    /// axis, rad.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a slope that is not between 0 and [`STEEPEST`], and a direction that is not finite.
    pub fn plane(slope: f64, direction: f64) -> Result<Self> {
        let steepest = format_args!("from 0 to {STEEPEST} rad");
        let slope = check("slope", slope, steepest, |s| (0.0..=STEEPEST).contains(&s))?;
        let direction = check("direction", direction, "finite, rad", |_| true)?;
        let gradient = [slope.tan() * direction.cos(), slope.tan() * direction.sin()];
        let [x, y] = gradient;
        let heights = [-x - y, x - y, y - x, x + y];
        let mut terrain = Self::of(Spline::through(&heights, [2, 2], [-1.0; 2], 2.0))?;
        terrain.half_size = [f64::INFINITY; 2];
        terrain.plane = Some(gradient);
        let parameters = vec![("slope", slope), ("direction", direction)];
        terrain.recipe = Some(Recipe { kind: "plane", seed: 0, parameters });
        terrain.steepness = Steepness { slope, rise: slope.tan(), ..Steepness::default() };
        Ok(terrain)
    }

    /// A surface through `heights`, m: `nodes[1]` rows along y of `nodes[0]` numbers along x, with `cell` meters between
    /// neighbors and the origin in the middle.
    ///
    /// # Errors
    /// [`Error::Length`] or [`Error::OutOfRange`] for invalid sizes and heights beyond ±1000 m; [`Error::Inconsistent`]
    /// for a surface steeper than [`STEEPEST`], with its location.
    pub fn from_heights(heights: &[f64], nodes: [usize; 2], cell: f64) -> Result<Self> {
        let [nx, ny] = check_nodes(nodes, cell)?;
        let count = nx * ny;
        if heights.len() != count {
            return Err(Error::Length { name: "heights".into(), found: heights.len(), expected: count });
        }
        for (i, &height) in heights.iter().enumerate() {
            if height.is_nan() || height.abs() > HIGHEST {
                let name = format!("heights[{}, {}]", i / nx, i % nx);
                return Err(Error::OutOfRange { name, value: height, limit: format!("within ±{HIGHEST} m") });
            }
        }
        Self::of(Spline::through(heights, nodes, corner_of(nodes, cell), cell))
    }

    /// The terrain with these surface coefficients ([`Spline::coefficients`]): an exact copy.
    ///
    /// # Errors
    /// As [`Terrain::from_heights`].
    pub fn from_coefficients(coefficients: &[f64], nodes: [usize; 2], cell: f64) -> Result<Self> {
        let [nx, ny] = check_nodes(nodes, cell)?;
        let count = (nx + 2) * (ny + 2);
        if coefficients.len() != count {
            return Err(Error::Length { name: "coefficients".into(), found: coefficients.len(), expected: count });
        }
        // A coefficient is within a few times the largest height.
        for &value in coefficients {
            check("coefficients", value, format_args!("within ±{} m", 10.0 * HIGHEST), |v| v.abs() <= 10.0 * HIGHEST)?;
        }
        Self::of(Spline::of_coefficients(coefficients.to_vec(), nodes, corner_of(nodes, cell), cell))
    }

    /// The surface of a function of x and y, m, over a rectangle of the given lengths along x and y around the origin,
    /// sampled in steps of at most `cell`.
    ///
    /// # Errors
    /// As [`Terrain::from_heights`]; [`Error::OutOfRange`] for lengths that are not above zero.
    pub fn from_function(height: impl Fn(f64, f64) -> f64, size: [f64; 2], cell: f64) -> Result<Self> {
        let (nodes, cell) = Self::grid(size, cell)?;
        let place = |i: usize, axis: usize| Self::node(nodes, cell, i, axis);
        let mut heights = crate::memory::try_zeros::<f64>("heights of a terrain", &nodes)?;
        for (row, heights) in heights.chunks_exact_mut(nodes[0]).enumerate() {
            for (column, value) in heights.iter_mut().enumerate() {
                *value = height(place(column, 0), place(row, 1));
            }
        }
        Self::from_heights(&heights, nodes, cell)
    }

    /// Nodes along x and y and their distance, m, for [`Terrain::from_function`].
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for invalid lengths or an invalid cell, and for more nodes than a terrain may have.
    pub fn grid(size: [f64; 2], cell: f64) -> Result<([usize; 2], f64)> {
        check_cell(cell)?;
        for (name, length) in [("size along x", size[0]), ("size along y", size[1])] {
            check(name, length, format_args!("at least 3 cells of {cell} m"), |s| s >= 3.0 * cell)?;
            check(name, length, format_args!("at most {MOST_NODES} cells"), |s| s / cell <= MOST_NODES as f64)?;
        }
        // The lengths are a whole number of cells: the length along x exactly, the other rounded up by less than a
        // cell.
        let along = (size[0] / cell - 1e-9).ceil();
        let cell = size[0] / along;
        let nodes = [along as usize + 1, (size[1] / cell - 1e-9).ceil() as usize + 1];
        check_count(nodes)?;
        Ok((nodes, cell))
    }

    /// Coordinate along an axis of node `i` of such a grid, centered at the origin.
    pub fn node(nodes: [usize; 2], cell: f64, i: usize, axis: usize) -> f64 {
        i as f64 * cell - half_of(nodes, cell)[axis]
    }

    fn of(surface: Spline) -> Result<Self> {
        let steepness = Steepness::of(&surface)?;
        Ok(Self {
            half_size: half_of(surface.nodes(), surface.cell()),
            plane: None,
            steepness,
            fingerprint: surface.fingerprint(),
            recipe: None,
            tiles: None,
            obstacles: Obstacles::default(),
            added: 0,
            surface,
        })
    }

    /// Height at x and y, m. Beyond its edges the terrain continues straight with the slope at the edge.
    pub fn height(&self, x: f64, y: f64) -> f64 {
        self.surface.jet(x, y).z
    }

    /// Heights at several places; for code that [`crate::lanes::run_one`] dispatches.
    #[inline(always)]
    pub fn heights_at<const N: usize>(&self, x: &[f64; N], y: &[f64; N]) -> [f64; N] {
        let [half_x, half_y] = self.half_size;
        let mut outside = false;
        for i in 0..N {
            outside |= x[i].abs() > half_x || y[i].abs() > half_y;
        }
        if outside || self.plane.is_some() {
            return each(|i| self.height(x[i], y[i]));
        }
        self.surface.heights_at(x, y)
    }

    /// Upward unit normal of the ground at x and y.
    pub fn normal(&self, x: f64, y: f64) -> Vector3<f64> {
        normal_of(self.surface.jet(x, y).gradient)
    }

    /// Derivatives of the height with respect to x and y.
    pub fn gradient(&self, x: f64, y: f64) -> [f64; 2] {
        self.surface.jet(x, y).gradient
    }

    /// Angle between the ground at x and y and the horizontal plane, rad.
    pub fn slope_at(&self, x: f64, y: f64) -> f64 {
        let [gx, gy] = self.gradient(x, y);
        gx.hypot(gy).atan()
    }

    /// Principal curvatures at x and y, 1/m, the larger first; valleys are positive, crests negative.
    pub fn curvatures_at(&self, x: f64, y: f64) -> [f64; 2] {
        curvatures(&self.surface.jet(x, y))
    }

    /// Steepest slope anywhere, rad.
    pub fn slope(&self) -> f64 {
        self.steepness.slope
    }

    /// Largest curvature of a valley and of a crest anywhere, 1/m.
    pub fn curvature(&self) -> [f64; 2] {
        [self.steepness.valley, self.steepness.crest]
    }

    /// Least and largest height on the grid, m; for a plane, the heights within 1 m of the origin along x and y.
    pub fn heights(&self) -> [f64; 2] {
        [self.steepness.lowest, self.steepness.highest]
    }

    /// Half lengths along x and y, m; infinite for a plane.
    pub fn half_size(&self) -> [f64; 2] {
        self.half_size
    }

    /// Whether x and y are on the terrain.
    pub fn contains(&self, x: f64, y: f64) -> bool {
        x.abs() <= self.half_size[0] && y.abs() <= self.half_size[1]
    }

    /// Gradient of a plane; `None` for any other surface.
    pub fn as_plane(&self) -> Option<[f64; 2]> {
        self.plane
    }

    /// The surface.
    pub fn surface(&self) -> &Spline {
        &self.surface
    }

    /// Its generator inputs; `None` for heights and functions.
    pub fn recipe(&self) -> Option<&Recipe> {
        self.recipe.as_ref()
    }

    /// Its tiles, if it has any.
    pub fn tiles(&self) -> Option<&Tiles> {
        self.tiles.as_ref()
    }

    /// The terrain with more obstacles.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a parameter outside its limit, and for more than [`MOST_OBSTACLES`].
    pub fn with_obstacles(mut self, more: &[Obstacle]) -> Result<Self> {
        let shapes = [self.obstacles.shapes(), more].concat();
        self.obstacles = Obstacles::new(&self, shapes)?;
        self.added += more.len();
        // Their numbers of parameters differ by kind.
        let shapes = self.obstacles.shapes();
        let numbers = shapes.iter().flat_map(|one| one.parameters().into_iter().map(|(_, value)| value));
        self.fingerprint = spline::hash(self.surface.fingerprint(), numbers);
        Ok(self)
    }

    /// Its obstacles.
    pub fn obstacles(&self) -> &Obstacles {
        &self.obstacles
    }

    /// Its obstacles that are not of its recipe.
    pub fn added_obstacles(&self) -> &[Obstacle] {
        let shapes = self.obstacles.shapes();
        &shapes[shapes.len() - self.added..]
    }

    /// Whether the ground is the plane z = 0.
    pub fn is_level(&self) -> bool {
        self.plane == Some([0.0; 2])
    }

    /// A number that differs between different terrains with a probability of 1 - 2⁻⁶⁴.
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// Largest second derivative of the height in any direction, 1/m; at least zero.
    pub fn bend(&self) -> f64 {
        self.steepness.bend
    }
}

/// Checks the node counts along x and y of a terrain and the node distance.
fn check_nodes(nodes: [usize; 2], cell: f64) -> Result<[usize; 2]> {
    check_cell(cell)?;
    for (name, count) in [("heights along x", nodes[0]), ("heights along y", nodes[1])] {
        check(name, count as f64, "at least 4", |n| n >= 4.0)?;
    }
    check_count(nodes)?;
    Ok(nodes)
}

fn check_cell(cell: f64) -> Result<()> {
    let words = format_args!("from {} to {} m", CELLS.start(), CELLS.end());
    check("cell", cell, words, |c| CELLS.contains(&c)).map(|_| ())
}

fn check_count([nx, ny]: [usize; 2]) -> Result<()> {
    let (count, words) = (nx.saturating_mul(ny), format_args!("at most {MOST_NODES}"));
    check("number of heights", count as f64, words, |n| n <= MOST_NODES as f64).map(|_| ())
}

/// Half lengths along x and y of a grid, m.
fn half_of(nodes: [usize; 2], cell: f64) -> [f64; 2] {
    nodes.map(|count| 0.5 * cell * (count - 1) as f64)
}

/// Position of the first node of a terrain centered at the origin.
fn corner_of(nodes: [usize; 2], cell: f64) -> [f64; 2] {
    half_of(nodes, cell).map(|half| -half)
}

/// Upward unit normal of a surface with this gradient.
pub fn normal_of([gx, gy]: [f64; 2]) -> Vector3<f64> {
    Vector3::new(-gx, -gy, 1.0).normalize()
}

/// Principal curvatures, the larger first.
fn curvatures(jet: &Jet) -> [f64; 2] {
    let ([gx, gy], [xx, xy, yy]) = (jet.gradient, jet.hessian);
    let square = gx.mul_add(gx, gy.mul_add(gy, 1.0));
    let mean = ((1.0 + gy * gy) * xx - 2.0 * gx * gy * xy + (1.0 + gx * gx) * yy) / (2.0 * square * square.sqrt());
    let gauss = (xx * yy - xy * xy) / (square * square);
    let half = (mean * mean - gauss).max(0.0).sqrt();
    [mean + half, mean - half]
}

impl Steepness {
    /// Extremes at the nodes and in the middle of edges and cells: between them second derivatives vary at most linearly
    /// along x and y.
    fn of(surface: &Spline) -> Result<Self> {
        let [nx, ny] = surface.nodes();
        let mut out = Self { lowest: f64::INFINITY, highest: f64::NEG_INFINITY, ..Self::default() };
        let (mut most, mut steepest) = (0.0, [0.0; 2]);
        for j in 0..2 * ny - 1 {
            for i in 0..2 * nx - 1 {
                let [x, y] = surface.node(0, 0);
                let [x, y] = [x + 0.5 * i as f64 * surface.cell(), y + 0.5 * j as f64 * surface.cell()];
                let jet = surface.jet(x, y);
                let [gx, gy] = jet.gradient;
                let rise = gx.mul_add(gx, gy * gy);
                if rise > most {
                    (most, steepest) = (rise, [x, y]);
                }
                let [valley, crest] = curvatures(&jet);
                let [xx, xy, yy] = jet.hessian;
                out.valley = out.valley.max(valley);
                out.crest = out.crest.max(-crest);
                out.bend = out.bend.max(0.5 * (xx + yy) + (0.5 * (xx - yy)).hypot(xy));
                out.lowest = out.lowest.min(jet.z);
                out.highest = out.highest.max(jet.z);
            }
        }
        out.rise = most.sqrt();
        out.slope = out.rise.atan();
        if out.slope > STEEPEST {
            let [x, y] = steepest;
            return Err(Error::Inconsistent(format!(
                "the terrain has a slope of {:.3} rad at x = {x:.3} m, y = {y:.3} m; a ground has at most {STEEPEST} rad: smooth \
                 or lower its heights, or take a larger cell",
                out.slope
            )));
        }
        Ok(out)
    }
}
