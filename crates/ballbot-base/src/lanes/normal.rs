//! Standard normal numbers in lanes, each determined by key and counter.

use super::{Cell, Lane, philox};
use std::f64::consts::{FRAC_PI_2, LN_2, SQRT_2};

/// Bits of a word that choose an angle within a quarter turn; the two above choose the quarter.
const ANGLE_BITS: u32 = 30;

/// The random numbers of one reading of a sensor, or of one sample of a plan, of one robot or of eight.
#[derive(Clone, Copy)]
pub struct Draws<L: Lane> {
    token: L::Token,
    key: [L; 2],
    episode: L,
    reading: L,
}

impl<L: Lane> Draws<L> {
    /// For reading `reading` in episode `episode`, whole numbers, with a key of two 32-bit words.
    #[inline(always)]
    pub fn new(token: L::Token, key: [L; 2], episode: L, reading: L) -> Self {
        Self { token, key, episode, reading }
    }

    /// Four independent standard normal numbers, by Box and Muller; equal for equal `block`. Only IEEE operations:
    /// error 1e-15, magnitudes up to 6.8.
    #[inline(always)]
    pub fn normals(&self, block: u32) -> [L; 4] {
        let cell = |value: L| {
            let mut cell = L::Cell::default();
            value.store(&mut cell);
            cell
        };
        let (key, episode, reading) = ([cell(self.key[0]), cell(self.key[1])], cell(self.episode), cell(self.reading));
        let mut parts = [[L::Cell::default(); 5]; 2];
        for i in 0..L::Cell::WIDTH {
            let words = words(key.map(|word| word.get(i)), episode.get(i), reading.get(i), block);
            for (pair, part) in parts.iter_mut().enumerate() {
                let values = polar(words[2 * pair], words[2 * pair + 1]);
                part.iter_mut().zip(values).for_each(|(cell, value)| cell.set(i, value));
            }
        }
        let [a, b] = [pair(self.loaded(&parts[0])), pair(self.loaded(&parts[1]))];
        [a[0], a[1], b[0], b[1]]
    }

    #[inline(always)]
    fn loaded(&self, [a, b, c, d, e]: &[L::Cell; 5]) -> [L; 5] {
        let load = L::load;
        [load(self.token, a), load(self.token, b), load(self.token, c), load(self.token, d), load(self.token, e)]
    }
}

impl Draws<f64> {
    /// Four independent numbers in [0, 1).
    pub fn units(&self, block: u32) -> [f64; 4] {
        words(self.key, self.episode, self.reading, block).map(|word| f64::from(word) / 4_294_967_296.0)
    }
}

#[inline(always)]
fn words(key: [f64; 2], episode: f64, reading: f64, block: u32) -> [u32; 4] {
    let reading = reading as u64;
    philox(key.map(|word| word as u32), [reading as u32, (reading >> 32) as u32, episode as u64 as u32, block])
}

/// Mantissa in [1, 2) and exponent of a number in (0, 1), then an angle within a quarter turn, and the signs of the quarter.
#[inline(always)]
fn polar(radius: u32, angle: u32) -> [f64; 5] {
    const MANTISSA: u64 = (1 << 52) - 1;
    const ONE: u64 = 1023 << 52;
    let bits = (f64::from(radius) + 0.5).to_bits();
    let exponent = (bits >> 52) as i32 - 1023 - 32;
    let sign = |bit: u32| if angle >> bit & 1 == 0 { 1.0 } else { -1.0 };
    let quarter = f64::from(angle & ((1 << ANGLE_BITS) - 1)) + 0.5;
    [
        f64::from_bits(bits & MANTISSA | ONE),
        f64::from(exponent),
        quarter * (FRAC_PI_2 / f64::from(1_u32 << ANGLE_BITS)),
        sign(ANGLE_BITS),
        sign(ANGLE_BITS + 1),
    ]
}

/// Two independent standard normal numbers from a point in polar coordinates.
#[inline(always)]
fn pair<L: Lane>([mantissa, exponent, angle, sign_x, sign_y]: [L; 5]) -> [L; 2] {
    let radius = (logarithm(mantissa, exponent) * -2.0).sqrt();
    let [cosine, sine] = cosine_and_sine(angle);
    [radius * cosine * sign_x, radius * sine * sign_y]
}

/// ln(mantissa · 2^exponent) for a mantissa in [1, 2): 2 artanh((m − 1)/(m + 1)) about m = 1.
#[inline(always)]
pub fn logarithm<L: Lane>(mantissa: L, exponent: L) -> L {
    let large = mantissa.splat(SQRT_2).lt(mantissa);
    let mantissa = L::select(large, mantissa * 0.5, mantissa);
    let exponent = L::select(large, exponent + 1.0, exponent);
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let squared = s.squared();
    let mut series = s.zero();
    for k in (0..=10).rev() {
        series = series.mul_add(squared, s.splat(2.0 / f64::from(2 * k + 1)));
    }
    exponent.mul_add_all(LN_2, series * s)
}

/// Cosine and sine of an angle in [0, π/2], by Taylor series.
#[inline(always)]
pub fn cosine_and_sine<L: Lane>(angle: L) -> [L; 2] {
    let minus = -angle.squared();
    let one = angle.splat(1.0);
    let (mut cosine, mut sine) = (one, one);
    for k in (1..=11).rev() {
        let n = f64::from(2 * k);
        cosine = (cosine * minus).mul_add_all(1.0 / (n * (n - 1.0)), one);
        sine = (sine * minus).mul_add_all(1.0 / (n * (n + 1.0)), one);
    }
    [cosine, sine * angle]
}
