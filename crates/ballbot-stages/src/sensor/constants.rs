//! Constants of the sensors of a robot over an episode.

use super::axes::Axes;
use super::encoders::Encoders;
use super::options::SensorOptions;
use super::period::Period;
use ballbot_base::control_steps::steps_of;
use ballbot_base::error::Result;
use ballbot_base::lanes::Lane;
use std::f64::consts::TAU;

/// Count of constants.
pub const CONSTANTS: usize = 17;

/// A magnitude beyond any reading.
const UNLIMITED: f64 = 1e30;

/// Constants of the sensors of one robot or of several.
#[derive(Clone, Copy, Debug)]
pub struct Constants<T> {
    pub gyro: Axes<T>,
    pub accelerometer: Axes<T>,
    pub encoders: Encoders<T>,
    /// Period of gyroscope and accelerometer.
    pub imu_period: Period<T>,
    pub encoder_period: Period<T>,
    /// Position of gyroscope and accelerometer, body frame, m.
    pub place: [T; 3],
    /// Control steps between a measurement and its reading.
    pub latency: T,
}

/// The constants of valid options, with readings every `dt` (s).
///
/// # Errors
/// As [`SensorOptions::latency_steps`].
pub fn constants_of(options: &SensorOptions, dt: f64) -> Result<[f64; CONSTANTS]> {
    let o = options;
    let [imu, encoder] = [o.imu_rate, o.encoder_rate].map(|rate| steps_of(rate, dt));
    let axes = |noise: f64, walk: f64, range: f64| {
        [noise / (imu * dt).sqrt(), walk * dt.sqrt(), if range > 0.0 { range } else { UNLIMITED }]
    };
    let [a, b, c] = axes(o.gyro_noise, o.gyro_bias_walk, o.gyro_range);
    let [d, e, f] = axes(o.accelerometer_noise, o.accelerometer_bias_walk, o.accelerometer_range);
    let tick = if o.encoder_ticks > 0.0 { TAU / o.encoder_ticks } else { 0.0 };
    let ticks = if tick > 0.0 { 1.0 / tick } else { 0.0 };
    let rate = 1.0 / (encoder * dt);
    let [x, y, z] = o.imu_position;
    let latency = o.latency_steps(dt)? as f64;
    Ok([a, b, c, d, e, f, tick, ticks, rate, imu, 1.0 / imu, encoder, 1.0 / encoder, x, y, z, latency])
}

impl<L: Lane> Constants<L> {
    /// Constants from numbers in the order of [`constants_of`].
    #[inline(always)]
    pub fn from_numbers(
        [a, b, c, d, e, f, tick, ticks, rate, imu, per_imu, encoder, per_encoder, x, y, z, latency]: [L; CONSTANTS],
    ) -> Self {
        Self {
            gyro: Axes { noise: a, walk: b, range: c },
            accelerometer: Axes { noise: d, walk: e, range: f },
            encoders: Encoders { tick, ticks, rate },
            imu_period: Period::from_numbers([imu, per_imu]),
            encoder_period: Period::from_numbers([encoder, per_encoder]),
            place: [x, y, z],
            latency,
        }
    }
}
