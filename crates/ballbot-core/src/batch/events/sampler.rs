//! Random numbers by key: ChaCha8 with the environment's seed, on a stream of the event.

use super::event::Distribution;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::f64::consts::TAU;

/// Seed of an environment, as its generator of starts has it. That generator is on stream 0.
pub type Key = [u8; 32];

/// Where the random numbers of an episode come from.
#[derive(Clone, Copy, Debug)]
pub struct Source {
    pub key: Key,
    /// Counts from the seed on; 0 is before the first.
    pub episode: u32,
}

/// Standard deviations at which the normal distribution is truncated.
pub const TRUNCATION: f64 = 3.0;

/// Words of a draw's place: one refill of the generator.
const WORDS_LOG2: u32 = 6;
/// Draws of an event in an episode.
const COUNT_LOG2: u32 = 30;
/// Attempts of a draw, and the bit of the stream that all but the first have.
const ATTEMPTS_LOG2: u32 = 6;
const ATTEMPTS_STREAM: u64 = 1 << 63;

/// How often a draw is repeated that makes a robot that cannot be.
pub const ATTEMPTS: u32 = 1 << ATTEMPTS_LOG2;

/// The random numbers of one draw of one event.
pub struct Sampler(ChaCha8Rng);

impl Sampler {
    /// Of draw `count` of the event with stream `stream`, for the `attempt`th time; both count from 0.
    pub fn new(source: Source, stream: u64, count: u32, attempt: u32) -> Self {
        let mut rng = ChaCha8Rng::from_seed(source.key);
        let (stream, place) = match attempt {
            0 => (stream, u128::from(count)),
            _ => (stream | ATTEMPTS_STREAM, (u128::from(count) << ATTEMPTS_LOG2) + u128::from(attempt)),
        };
        rng.set_stream(stream);
        rng.set_word_pos(((u128::from(source.episode) << COUNT_LOG2) + place) << WORDS_LOG2);
        Self(rng)
    }

    /// A number in [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.0.random()
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

    /// One of the whole multiples of a time from the first to the last, each as likely.
    pub fn draw_whole(&mut self, [first, last]: [f64; 2], grain: f64) -> f64 {
        let steps = ((last - first) / grain).round();
        let chosen = (self.unit() * (steps + 1.0)).floor().min(steps);
        (((first / grain).round() + chosen) * grain).clamp(first, last)
    }

    /// Box and Muller; draws beyond the truncation are drawn again.
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

/// Least and largest draw.
pub fn bounds(distribution: Distribution, [a, b]: [f64; 2]) -> [f64; 2] {
    match distribution {
        Distribution::Uniform | Distribution::LogUniform => [a, b],
        Distribution::Normal => [a - TRUNCATION * b, a + TRUNCATION * b],
    }
}
