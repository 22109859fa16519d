//! Random numbers and random surfaces of generators: the same on every machine.

use crate::lanes::philox;
use std::f64::consts::TAU;

/// Waves in each octave of a noise. With this number of waves, slopes of the sum are nearly normally distributed.
const WAVES: usize = 24;

/// Quotient of the 95th percentile of the slope of a noise and the standard deviation of the slope in one direction:
/// √(2 ln 20), from the Rayleigh distribution.
const PERCENTILE: f64 = 2.447_746_830_680_816;

/// Random numbers by seed and stream.
pub struct Uniform {
    key: [u32; 2],
    stream: u32,
    next: u32,
}

impl Uniform {
    pub fn new(seed: u64, stream: u32) -> Self {
        Self { key: [seed as u32, (seed >> 32) as u32], stream, next: 0 }
    }

    /// A number from 0 to below 1.
    pub fn draw(&mut self) -> f64 {
        let [word, ..] = philox(self.key, [self.next, self.stream, 0, 0x7e44_a100]);
        self.next += 1;
        f64::from(word) / 4_294_967_296.0
    }

    /// A number within a range.
    pub fn within(&mut self, [low, high]: [f64; 2]) -> f64 {
        low + (high - low) * self.draw()
    }
}

/// A wave a cos(k · (x, y) + φ).
struct Wave {
    amplitude: f64,
    number: [f64; 2],
    phase: f64,
}

/// Fractal noise: octaves of waves with random directions and phases.
pub struct Noise {
    waves: Vec<Wave>,
}

impl Noise {
    /// Noise with `percentile_slope`, the tangent of an angle, as 95th percentile of its slope over all seeds. The
    /// first octave has waves of `wavelength`, m; each next octave has `lacunarity` times shorter waves with
    /// `persistence` times the amplitude.
    pub fn new(
        seed: u64,
        percentile_slope: f64,
        wavelength: f64,
        octaves: usize,
        persistence: f64,
        lacunarity: f64,
    ) -> Self {
        let mut random = Uniform::new(seed, 0);
        let mut waves = Vec::with_capacity(octaves * WAVES);
        // Variance of the slope in one direction, for a first amplitude of one.
        let mut variance = 0.0;
        for octave in 0..octaves {
            let number = TAU / wavelength * lacunarity.powi(octave as i32);
            let amplitude = persistence.powi(octave as i32) * (2.0 / WAVES as f64).sqrt();
            variance += WAVES as f64 * (amplitude * number).powi(2) / 4.0;
            for wave in 0..WAVES {
                // Evenly spread directions with a random rotation within each sector.
                let angle = TAU * (wave as f64 + random.draw()) / WAVES as f64;
                let phase = TAU * random.draw();
                waves.push(Wave { amplitude, number: [number * angle.cos(), number * angle.sin()], phase });
            }
        }
        let scale = percentile_slope / (PERCENTILE * variance.sqrt());
        waves.iter_mut().for_each(|wave| wave.amplitude *= scale);
        Self { waves }
    }

    pub fn at(&self, x: f64, y: f64) -> f64 {
        let wave =
            |wave: &Wave| wave.amplitude * (wave.number[0].mul_add(x, wave.number[1].mul_add(y, wave.phase))).cos();
        self.waves.iter().map(wave).sum()
    }
}
