//! The height scan: heights of the ground at the points of a grid about the ball.

use super::channel::Reads;
use super::options::ScanOptions;
use super::view::View;
use ballbot_base::lanes::{Draws, Heading, run_one};
use ballbot_base::terrain::{PLACES, Terrain, each};

/// Largest magnitude of a height, m.
pub const BOUND: f32 = 1.0;

/// Typical magnitude of a height, m; a scaled observation is in multiples of it.
pub const TYPICAL: f32 = 0.1;

/// Block of random numbers of the drift, and first blocks of noise and dropout: four points share a block.
const DRIFT: u32 = 0;
const NOISE: u32 = 1 << 20;
const DROPOUT: u32 = 2 << 20;

/// A height scan.
#[derive(Clone, Debug)]
pub struct Scan {
    options: ScanOptions,
    /// Points in the heading frame, from the ball's center, m: x and y of eight at a time; the last places may be
    /// empty.
    points: Vec<[[f64; PLACES]; 2]>,
}

impl Scan {
    pub fn new(options: &ScanOptions) -> Self {
        let ScanOptions { points: [columns, rows], spacing, offset: [ahead, beside], .. } = *options;
        let along = |index: usize, count: f64| spacing * (index as f64 - 0.5 * (count - 1.0));
        let (width, count) = (columns as usize, (columns * rows) as usize);
        let point = |first: usize| {
            [each(|i| ahead + along((first + i) % width, columns)), each(|i| beside + along((first + i) / width, rows))]
        };
        Self { options: options.clone(), points: (0..count).step_by(PLACES).map(point).collect() }
    }
}

impl Reads for Scan {
    /// Constants of an episode: the error of the grid along the horizontal axes, and of its heights, m.
    fn constants(&self, draws: &Draws<f64>) -> [f64; 3] {
        let [horizontal, vertical] = self.options.drift;
        if [horizontal, vertical] == [0.0; 2] {
            return [0.0; 3];
        }
        let [x, y, z, _] = draws.normals(DRIFT);
        [x * horizontal, y * horizontal, z * vertical]
    }

    /// Writes how far the ground at each point is below the lowest point of the ball, m: 0 on level ground, points along
    /// heading x first. For the `first` scan there are no older heights.
    fn read(
        &self,
        view: &View,
        terrain: Option<&Terrain>,
        drift: &[f64; 3],
        draws: &Draws<f64>,
        first: bool,
        out: &mut [f32],
    ) {
        let ScanOptions { noise, dropout, .. } = self.options;
        let [x, y, z] = view.ball;
        let Heading { cos, sin } = Heading::new(view.quaternion());
        let (x, y) = (x + drift[0], y + drift[1]);
        let lowest = z - view.ball_radius + drift[2];
        let missing = |point: usize| {
            let units = draws.units(DROPOUT + (point / 4) as u32);
            units[point % 4] < dropout
        };
        run_one(
            #[inline(always)]
            || {
                for (chunk, (values, [ahead, beside])) in out.chunks_mut(PLACES).zip(&self.points).enumerate() {
                    let heights = match terrain {
                        Some(terrain) => {
                            let (mut at_x, mut at_y) = ([0.0; PLACES], [0.0; PLACES]);
                            for i in 0..PLACES {
                                at_x[i] = cos.mul_add(ahead[i], (-sin).mul_add(beside[i], x));
                                at_y[i] = sin.mul_add(ahead[i], cos.mul_add(beside[i], y));
                            }
                            terrain.heights_at(&at_x, &at_y)
                        }
                        None => [0.0; PLACES],
                    };
                    for (i, (value, height)) in values.iter_mut().zip(heights).enumerate() {
                        if dropout == 0.0 || first || !missing(chunk * PLACES + i) {
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
