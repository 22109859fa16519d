//! The curves that paths are sampled from.

use super::curve::{Curve, HARMONICS, NUMBERS, Phase};
use crate::start::in_range;
use ballbot_base::lanes::{Memory, Scalar};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// Samples of a curve at which its derivatives are taken.
const SAMPLES: usize = 96;

/// A circle, a lemniscate of Gerono, a rounded square and a random curve, in the order of the weights.
const KINDS: usize = 4;

/// Coefficients (x cosine, x sine, y cosine, y sine) of each harmonic of a curve of half width 1.
type Shape = [[f64; 4]; HARMONICS];

const CIRCLE: Shape = [[1.0, 0.0, 0.0, 1.0], [0.0; 4], [0.0; 4]];
const LEMNISCATE: Shape = [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.5], [0.0; 4]];
const ROUNDED_SQUARE: Shape = [[1.0, 0.0, 0.0, 1.0], [0.0; 4], [0.08, 0.0, 0.0, -0.08]];

/// Samples a curve with a half width of about `size` m in a random direction; returns the numbers of a [`Curve`].
pub(super) fn draw(weights: [f64; KINDS], size: f64, rng: &mut ChaCha8Rng) -> [f64; NUMBERS] {
    let mut left = rng.random::<f64>() * weights.iter().sum::<f64>();
    let chosen = weights.iter().position(|weight| {
        left -= weight;
        left < 0.0
    });
    let shape = match chosen {
        Some(0) => CIRCLE,
        Some(1) => LEMNISCATE,
        Some(2) => ROUNDED_SQUARE,
        _ => random_shape(rng),
    };
    let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
    let side = if rng.random::<f64>() < 0.5 { -1.0 } else { 1.0 };
    let mut numbers = [0.0; NUMBERS];
    for (k, [xc, xs, yc, ys]) in shape.into_iter().enumerate() {
        for (part, (x, y)) in [(xc, side * yc), (xs, side * ys)].into_iter().enumerate() {
            numbers[2 * k + part] = size * (cos * x - sin * y);
            numbers[2 * (HARMONICS + k) + part] = size * (sin * x + cos * y);
        }
    }
    numbers
}

/// An ellipse with higher harmonics of random sizes and phases.
fn random_shape(rng: &mut ChaCha8Rng) -> Shape {
    let mut shape = CIRCLE;
    shape[0][3] = in_range(rng, [0.5, 1.0]);
    for (harmonic, most) in shape.iter_mut().skip(1).zip([0.2, 0.07]) {
        *harmonic = std::array::from_fn(|_| in_range(rng, [-most, most]));
    }
    shape
}

/// Largest constant speed (m/s) along a curve at which acceleration, jerk and snap stay within limits.
pub(super) fn largest_speed(numbers: &[f64], limits: [f64; 3]) -> f64 {
    let mut cells = [0.0; NUMBERS];
    cells.copy_from_slice(&numbers[..NUMBERS]);
    let curve = Curve::<f64>::load(&Memory::new(Scalar, &mut cells), 0);
    let at = |i: usize| {
        let (sin, cos) = (TAU * i as f64 / SAMPLES as f64).sin_cos();
        let [_, second, third, fourth] = curve.motion(Phase { cos, sin }, 1.0, 0.0);
        let [a, j, s] = limits;
        let speeds = [(a / second.norm()).sqrt(), (j / third.norm()).cbrt(), (s / fourth.norm()).powf(0.25)];
        speeds.into_iter().fold(f64::INFINITY, f64::min)
    };
    (0..SAMPLES).map(at).fold(f64::INFINITY, f64::min)
}
