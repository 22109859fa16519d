//! Static obstacles on a terrain: posts, boxes and walls.

use super::Terrain;
use super::prism::Prism;
use crate::error::{Error, Result, check};
use crate::fields;
use crate::fields::{Fields, Limit, OptionDescription, describe_options};
use crate::lanes::Vec3;
use std::f64::consts::PI;

/// Largest number of obstacles of a terrain.
pub const MOST_OBSTACLES: usize = 4096;

/// Half the thickness of a wall, m: beyond the positions of states.
const THICK: f64 = 1e5;

/// Depth to which an obstacle extends below the ground at its place, m: nothing is below it.
const BURIED: f64 = 100.0;

const PLACES: Limit = Limit::from(-1e4).to(1e4);
const SIZES: Limit = Limit::from(1e-3).to(1e3);
const HEIGHTS: Limit = Limit::from(1e-3).to(1e3);
const ANGLES: Limit = Limit::from(-PI).to(PI);
const FRICTION: Limit = Limit::from(0.0).to(10.0);
/// With more, impacts with friction at several points could add energy.
const RESTITUTION: Limit = Limit::from(0.0).to(0.5);

fields! {
    /// A round post.
    pub struct Post {
        /// x of its axis
        pub x: f64 = 0.0, "m", PLACES;
        /// y of its axis
        pub y: f64 = 0.0, "m", PLACES;
        /// its radius
        pub radius: f64 = 0.1, "m", SIZES;
        /// height above the ground at its axis
        pub height: f64 = 2.0, "m", HEIGHTS;
        /// coefficient of friction
        pub friction: f64 = 0.3, "", FRICTION;
        /// speed after an impact over the speed before
        pub restitution: f64 = 0.0, "", RESTITUTION;
    }
}

fields! {
    /// A box with vertical sides.
    pub struct Block {
        /// x of its center
        pub x: f64 = 0.0, "m", PLACES;
        /// y of its center
        pub y: f64 = 0.0, "m", PLACES;
        /// angle from the x axis to its length
        pub yaw: f64 = 0.0, "rad", ANGLES;
        /// its length
        pub length: f64 = 1.0, "m", SIZES;
        /// its width
        pub width: f64 = 0.2, "m", SIZES;
        /// height above the ground at its center
        pub height: f64 = 2.0, "m", HEIGHTS;
        /// coefficient of friction
        pub friction: f64 = 0.3, "", FRICTION;
        /// speed after an impact over the speed before
        pub restitution: f64 = 0.0, "", RESTITUTION;
    }
}

fields! {
    /// A wall without ends: everything behind a vertical plane.
    pub struct Wall {
        /// x of a point of its face
        pub x: f64 = 0.0, "m", PLACES;
        /// y of a point of its face
        pub y: f64 = 0.0, "m", PLACES;
        /// angle from the x axis to the direction that its face looks
        pub yaw: f64 = 0.0, "rad", ANGLES;
        /// coefficient of friction
        pub friction: f64 = 0.3, "", FRICTION;
        /// speed after an impact over the speed before
        pub restitution: f64 = 0.0, "", RESTITUTION;
    }
}

/// An obstacle.
#[derive(Clone, Debug, PartialEq)]
pub enum Obstacle {
    /// A round post.
    Post(Post),
    /// A box.
    Box(Block),
    /// A wall.
    Wall(Wall),
}

