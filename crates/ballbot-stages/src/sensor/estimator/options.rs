//! What an estimator expects of its sensors.

use crate::sensor::SensorOptions;
use ballbot_base::fields::Limit;
use ballbot_base::params::Params;
use ballbot_models::Scale;
use std::f64::consts::TAU;

/// Smallest errors that an estimator expects, rad/s, m/s², rad, and rad or m/s.
const LEAST_RATE_ERROR: f64 = 1e-4;
const LEAST_FORCE_ERROR: f64 = 1e-2;
const LEAST_ANGLE_ERROR: f64 = 1e-6;
const LEAST_START_ERROR: f64 = 1e-3;
/// Smallest bias of the gyroscope about the horizontal axes of the body at the start, rad/s, and its smallest random walk,
/// rad/s after 1 s: a bias that the sensors' options leave out would topple the robot. About the vertical none is added:
/// nothing measures it there.
const LEAST_TILT_BIAS: f64 = 2e-3;
const LEAST_TILT_BIAS_WALK: f64 = 1e-4;

ballbot_base::fields! {
    /// What an estimator expects of its sensors, of the start and of slip. Standard deviations (sd) are per reading.
    /// The defaults are for a robot with a hobbyist IMU, read at 100 Hz.
    #[derive(Copy)]
    pub struct EstimatorOptions {
        /// Position of the IMU, body frame.
        pub imu_position: [f64; 3] = [0.0; 3], "m", Limit::from(-10.0).to(10.0);
        /// Noise of the gyroscope, sd.
        pub gyro_noise: f64 = 0.013, "rad/s", Limit::from(1e-7).to(10.0);
        /// Bias of the gyroscope at the start, sd about each axis of the body.
        pub gyro_bias: [f64; 3] = [0.02; 3], "rad/s", Limit::NOT_NEGATIVE.to(10.0);
        /// Random walk of the bias, sd after 1 s.
        pub gyro_bias_walk: [f64; 3] = [1e-4; 3], "rad/s", Limit::NOT_NEGATIVE.to(10.0);
        /// Noise of the accelerometer, sd.
        pub accelerometer_noise: f64 = 0.03, "m/s²", Limit::from(1e-7).to(100.0);
        /// Error of a wheel angle, sd; of an encoder the angle of a tick divided by the root of 12.
        pub encoder_noise: f64 = 3e-5, "rad", Limit::from(1e-9).to(1.0);
        /// Constant relative error of the wheel rates by the ball's rolling, sd: the error of the wheels' radii and
        /// angles.
        pub rolling_error: f64 = 0.006, "", Limit::NOT_NEGATIVE.to(0.5);
        /// Error of the attitude at the start, sd about each axis.
        pub start_attitude: f64 = 0.01, "rad", Limit::NOT_NEGATIVE.to(1.0);
        /// Error of the ball's velocity at the start, sd of each component.
        pub start_velocity: f64 = 0.01, "m/s", Limit::NOT_NEGATIVE.to(100.0);
        /// Random walk of the ball's spin about the vertical, sd after 1 s.
        pub spin_walk: f64 = 3.0, "rad/s", Limit::from(1e-3).to(1e4);
        /// How far two wheels may disagree about the motion of the ball apart from its spin before one counts as slipping,
        /// standard deviations.
        pub slip_gate: f64 = 4.0, "", Limit::from(1.0).to(1e6);
        /// Random walk of the velocity while a wheel slips, sd after 1 s: a wrong estimate with which two wheels agree must
        /// give way. The default fits the paper's robot; [`EstimatorOptions::of`] scales it.
        pub slip_walk: f64 = 0.03, "m/s", Limit::NOT_NEGATIVE.to(10.0);
        /// Change of a wheel rate above which the wheel slips, as a multiple of what static friction allows at rest.
        pub jump_gate: f64 = 2.0, "", Limit::from(0.1).to(1e6);
        /// Time constant of the lean bias.
        pub lean_time: f64 = 2.0, "s", Limit::from(0.01).to(1e6);
    }
}

impl EstimatorOptions {
    /// The errors that an estimator expects of sensors with these options, read every `dt` (s), on a robot. For readings
    /// without errors, model errors and a bias remain. The robot is valid.
    pub fn of(sensors: &SensorOptions, params: &Params, dt: f64) -> Self {
        let reading = |density: f64| density / dt.sqrt();
        let tick = if sensors.encoder_ticks > 0.0 { TAU / sensors.encoder_ticks } else { 0.0 };
        let axes = |own: f64, least: f64| [own.max(least), own.max(least), own].map(|sd| sd.min(10.0));
        let default = Self::default();
        Self {
            imu_position: sensors.imu_position,
            gyro_noise: reading(sensors.gyro_noise).clamp(LEAST_RATE_ERROR, 10.0),
            gyro_bias: axes(sensors.gyro_bias, LEAST_TILT_BIAS),
            gyro_bias_walk: axes(sensors.gyro_bias_walk, LEAST_TILT_BIAS_WALK),
            // A bias of the accelerometer is not estimated.
            accelerometer_noise: reading(sensors.accelerometer_noise)
                .hypot(sensors.accelerometer_bias)
                .clamp(LEAST_FORCE_ERROR, 100.0),
            encoder_noise: (tick / 12.0_f64.sqrt()).clamp(LEAST_ANGLE_ERROR, 1.0),
            start_attitude: sensors.imu_misalignment.max(LEAST_START_ERROR),
            start_velocity: LEAST_START_ERROR,
            // The slower a robot topples, the longer its wheels slip. Measured: larger ones lose the velocity for longer.
            slip_walk: (default.slip_walk / Scale::of(params).time).min(10.0),
            ..default
        }
    }
}
