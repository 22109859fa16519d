//! Level ground with posts at random places, in tiles that differ in their number.

use super::kinds::Nothing;
use super::noise::Uniform;
use super::obstacles::{Obstacle, Post};
use super::parameters::{Kind, LENGTHS};
use super::{MOST_OBSTACLES, Terrain, Tiles};
use crate::error::{Result, check};
use crate::fields;
use crate::fields::Limit;

/// Radius of a post over the mean.
const RADII: [f64; 2] = [0.7, 1.3];

/// Tries per post; a tile has fewer posts where no more fit.
const TRIES: usize = 200;

fields! {
    /// Parameters of posts.
    pub struct Posts {
        /// posts a square meter in the tiles of the highest level
        pub density: f64 = 0.3, "1/m^2", Limit::from(0.0).to(100.0);
        /// mean radius of the posts; each has from 0.7 to 1.3 times this
        pub radius: f64 = 0.1, "m", LENGTHS;
        /// smallest gap between posts
        pub gap: f64 = 0.8, "m", LENGTHS;
        /// radius of the place without posts in the middle of a tile, where robots start
        pub clear: f64 = 0.8, "m", LENGTHS;
        /// side of a tile
        pub tile: f64 = 8.0, "m", LENGTHS;
        /// how many tiles each level has, a whole number
        pub tiles: f64 = 4.0, "", Limit::from(1.0).to(100.0);
        /// how many levels, a whole number; numbers of posts are multiples of the number at the first
        pub levels: f64 = 4.0, "", Limit::from(1.0).to(100.0);
        /// height of the posts
        pub height: f64 = 2.0, "m", LENGTHS;
        /// coefficient of friction of the posts
        pub friction: f64 = 0.3, "", Limit::from(0.0).to(10.0);
    }
}

impl Kind for Posts {
    const NAME: &'static str = "posts";
    const DOC: &'static str = "level ground with posts at random places, in tiles with more and more of them";
    type Common = Nothing;

    fn terrain(&self, _: &Nothing, seed: u64) -> Result<Terrain> {
        let whole = |name, number| check(name, number, "a whole number", |n: f64| n.fract() == 0.0);
        let tiles = Tiles {
            columns: whole("tiles", self.tiles)? as usize,
            levels: whole("levels", self.levels)? as usize,
            side: self.tile,
        };
        let largest = RADII[1] * self.radius;
        let least = 2.0 * (self.clear + largest) + self.gap;
        check("tile", self.tile, format_args!("at least {least} m, which posts around its middle take"), |t| {
            t >= least
        })?;
        let most = self.density * self.tile * self.tile;
        let all = most * (tiles.columns * tiles.levels) as f64;
        check("number of posts, density times the area,", all, format_args!("at most {MOST_OBSTACLES}"), |n| {
            n <= MOST_OBSTACLES as f64
        })?;
        let mut random = Uniform::new(seed, 2);
        let mut posts = Vec::new();
        for level in 0..tiles.levels {
            let wanted = (most * (level + 1) as f64 / self.levels).round() as usize;
            for column in 0..tiles.columns {
                self.add_tile(wanted, tiles.center(column, level), &mut random, &mut posts);
            }
        }
        let mut terrain = Terrain::plane(0.0, 0.0)?.with_obstacles(&posts)?;
        (terrain.added, terrain.recipe, terrain.tiles) = (0, None, Some(tiles));
        Ok(terrain)
    }
}

impl Posts {
    /// Adds up to `wanted` posts in the tile around `middle`.
    fn add_tile(&self, wanted: usize, middle: [f64; 2], random: &mut Uniform, posts: &mut Vec<Obstacle>) {
        let mut tile = Vec::<[f64; 3]>::with_capacity(wanted);
        for _ in 0..wanted * TRIES {
            if tile.len() == wanted {
                break;
            }
            let radius = self.radius * random.within(RADII);
            // Posts of neighboring tiles keep the gap, too.
            let half = 0.5 * (self.tile - self.gap) - radius;
            let [x, y] = [(); 2].map(|()| random.within([-half, half]));
            let keeps = |[px, py, other]: &[f64; 3]| (x - px).hypot(y - py) >= radius + other + self.gap;
            if x.hypot(y) >= self.clear + radius && tile.iter().all(keeps) {
                tile.push([x, y, radius]);
            }
        }
        posts.extend(tile.into_iter().map(|[x, y, radius]| {
            let (x, y) = (middle[0] + x, middle[1] + y);
            Obstacle::Post(Post { x, y, radius, height: self.height, friction: self.friction, ..Post::default() })
        }));
    }
}
