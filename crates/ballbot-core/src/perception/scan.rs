//! The height scan: heights of the ground at the points of a grid about the ball.

use super::channel::Reads;
use super::options::ScanOptions;
use super::view::View;
use crate::lanes::{Draws, Heading, run_one};
use crate::terrain::Terrain;

/// Largest magnitude of a height, m.
pub const BOUND: f32 = 1.0;

/// Typical magnitude of a height, m, of which a scaled observation has multiples.
pub const TYPICAL: f32 = 0.1;

/// Block of random numbers of the drift, and the first ones of noise and dropout: four points share a block.
const DRIFT: u32 = 0;
const NOISE: u32 = 1 << 20;
const DROPOUT: u32 = 2 << 20;

/// A height scan.
#[derive(Clone, Debug)]
pub struct Scan {
    options: ScanOptions,
    points: [usize; 2],
}

impl Scan {
    pub fn new(options: &ScanOptions) -> Self {
        Self { options: options.clone(), points: options.points.map(|count| count as usize) }
    }
}

impl Reads for Scan {
    /// What is constant in an episode: the error of the grid along the horizontal axes, and of its heights, m.
    fn constants(&self, draws: &Draws<f64>) -> [f64; 3] {
        let [horizontal, vertical] = self.options.drift;
        if [horizontal, vertical] == [0.0; 2] {
            return [0.0; 3];
        }
        let [x, y, z, _] = draws.normals(DRIFT);
        [x * horizontal, y * horizontal, z * vertical]
    }

    /// Writes how far the ground at each point is below the lowest point of the ball, m: 0 on level ground, points along
    /// heading x first. `first` scans have no older heights.
    fn read(
        &self,
        view: &View,
        terrain: Option<&Terrain>,
        drift: &[f64; 3],
        draws: &Draws<f64>,
        first: bool,
        out: &mut [f32],
    ) {
        let ScanOptions { spacing, offset, noise, dropout, .. } = self.options;
        let [x, y, z] = view.ball;
        let heading = Heading::new(view.quaternion());
        let from = [0, 1].map(|axis| offset[axis] - 0.5 * spacing * (self.points[axis] - 1) as f64);
        let [sx, sy] = heading.to_inertial(from[0], from[1]);
        let (along, across) = ([heading.cos, heading.sin], [-heading.sin, heading.cos]);
        let (x, y) = (x + sx + drift[0], y + sy + drift[1]);
        let lowest = z - view.ball_radius + drift[2];
        let missing = |point: usize| {
            let units = draws.units(DROPOUT + (point / 4) as u32);
            units[point % 4] < dropout
        };
        run_one(
            #[inline(always)]
            || {
                for (j, row) in out.chunks_exact_mut(self.points[0]).enumerate() {
                    let beside = spacing * j as f64;
                    let (x, y) = (beside.mul_add(across[0], x), beside.mul_add(across[1], y));
                    for (i, value) in row.iter_mut().enumerate() {
                        let ahead = spacing * i as f64;
                        let height = match terrain {
                            Some(terrain) => terrain.height(ahead.mul_add(along[0], x), ahead.mul_add(along[1], y)),
                            None => 0.0,
                        };
                        if dropout == 0.0 || first || !missing(j * self.points[0] + i) {
                            *value = (lowest - height) as f32;
                        }
                    }
                }
            },
        );
        if noise > 0.0 {
            self.add_noise(draws, first, missing, out);
        }
        out.iter_mut().for_each(|value| *value = value.clamp(-BOUND, BOUND));
    }
}

impl Scan {
    fn add_noise(&self, draws: &Draws<f64>, first: bool, missing: impl Fn(usize) -> bool, out: &mut [f32]) {
        let is_kept = |point: usize| self.options.dropout > 0.0 && !first && missing(point);
        for (block, values) in out.chunks_mut(4).enumerate() {
            let normals = draws.normals(NOISE + block as u32);
            for (i, (value, normal)) in values.iter_mut().zip(normals).enumerate() {
                if !is_kept(4 * block + i) {
                    *value += (self.options.noise * normal) as f32;
                }
            }
        }
    }
}
