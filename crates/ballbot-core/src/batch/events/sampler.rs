//! Random numbers by key and counter: Philox4x32-10 with the environment's seed and a separate key for each event.

use super::event::Distribution;
use ballbot_base::lanes::philox;
use std::f64::consts::TAU;

/// Key of an environment.
pub type Key = [u32; 2];

/// The key that follows from the seed of an environment's generator of starts.
pub fn key_of(seed: [u8; 32]) -> Key {
    let [a, b, c, d, e, f, g, h, ..] = seed;
    [[a, b, c, d], [e, f, g, h]].map(u32::from_le_bytes)
}

/// Where the random numbers of an episode come from.
#[derive(Clone, Copy, Debug)]
pub struct Source {
    pub key: Key,
    /// Counts from the seed; 0 is before the first episode.
    pub episode: u32,
}

/// Standard deviations at which the normal distribution is truncated.
pub const TRUNCATION: f64 = 3.0;

/// Separates the random numbers of events from other uses of the same key.
const STREAM: [u32; 2] = [u32::from_le_bytes(*b"draw"), 1];

/// How often a draw that gives an invalid robot is repeated.
pub const ATTEMPTS: u32 = 64;

/// The random numbers of one draw of one event.
pub struct Sampler {
    key: Key,
    /// Blocks of words so far, attempt, count and episode.
    counter: [u32; 4],
    words: [u32; 4],
    used: usize,
}

impl Sampler {
    /// The sampler of draw `count` of the event with id `id`, attempt `attempt`; both count from 0.
    pub fn new(source: Source, id: u64, count: u32, attempt: u32) -> Self {
        let [a, b, ..] = philox(source.key, [id as u32, (id >> 32) as u32, STREAM[0], STREAM[1]]);
        Self { key: [a, b], counter: [0, attempt, count, source.episode], words: [0; 4], used: 4 }
    }

    /// A number in [0, 1).
    pub fn unit(&mut self) -> f64 {
        if self.used == self.words.len() {
            self.words = philox(self.key, self.counter);
            self.counter[0] = self.counter[0].wrapping_add(1);
            self.used = 0;
        }
        let [low, high] = [self.words[self.used], self.words[self.used + 1]].map(u64::from);
        self.used += 2;
        ((high << 32 | low) >> 11) as f64 * (0.5 * f64::EPSILON)
    }

    /// A number of the distribution; `pair` is low and high, or mean and standard deviation.
    pub fn draw(&mut self, distribution: Distribution, pair: [f64; 2]) -> f64 {
        let [low, high] = bounds(distribution, pair);
        let value = match distribution {
            Distribution::Uniform => low + (high - low) * self.unit(),
            Distribution::LogUniform => low * (high / low).powf(self.unit()),
            Distribution::Normal => pair[0] + pair[1] * self.truncated_normal(),
        };
        // Against rounding.
        value.clamp(low, high)
    }

    /// A whole multiple of a time from the first to the last, all equally likely.
    pub fn draw_whole(&mut self, [first, last]: [f64; 2], grain: f64) -> f64 {
        let steps = ((last - first) / grain).round();
        let chosen = (self.unit() * (steps + 1.0)).floor().min(steps);
        (((first / grain).round() + chosen) * grain).clamp(first, last)
    }

    /// Box-Muller; values beyond the truncation are resampled.
    fn truncated_normal(&mut self) -> f64 {
        loop {
            let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
            let value = radius * (TAU * self.unit()).cos();
            if value.abs() <= TRUNCATION {
                return value;
            }
        }
    }
}

/// Smallest and largest draw.
pub fn bounds(distribution: Distribution, [a, b]: [f64; 2]) -> [f64; 2] {
    match distribution {
        Distribution::Uniform | Distribution::LogUniform => [a, b],
        Distribution::Normal => [a - TRUNCATION * b, a + TRUNCATION * b],
    }
}
