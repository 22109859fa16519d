//! The height scan: heights of the ground at the points of a grid about the ball.

use super::instrument::{Instrument, Random, Range, Reads, Sample};
use ballbot_base::fields;
use ballbot_base::fields::Limit;
use ballbot_base::lanes::{Heading, run_one};
use ballbot_base::options::OptionTable;
use ballbot_base::terrain::{PLACES, each};

/// Largest magnitude of a height, m.
const BOUND: f32 = 1.0;

/// Block of random numbers of the drift, and first blocks of noise and dropout: four points share a block.
const DRIFT: u32 = 0;
const NOISE: u32 = 1 << 20;
const DROPOUT: u32 = 2 << 20;

fields! {
    /// Heights of the ground at the points of a grid about the ball that turns with the robot's heading. SI units and
    /// radians.
    pub struct ScanOptions {
        /// Points along heading x and y, whole numbers.
        pub points: [f64; 2] = [11.0, 11.0], "", Limit::from(1.0).to(256.0);
        /// Distance of neighboring points.
        pub spacing: f64 = 0.1, "m", Limit::from(1e-3).to(10.0);
        /// Middle of the grid from the ball's center, heading x and y.
        pub offset: [f64; 2] = [0.0; 2], "m", Limit::from(-10.0).to(10.0);
        /// Scans in a second, held in between; 0: one at each control step, which is also the maximum.
        pub rate: f64 = 25.0, "Hz", Limit::from(0.0).to(1e6);
        /// Age of a scan when it is read, a whole number of control steps; at most 100 of them.
        pub latency: f64 = 0.0, "s", Limit::from(0.0).to(100.0);
        /// Standard deviation of the noise of each height.
        pub noise: f64 = 0.0, "m", Limit::from(0.0).to(10.0);
        /// Fraction of the heights that are missing in a scan; they keep what was read before.
        pub dropout: f64 = 0.0, "", Limit::from(0.0).to(1.0);
        /// Standard deviations of an error of the whole grid along each horizontal axis, and of all heights, sampled for each
        /// episode.
        pub drift: [f64; 2] = [0.0; 2], "m", Limit::from(0.0).to(10.0);
    }
}

impl OptionTable for ScanOptions {
    const NAME: &'static str = "scan";
}

impl Instrument for ScanOptions {
    const TITLE: &'static str = "Height scan";
    const ABOUT: &'static str = "\
A grid of points about the ball that turns with the heading. A reading is `z_ball - ball_radius - height(x, y)`: 0 on
level ground, positive over lower ground, within ±1 m. Rows are along heading y, columns along heading x; in an
observation the columns of the first row come first. Scaled observations are in units of 0.1 m.";

    fn lengths(&self) -> (&'static str, &[f64]) {
        ("points", &self.points)
    }

    fn timing(&self) -> [f64; 2] {
        [self.rate, self.latency]
    }

    fn range(&self) -> Range {
        let bound = f64::from(BOUND);
        Range { low: -bound, high: bound, typical: 0.1 }
    }

    fn reader(&self) -> Box<dyn Reads> {
        Box::new(Scan::new(self))
    }
}

/// A height scan.
#[derive(Clone, Debug)]
struct Scan {
    options: ScanOptions,
    /// Points in the heading frame, from the ball's center, m: x and y of eight at a time; the last places may be
    /// empty.
    points: Vec<[[f64; PLACES]; 2]>,
}

impl Scan {
    fn new(options: &ScanOptions) -> Self {
        let ScanOptions { points: [columns, rows], spacing, offset: [ahead, lateral], .. } = *options;
        let along = |index: usize, count: f64| spacing * (index as f64 - 0.5 * (count - 1.0));
        let (width, count) = (columns as usize, (columns * rows) as usize);
        let point = |first: usize| {
            [
                each(|i| ahead + along((first + i) % width, columns)),
                each(|i| lateral + along((first + i) / width, rows)),
            ]
        };
        Self { options: options.clone(), points: (0..count).step_by(PLACES).map(point).collect() }
    }
}

impl Reads for Scan {
    /// Constants of an episode: the error of the grid along the horizontal axes, and of its heights, m.
    fn constants(&self, random: &Random) -> [f64; 3] {
        let [horizontal, vertical] = self.options.drift;
        if [horizontal, vertical] == [0.0; 2] {
            return [0.0; 3];
        }
        let [x, y, z, _] = random.normals(DRIFT);
        [x * horizontal, y * horizontal, z * vertical]
    }

    /// Writes how far the ground at each point is below the lowest point of the ball, m: 0 on level ground, points along
    /// heading x first. For the first scan there are no older heights.
    fn read(&self, sample: &Sample, out: &mut [f32]) {
        let Sample { view, terrain, constants: drift, random, is_first } = *sample;
        let ScanOptions { noise, dropout, .. } = self.options;
        let [x, y, z] = view.ball;
        let Heading { cos, sin } = Heading::new(view.quaternion());
        let (x, y) = (x + drift[0], y + drift[1]);
        let lowest = z - view.ball_radius + drift[2];
        let missing = |point: usize| {
            let units = random.units(DROPOUT + (point / 4) as u32);
            units[point % 4] < dropout
        };
        run_one(
            #[inline(always)]
            || {
                for (chunk, (values, [ahead, lateral])) in out.chunks_mut(PLACES).zip(&self.points).enumerate() {
                    let heights = match terrain {
                        Some(terrain) => {
                            let (mut at_x, mut at_y) = ([0.0; PLACES], [0.0; PLACES]);
                            for i in 0..PLACES {
                                at_x[i] = cos.mul_add(ahead[i], (-sin).mul_add(lateral[i], x));
                                at_y[i] = sin.mul_add(ahead[i], cos.mul_add(lateral[i], y));
                            }
                            terrain.heights_at(&at_x, &at_y)
                        }
                        None => [0.0; PLACES],
                    };
                    for (i, (value, height)) in values.iter_mut().zip(heights).enumerate() {
                        if dropout == 0.0 || is_first || !missing(chunk * PLACES + i) {
                            *value = (lowest - height) as f32;
                        }
                    }
                }
            },
        );
        if noise > 0.0 {
            self.add_noise(random, is_first, missing, out);
        }
        out.iter_mut().for_each(|value| *value = value.clamp(-BOUND, BOUND));
    }
}

impl Scan {
    fn add_noise(&self, random: &Random, is_first: bool, missing: impl Fn(usize) -> bool, out: &mut [f32]) {
        let is_kept = |point: usize| self.options.dropout > 0.0 && !is_first && missing(point);
        for (block, values) in out.chunks_mut(4).enumerate() {
            let normals = random.normals(NOISE + block as u32);
            for (i, (value, normal)) in values.iter_mut().zip(normals).enumerate() {
                if !is_kept(4 * block + i) {
                    *value += (self.options.noise * normal) as f32;
                }
            }
        }
    }
}
