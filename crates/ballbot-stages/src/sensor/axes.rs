//! Three axes of a gyroscope or an accelerometer.

use ballbot_base::lanes::{Draws, Lane, Memory, Vec3, lane_struct};

lane_struct! {
    /// Errors of three identical axes, except their initial bias.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Axes<T> {
        /// Standard deviation of the noise of a sample.
        pub noise: T,
        /// Standard deviation of the change of the bias from one reading to the next.
        pub walk: T,
        /// Largest magnitude of a reading.
        pub range: T,
    }
}

/// Which errors the axes of any robot have, and the random numbers of the errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxesErrors {
    noise: bool,
    walk: bool,
    range: bool,
    /// Blocks of random numbers: for the noise, and for the walk or the initial bias.
    blocks: [u32; 2],
}

impl AxesErrors {
    /// The errors that are not 0.
    pub fn new([noise, walk, range]: [f64; 3], blocks: [u32; 2]) -> Self {
        Self { noise: noise > 0.0, walk: walk > 0.0, range: range > 0.0, blocks }
    }

    /// The bias at the start of an episode, with a standard deviation.
    pub fn first_bias(&self, deviation: f64, draws: &Draws<f64>) -> [f64; 3] {
        let [x, y, z, _] = draws.normals(self.blocks[1]);
        [x, y, z].map(|number| number * deviation)
    }

    /// The reading of a true value; numbers `first` to `first` + 2 of the memory are the bias.
    #[inline(always)]
    pub fn read<L: Lane>(
        &self,
        value: Vec3<L>,
        axes: &Axes<L>,
        draws: &Draws<L>,
        memory: &mut Memory<'_, L>,
        first: usize,
    ) -> Vec3<L> {
        let mut bias = memory.vector(first);
        if self.walk {
            bias = bias.plus(vector(draws.normals(self.blocks[1])), axes.walk);
            memory.set_vector(first, bias);
        }
        let mut read = value + bias;
        if self.noise {
            read = read.plus(vector(draws.normals(self.blocks[0])), axes.noise);
        }
        if self.range {
            let (range, least) = (axes.range, -axes.range);
            read = Vec3::new(read.x.min(range).max(least), read.y.min(range).max(least), read.z.min(range).max(least));
        }
        read
    }
}

#[inline(always)]
fn vector<L: Lane>([x, y, z, _]: [L; 4]) -> Vec3<L> {
    Vec3::new(x, y, z)
}
