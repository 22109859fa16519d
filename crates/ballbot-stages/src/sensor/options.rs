//! Options of the sensors.

use super::estimator::MAX_DT;
use ballbot_base::control_steps::{self, steps_of};
use ballbot_base::error::{Result, check};
use ballbot_base::fields;
use ballbot_base::fields::{Fields, Limit};
use ballbot_base::options::{OptionTable, PublishedOptions};

/// Smallest range of a sensor that has a range.
const LEAST_RANGE: f64 = 1e-6;

/// Smallest sampling rate of a sensor that has a rate, Hz.
const LEAST_RATE: f64 = 1e-3;

fields! {
    /// What a gyroscope, an accelerometer and three encoders read. The default is exact. SI units and radians; the three
    /// axes of a sensor are alike and independent, and so are the encoders.
    pub struct SensorOptions {
        /// Density of the gyroscope's white noise; a sample has the standard deviation `gyro_noise` / √T, T the time
        /// between two samples.
        pub gyro_noise: f64 = 0.0, "rad/s/√Hz", Limit::NOT_NEGATIVE.to(1e3);
        /// Standard deviation of the gyroscope's bias at the start of an episode, sampled for each.
        pub gyro_bias: f64 = 0.0, "rad/s", Limit::NOT_NEGATIVE.to(1e3);
        /// Random walk of that bias: its standard deviation after one second.
        pub gyro_bias_walk: f64 = 0.0, "rad/s/√s", Limit::NOT_NEGATIVE.to(1e3);
        /// Largest magnitude that the gyroscope reads about an axis; 0: any.
        pub gyro_range: f64 = 0.0, "rad/s", Limit::NOT_NEGATIVE.to(1e6);
        /// Density of the accelerometer's white noise; a sample has the standard deviation `accelerometer_noise` / √T, T
        /// the time between two samples.
        pub accelerometer_noise: f64 = 0.0, "m/s²/√Hz", Limit::NOT_NEGATIVE.to(1e4);
        /// Standard deviation of the accelerometer's bias at the start of an episode, sampled for each.
        pub accelerometer_bias: f64 = 0.0, "m/s²", Limit::NOT_NEGATIVE.to(1e4);
        /// Random walk of that bias: its standard deviation after one second.
        pub accelerometer_bias_walk: f64 = 0.0, "m/s²/√s", Limit::NOT_NEGATIVE.to(1e4);
        /// Largest magnitude that the accelerometer reads along an axis; 0: any.
        pub accelerometer_range: f64 = 0.0, "m/s²", Limit::NOT_NEGATIVE.to(1e6);
        /// Where gyroscope and accelerometer are, in the body frame, whose origin is the ball's center.
        pub imu_position: [f64; 3] = [0.0; 3], "m", Limit::from(-10.0).to(10.0);
        /// Standard deviation of the mounting error of gyroscope and accelerometer about each body axis, sampled for
        /// each episode.
        pub imu_misalignment: f64 = 0.0, "rad", Limit::NOT_NEGATIVE.to(0.1);
        /// Samples of gyroscope and accelerometer in a second, held in between; 0: one sample at each control step,
        /// which is also the maximum.
        pub imu_rate: f64 = 0.0, "Hz", Limit::NOT_NEGATIVE.to(1e6);
        /// Ticks of an encoder in one turn of its wheel, gear included; 0: exact angles.
        pub encoder_ticks: f64 = 0.0, "", Limit::NOT_NEGATIVE.to(1e9);
        /// Samples of the encoders in a second, held in between; 0: one sample at each control step, which is also the
        /// maximum.
        pub encoder_rate: f64 = 0.0, "Hz", Limit::NOT_NEGATIVE.to(1e6);
        /// Age of the readings of all sensors, a whole number of control steps; at most 100 of them.
        pub latency: f64 = 0.0, "s", Limit::NOT_NEGATIVE.to(100.0);
    }
}

impl SensorOptions {
    /// Checks the options of sensors that are read every `control_dt` (s), with an estimator if `estimated`.
    ///
    /// # Errors
    /// The errors of [`OptionTable::validate`] and [`SensorOptions::latency_steps`]; with an estimator
    /// [`ballbot_base::Error::OutOfRange`] for `control_dt` above 1 s, and unless every sensor is sampled in every control step.
    pub fn check(&self, control_dt: f64, estimated: bool) -> Result<()> {
        self.validate()?;
        if estimated {
            let limit = format_args!("> 0 and <= {MAX_DT} s with observation = sensors");
            check("control_dt", control_dt, limit, |dt| dt > 0.0 && dt <= MAX_DT)?;
        }
        self.latency_steps(control_dt)?;
        if !estimated {
            return Ok(());
        }
        for (name, rate) in [("imu_rate", self.imu_rate), ("encoder_rate", self.encoder_rate)] {
            let limit = format_args!(
                "0 or at least the control rate, {} Hz, with observation = sensors (control_dt = {control_dt} s)",
                1.0 / control_dt
            );
            check(format_args!("{}.{name}", Self::NAME), rate, limit, |rate| steps_of(rate, control_dt) <= 1.0)?;
        }
        Ok(())
    }

    /// Whether an option is a time in whole control steps; `index` counts in [`Fields::FIELDS`].
    pub fn in_control_steps(index: usize) -> bool {
        Self::FIELDS[index].name == "latency"
    }

    /// Control steps of `control_dt` (s) in the latency.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] unless it is a whole number of at most 100.
    pub fn latency_steps(&self, control_dt: f64) -> Result<usize> {
        control_steps::latency_steps(self.latency, control_dt).map_err(|error| error.of_option(Self::NAME))
    }
}

impl OptionTable for SensorOptions {
    const NAME: &'static str = "sensors";

    fn check_relations(&self) -> Result<()> {
        for (name, range, unit) in
            [("gyro_range", self.gyro_range, "rad/s"), ("accelerometer_range", self.accelerometer_range, "m/s²")]
        {
            let limit = format_args!("0 (any) or at least {LEAST_RANGE} {unit}");
            check(name, range, limit, |r| r == 0.0 || r >= LEAST_RANGE)?;
        }
        for (name, rate) in [("imu_rate", self.imu_rate), ("encoder_rate", self.encoder_rate)] {
            let limit = format_args!("0 (every control step) or at least {LEAST_RATE} Hz");
            check(name, rate, limit, |r| r == 0.0 || r >= LEAST_RATE)?;
        }
        check("encoder_ticks", self.encoder_ticks, "0 (exact) or at least 1", |n| n == 0.0 || n >= 1.0)?;
        Ok(())
    }
}

impl PublishedOptions for SensorOptions {
    const DEFAULT: &'static str = "exact";
}
