//! Constants of the sensors of a robot over an episode.

use super::axes::Axes;
use super::encoders::Encoders;
use super::options::SensorOptions;
use super::period::Period;
use ballbot_base::control_steps::steps_of;
use ballbot_base::error::Result;
use ballbot_base::lanes::lane_struct;
use std::f64::consts::TAU;

/// A magnitude beyond any reading.
const UNLIMITED: f64 = 1e30;

lane_struct! {
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
}

/// The constants of valid options, with readings every `dt` (s).
///
/// # Errors
/// As [`SensorOptions::latency_steps`].
pub fn constants_of(options: &SensorOptions, dt: f64) -> Result<Constants<f64>> {
    let o = options;
    let [imu, encoder] = [o.imu_rate, o.encoder_rate].map(|rate| steps_of(rate, dt));
    let axes = |noise: f64, walk: f64, range: f64| Axes {
        noise: noise / (imu * dt).sqrt(),
        walk: walk * dt.sqrt(),
        range: if range > 0.0 { range } else { UNLIMITED },
    };
    let period = |steps: f64| Period { steps, inverse: 1.0 / steps };
    let tick = if o.encoder_ticks > 0.0 { TAU / o.encoder_ticks } else { 0.0 };
    let ticks = if tick > 0.0 { 1.0 / tick } else { 0.0 };
    Ok(Constants {
        gyro: axes(o.gyro_noise, o.gyro_bias_walk, o.gyro_range),
        accelerometer: axes(o.accelerometer_noise, o.accelerometer_bias_walk, o.accelerometer_range),
        encoders: Encoders { tick, ticks, rate: 1.0 / (encoder * dt) },
        imu_period: period(imu),
        encoder_period: period(encoder),
        place: o.imu_position,
        latency: o.latency_steps(dt)? as f64,
    })
}
