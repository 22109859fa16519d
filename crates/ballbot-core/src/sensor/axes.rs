//! Three axes of a gyroscope or an accelerometer.

use super::normal::Draws;
use super::period::Period;
use crate::lanes::{Lane, Memory, Vec3};

/// Errors of three axes that are alike: bias, random walk of the bias, white noise, range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axes {
    /// Standard deviation of the noise of a sample.
    noise: f64,
    /// Standard deviation of the first bias.
    bias: f64,
    /// Standard deviation of the change of the bias from one reading to the next.
    walk: f64,
    /// Largest magnitude of a reading.
    range: Option<f64>,
    /// Blocks of random numbers: of the noise, and of the walk or the first bias.
    blocks: [u32; 2],
}

impl Axes {
    /// Axes with a density of noise, a standard deviation of the bias and one of its walk over a second, and a range (0:
    /// none), that are read every `dt` (s) and sampled once in a `period`.
    pub fn new([noise, bias, walk, range]: [f64; 4], dt: f64, period: Period, blocks: [u32; 2]) -> Self {
        let range = (range > 0.0).then_some(range);
        Self { noise: noise / period.duration().sqrt(), bias, walk: walk * dt.sqrt(), range, blocks }
    }

    /// The bias at the start of an episode.
    pub fn first_bias(&self, draws: &Draws<f64>) -> [f64; 3] {
        let [x, y, z, _] = draws.normals(self.blocks[1]);
        [x, y, z].map(|number| number * self.bias)
    }

    /// What is read of the true value; numbers `first` to `first` + 2 of the memory have the bias.
    #[inline(always)]
    pub fn read<L: Lane>(&self, value: Vec3<L>, draws: &Draws<L>, memory: &mut Memory<'_, L>, first: usize) -> Vec3<L> {
        let mut bias = memory.vector(first);
        if self.walk > 0.0 {
            bias = bias.plus(vector(draws.normals(self.blocks[1])), bias.x.splat(self.walk));
            memory.set_vector(first, bias);
        }
        let mut read = value + bias;
        if self.noise > 0.0 {
            read = read.plus(vector(draws.normals(self.blocks[0])), bias.x.splat(self.noise));
        }
        match self.range {
            Some(range) => {
                let within = |v: L| v.min(v.splat(range)).max(v.splat(-range));
                Vec3::new(within(read.x), within(read.y), within(read.z))
            }
            None => read,
        }
    }
}

#[inline(always)]
fn vector<L: Lane>([x, y, z, _]: [L; 4]) -> Vec3<L> {
    Vec3::new(x, y, z)
}