/// Names of the kinds of obstacles, each with its parameters.
pub fn obstacle_kinds() -> [(&'static str, Vec<OptionDescription>); 3] {
    [("post", describe_options::<Post>()), ("box", describe_options::<Block>()), ("wall", describe_options::<Wall>())]
}

impl Obstacle {
    /// An obstacle of a kind; an omitted parameter has its default.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for an unknown kind or parameter.
    pub fn named(kind: &str, parameters: &[(&str, f64)]) -> Result<Self> {
        let mut obstacle = match kind {
            "post" => Self::Post(Post::default()),
            "box" => Self::Box(Block::default()),
            "wall" => Self::Wall(Wall::default()),
            _ => return Err(Error::unknown("kind of obstacle", kind, &["post", "box", "wall"])),
        };
        for (name, value) in parameters {
            match &mut obstacle {
                Self::Post(post) => set(post, name, *value),
                Self::Box(block) => set(block, name, *value),
                Self::Wall(wall) => set(wall, name, *value),
            }?;
        }
        Ok(obstacle)
    }

    /// Name of its kind.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Post(_) => "post",
            Self::Box(_) => "box",
            Self::Wall(_) => "wall",
        }
    }

    /// Its parameters by name.
    pub fn parameters(&self) -> Vec<(&'static str, f64)> {
        match self {
            Self::Post(post) => by_name(post),
            Self::Box(block) => by_name(block),
            Self::Wall(wall) => by_name(wall),
        }
    }

    fn check_limits(&self) -> Result<()> {
        match self {
            Self::Post(post) => post.check_limits(),
            Self::Box(block) => block.check_limits(),
            Self::Wall(wall) => wall.check_limits(),
        }
    }

    /// Its shape on a terrain.
    fn prism(&self, terrain: &Terrain) -> Prism<f64> {
        let upright = |x: f64, y: f64, height: f64| {
            let half = 0.5 * (height + BURIED);
            (Vec3 { x, y, z: terrain.height(x, y) + height - half }, half)
        };
        match self {
            Self::Post(post) => {
                let (center, half) = upright(post.x, post.y, post.height);
                Prism {
                    center,
                    half: Vec3 { x: 0.0, y: 0.0, z: half },
                    axis: [1.0, 0.0],
                    radius: post.radius,
                    friction: post.friction,
                    restitution: post.restitution,
                }
            }
            Self::Box(block) => {
                let (center, half) = upright(block.x, block.y, block.height);
                Prism {
                    center,
                    half: Vec3 { x: 0.5 * block.length, y: 0.5 * block.width, z: half },
                    axis: [block.yaw.cos(), block.yaw.sin()],
                    radius: 0.0,
                    friction: block.friction,
                    restitution: block.restitution,
                }
            }
            Self::Wall(wall) => {
                let axis = [wall.yaw.cos(), wall.yaw.sin()];
                Prism {
                    center: Vec3 { x: wall.x - THICK * axis[0], y: wall.y - THICK * axis[1], z: 0.0 },
                    half: Vec3 { x: THICK, y: f64::INFINITY, z: f64::INFINITY },
                    axis,
                    radius: 0.0,
                    friction: wall.friction,
                    restitution: wall.restitution,
                }
            }
        }
    }
}

fn set<F: Fields>(fields: &mut F, name: &str, value: f64) -> Result<()> {
    let Some(index) = F::index_of(name) else {
        let known: Vec<_> = F::FIELDS.iter().map(|field| field.name).collect();
        return Err(Error::unknown("parameter of the obstacle", name, &known));
    };
    fields.values_mut(index)[0] = value;
    Ok(())
}

fn by_name<F: Fields>(fields: &F) -> Vec<(&'static str, f64)> {
    F::FIELDS.iter().map(|field| field.name).zip(fields.numbers()).collect()
}

/// The obstacles of a terrain.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Obstacles {
    shapes: Vec<Obstacle>,
    prisms: Vec<Prism<f64>>,
    /// Radius about its center of a circle around the outline of each.
    reach: Vec<f64>,
}

impl Obstacles {
    pub(super) fn new(terrain: &Terrain, shapes: Vec<Obstacle>) -> Result<Self> {
        let most = format_args!("at most {MOST_OBSTACLES}");
        check("number of obstacles", shapes.len() as f64, most, |n| n <= MOST_OBSTACLES as f64)?;
        for (i, shape) in shapes.iter().enumerate() {
            shape.check_limits().map_err(|error| error.of_option(&format!("obstacles[{i}]")))?;
        }
        let prisms: Vec<_> = shapes.iter().map(|shape| shape.prism(terrain)).collect();
        let reach = prisms.iter().map(|prism| prism.half.x.hypot(prism.half.y) + prism.radius).collect();
        Ok(Self { shapes, prisms, reach })
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.shapes.is_empty()
    }

    /// The obstacles.
    pub fn shapes(&self) -> &[Obstacle] {
        &self.shapes
    }

    /// Their shapes on the terrain.
    pub fn prisms(&self) -> &[Prism<f64>] {
        &self.prisms
    }

    /// Radius of a circle about the center of each that contains its outline, m.
    pub fn reach(&self) -> &[f64] {
        &self.reach
    }

    /// Distance of a point from the nearest obstacle, m, negative inside; infinite if there are none.
    pub fn distance(&self, [x, y, z]: [f64; 3]) -> f64 {
        let point = Vec3 { x, y, z };
        self.prisms.iter().map(|prism| prism.distance(point).0).fold(f64::INFINITY, f64::min)
    }

    /// Horizontal distance of a place from the nearest outline, m, negative inside; infinite if there are none.
    pub fn aside(&self, [x, y]: [f64; 2]) -> f64 {
        let place = Vec3 { x, y, z: 0.0 };
        self.prisms.iter().map(|prism| prism.aside(place)).fold(f64::INFINITY, f64::min)
    }

