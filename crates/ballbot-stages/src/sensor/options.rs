//! Options of the sensors.

use super::estimator::MAX_DT;
use ballbot_base::control_steps::{self, steps_of};
use ballbot_base::error::{Error, Result, check};
use ballbot_base::fields;
use ballbot_base::fields::{Fields, Limit};
use ballbot_base::params::robot_file::RobotFile;
use std::path::Path;

/// Smallest range of a sensor that has a range.
const LEAST_RANGE: f64 = 1e-6;

/// Smallest sampling rate of a sensor that has a rate, Hz.
const LEAST_RATE: f64 = 1e-3;

/// What a name of sensors is called in messages.
const KIND: &str = "sensors";

/// The name of exact sensors.
const EXACT: &str = "exact";

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
    /// Options from named numbers, the others at their defaults.
    ///
    /// # Errors
    /// [`Error::UnknownName`], [`Error::Length`]; the errors of [`SensorOptions::validate`].
    pub fn from_fields<'n, 'v>(fields: impl IntoIterator<Item = (&'n str, &'v [f64])>) -> Result<Self> {
        let options = Self::with_fields("option of sensors", KIND, fields)?;
        options.validate()?;
        Ok(options)
    }

    /// Sensors by name: `exact`, or a robot with published sensors.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for a name that is not in [`SensorOptions::preset_names`].
    pub fn preset(name: &str) -> Result<Self> {
        if name == EXACT {
            return Ok(Self::default());
        }
        let file = RobotFile::preset(name).transpose()?;
        match file.and_then(|file| file.sensors) {
            Some(fields) => Self::from_named(&fields),
            None => Err(Error::unknown(KIND, name, &Self::preset_names())),
        }
    }

    /// Names that [`SensorOptions::preset`] accepts: `exact`, and the robots whose sensors are published.
    pub fn preset_names() -> Vec<&'static str> {
        let published = RobotFile::preset_names().iter().copied().filter(|name| {
            let file = RobotFile::preset(name).and_then(Result::ok);
            file.is_some_and(|file| file.sensors.is_some())
        });
        [EXACT].into_iter().chain(published).collect()
    }

    /// Sensors from the table `[sensors]` of a robot's TOML file.
    ///
    /// # Errors
    /// [`Error::Io`] for a file that cannot be read; [`Error::Decode`] with the file and the reason that
    /// [`SensorOptions::from_toml`] gives.
    pub fn from_toml_file(path: &Path) -> Result<Self> {
        RobotFile::read(path, Self::from_toml)
    }

    /// Sensors from the table `[sensors]` of TOML text.
    ///
    /// # Errors
    /// [`Error::Decode`] for malformed text, values that are not numbers, or no such table; the errors of
    /// [`SensorOptions::from_fields`].
    pub fn from_toml(text: &str) -> Result<Self> {
        match RobotFile::parse(text)?.sensors {
            Some(fields) => Self::from_named(&fields),
            None => Err(Error::Decode { what: KIND.into(), reason: "there is no table [sensors]".into() }),
        }
    }

    fn from_named(fields: &[(String, Vec<f64>)]) -> Result<Self> {
        Self::from_fields(fields.iter().map(|(name, values)| (name.as_str(), values.as_slice())))
    }

    /// Checks the options of sensors that are read every `control_dt` (s), with an estimator if `estimated`.
    ///
    /// # Errors
    /// The errors of [`SensorOptions::validate`] and [`SensorOptions::latency_steps`]; with an estimator
    /// [`Error::OutOfRange`] for `control_dt` above 1 s, and unless every sensor is sampled in every control step.
    pub fn check(&self, control_dt: f64, estimated: bool) -> Result<()> {
        self.validate()?;
        self.latency_steps(control_dt)?;
        if !estimated {
            return Ok(());
        }
        let limit = format_args!("> 0 and <= {MAX_DT} s with observation = sensors");
        check("control_dt", control_dt, limit, |dt| dt > 0.0 && dt <= MAX_DT)?;
        for (name, rate) in [("imu_rate", self.imu_rate), ("encoder_rate", self.encoder_rate)] {
            let limit = format_args!(
                "0 or at least the control rate, {} Hz, with observation = sensors (control_dt = {control_dt} s)",
                1.0 / control_dt
            );
            check(format_args!("{KIND}.{name}"), rate, limit, |rate| steps_of(rate, control_dt) <= 1.0)?;
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
    /// [`Error::OutOfRange`] unless it is a whole number of at most 100.
    pub fn latency_steps(&self, control_dt: f64) -> Result<usize> {
        control_steps::latency_steps(self.latency, control_dt).map_err(|error| error.of_option(KIND))
    }

    /// Checks the numbers against their limits.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] naming the value and the limit.
    pub fn validate(&self) -> Result<()> {
        self.check_limits().map_err(|error| error.of_option(KIND))?;
        for (name, range, unit) in
            [("gyro_range", self.gyro_range, "rad/s"), ("accelerometer_range", self.accelerometer_range, "m/s²")]
        {
            check(
                format_args!("{KIND}.{name}"),
                range,
                format_args!("0 (any) or at least {LEAST_RANGE} {unit}"),
                |r| r == 0.0 || r >= LEAST_RANGE,
            )?;
        }
        for (name, rate) in [("imu_rate", self.imu_rate), ("encoder_rate", self.encoder_rate)] {
            check(
                format_args!("{KIND}.{name}"),
                rate,
                format_args!("0 (every control step) or at least {LEAST_RATE} Hz"),
                |r| r == 0.0 || r >= LEAST_RATE,
            )?;
        }
        check("sensors.encoder_ticks", self.encoder_ticks, "0 (exact) or at least 1", |n| n == 0.0 || n >= 1.0)?;
        Ok(())
    }
}