    /// Distance of a straight part of a robot from the nearest obstacle, m: of the cylinder of a `radius` about the
    /// segment between two points, with round ends.
    pub fn distance_of_segment(&self, ends: [[f64; 3]; 2], radius: f64) -> f64 {
        let [from, to] = ends.map(|[x, y, z]| Vec3 { x, y, z });
        let nearest = |prism: &Prism<f64>| prism.distance(prism.nearest_of_segment(from, to)).0;
        self.prisms.iter().map(nearest).fold(f64::INFINITY, f64::min) - radius
    }

    /// The first fraction of `direction`, up to `limit`, at which a ray from `origin` enters an obstacle, and the outward
    /// normal there. Rays from inside enter at 0.
    pub fn cast(&self, origin: [f64; 3], direction: [f64; 3], limit: f64) -> Option<(f64, [f64; 3])> {
        let mut first = None;
        let mut nearest = limit;
        for (prism, reach) in self.prisms.iter().zip(&self.reach) {
            if misses(prism, *reach, origin, direction, nearest) {
                continue;
            }
            if let Some(share) = prism.entered(origin, direction).filter(|share| *share < nearest) {
                nearest = share;
                let at: [f64; 3] = std::array::from_fn(|i| direction[i].mul_add(share, origin[i]));
                let (_, normal) = prism.distance(Vec3 { x: at[0], y: at[1], z: at[2] });
                first = Some((share, [normal.x, normal.y, normal.z]));
            }
        }
        first
    }
}

/// Whether a ray surely misses the circle of `reach` about the axis of a prism, or reaches it after `limit`.
fn misses(prism: &Prism<f64>, reach: f64, origin: [f64; 3], direction: [f64; 3], limit: f64) -> bool {
    let (x, y) = (prism.center.x - origin[0], prism.center.y - origin[1]);
    let (dx, dy) = (direction[0], direction[1]);
    let squared = x.mul_add(x, y * y);
    if squared <= reach * reach {
        return false;
    }
    let (along, across, length) = (x.mul_add(dx, y * dy), x.mul_add(dy, -(y * dx)), dx.mul_add(dx, dy * dy));
    along <= 0.0 || across * across > reach * reach * length || along - reach * length.sqrt() > limit * length
}

impl Prism<f64> {
    /// The point of a segment that is nearest to the prism.
    pub fn nearest_of_segment(&self, from: Vec3<f64>, to: Vec3<f64>) -> Vec3<f64> {
        crate::lanes::run_one(
            #[inline(always)]
            || self.nearest_on(from, to),
        )
    }

    /// The fraction of `direction` at which a ray from `origin` enters the prism; 0 inside.
    fn entered(&self, origin: [f64; 3], direction: [f64; 3]) -> Option<f64> {
        let [cos, sin] = self.axis;
        let turned = |[x, y, z]: [f64; 3]| [cos * x + sin * y, cos * y - sin * x, z];
        let from = turned([origin[0] - self.center.x, origin[1] - self.center.y, origin[2] - self.center.z]);
        let along = turned(direction);
        if self.radius > 0.0 {
            return of_cylinder(from, along, self.radius, self.half.z);
        }
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for ((from, along), half) in from.into_iter().zip(along).zip([self.half.x, self.half.y, self.half.z]) {
            let [low, high] = between(from, along, half)?;
            (enter, leave) = (enter.max(low), leave.min(high));
        }
        (enter <= leave).then_some(enter)
    }
}

/// Fractions between which a coordinate of a ray is within ±`half`.
fn between(from: f64, along: f64, half: f64) -> Option<[f64; 2]> {
    if along == 0.0 || half == f64::INFINITY {
        return (from.abs() <= half).then_some([f64::NEG_INFINITY, f64::INFINITY]);
    }
    let (a, b) = ((-half - from) / along, (half - from) / along);
    Some([a.min(b), a.max(b)])
}

/// As [`Prism::entered`], of an upright cylinder at the origin.
fn of_cylinder([x, y, z]: [f64; 3], [dx, dy, dz]: [f64; 3], radius: f64, half: f64) -> Option<f64> {
    let [low, high] = between(z, dz, half)?;
    let (square, cross, rest) = (dx * dx + dy * dy, x * dx + y * dy, x * x + y * y - radius * radius);
    let [near, far] = if square == 0.0 {
        (rest <= 0.0).then_some([f64::NEG_INFINITY, f64::INFINITY])?
    } else {
        let root = cross * cross - square * rest;
        (root >= 0.0).then(|| [(-cross - root.sqrt()) / square, (-cross + root.sqrt()) / square])?
    };
    let (enter, leave) = (low.max(near).max(0.0), high.min(far));
    (enter <= leave).then_some(enter)
}
