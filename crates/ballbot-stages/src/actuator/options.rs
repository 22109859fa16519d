//! Options of the motors, from names, presets and files.

use ballbot_base::error::{Error, Result, check};
use ballbot_base::fields;
use ballbot_base::fields::{Fields, Limit};
use ballbot_base::params::robot_file::RobotFile;
use std::path::Path;

/// Smallest speed limit and no-load speed, rad/s.
const LEAST_SPEED: f64 = 1e-3;

/// What a name of motors is called in messages.
const KIND: &str = "actuators";

/// The name of ideal motors.
const IDEAL: &str = "ideal";

fields! {
    /// What a motor does between the command of an action and the torque at its wheel. The default is ideal. SI units and
    /// radians; all three motors are equal but for `strength`.
    pub struct MotorOptions {
        /// Dead time between a command and its torque, a whole number of model steps; at most 10000 of them.
        pub delay: f64 = 0.0, "s", Limit::NOT_NEGATIVE.to(1.0);
        /// Torque of each motor as a fraction of the commanded torque; one number applies to all three.
        pub strength: [f64; 3] = [1.0; 3], "", Limit::NOT_NEGATIVE.to(10.0);
        /// Time constant with which the torque follows its command, a first-order lag; 0: none.
        pub lag: f64 = 0.0, "s", Limit::NOT_NEGATIVE.to(10.0);
        /// Torque at standstill under the full supply voltage, given with `no_load_speed`; 0: no torque-speed curve.
        pub stall_torque: f64 = 0.0, "N·m", Limit::NOT_NEGATIVE.to(1e6);
        /// Wheel speed at which the full supply voltage gives no torque, given with `stall_torque`; 0: no curve.
        pub no_load_speed: f64 = 0.0, "rad/s", Limit::NOT_NEGATIVE.to(1e6);
        /// Wheel speed above which no torque acts in the direction of motion; it fades over the last tenth. 0: no limit.
        pub speed_limit: f64 = 0.0, "rad/s", Limit::NOT_NEGATIVE.to(1e6);
        /// Largest torque, at the current limit; 0: `params.max_wheel_torque`, which it may not exceed.
        pub peak_torque: f64 = 0.0, "N·m", Limit::NOT_NEGATIVE.to(1e9);
        /// Longest dead time that is added to `delay` at random, a whole number of model steps, sampled for each command.
        pub delay_jitter: f64 = 0.0, "s", Limit::NOT_NEGATIVE.to(1.0);
    }
}

impl MotorOptions {
    /// Options from named numbers, the others at their defaults. A single `strength` applies to all three motors.
    ///
    /// # Errors
    /// [`Error::UnknownName`], [`Error::Length`]; the errors of [`MotorOptions::validate`].
    pub fn from_fields<'n, 'v>(fields: impl IntoIterator<Item = (&'n str, &'v [f64])>) -> Result<Self> {
        let mut options = Self::default();
        for (name, values) in fields {
            let Some(index) = Self::FIELDS.iter().position(|field| field.name == name) else {
                let known: Vec<_> = Self::FIELDS.iter().map(|field| field.name).collect();
                return Err(Error::unknown("option of actuators", name, &known));
            };
            let field = options.values_mut(index);
            match values {
                [value] => field.fill(*value),
                _ if values.len() == field.len() => field.copy_from_slice(values),
                _ => {
                    let (found, expected) = (values.len(), field.len());
                    return Err(Error::Length { name: name.into(), found, expected }.of_option(KIND));
                }
            }
        }
        options.validate()?;
        Ok(options)
    }

    /// Motors by name: `ideal`, or a robot with published motors.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for a name that is not in [`MotorOptions::preset_names`].
    pub fn preset(name: &str) -> Result<Self> {
        if name == IDEAL {
            return Ok(Self::default());
        }
        let file = RobotFile::preset(name).transpose()?;
        match file.and_then(|file| file.actuators) {
            Some(fields) => Self::from_named(&fields),
            None => Err(Error::unknown(KIND, name, &Self::preset_names())),
        }
    }

    /// Names that [`MotorOptions::preset`] accepts: `ideal`, and the robots whose motors are published.
    pub fn preset_names() -> Vec<&'static str> {
        let published = RobotFile::preset_names().iter().copied().filter(|name| {
            let file = RobotFile::preset(name).and_then(Result::ok);
            file.is_some_and(|file| file.actuators.is_some())
        });
        [IDEAL].into_iter().chain(published).collect()
    }

    /// Motors from the table `[actuators]` of a robot's TOML file.
    ///
    /// # Errors
    /// [`Error::Io`] for a file that cannot be read; [`Error::Decode`] with the file and the reason that
    /// [`MotorOptions::from_toml`] gives.
    pub fn from_toml_file(path: &Path) -> Result<Self> {
        RobotFile::read(path, Self::from_toml)
    }

    /// Motors from the table `[actuators]` of TOML text.
    ///
    /// # Errors
    /// [`Error::Decode`] for malformed text, values that are not numbers, or no such table; the errors of
    /// [`MotorOptions::from_fields`].
    pub fn from_toml(text: &str) -> Result<Self> {
        match RobotFile::parse(text)?.actuators {
            Some(fields) => Self::from_named(&fields),
            None => Err(Error::Decode { what: "actuators".into(), reason: "there is no table [actuators]".into() }),
        }
    }

    fn from_named(fields: &[(String, Vec<f64>)]) -> Result<Self> {
        Self::from_fields(fields.iter().map(|(name, values)| (name.as_str(), values.as_slice())))
    }

    /// Whether the torque equals the command, instantly and at any speed.
    pub fn is_ideal(&self) -> bool {
        *self == Self::default()
    }

    /// Whether an option is a time in whole model steps; `index` counts in [`Fields::FIELDS`].
    pub fn in_model_steps(index: usize) -> bool {
        ["delay", "delay_jitter"].contains(&Self::FIELDS[index].name)
    }

    /// Checks the numbers against their limits and each other.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] or [`Error::Inconsistent`], naming the value and the limit.
    pub fn validate(&self) -> Result<()> {
        self.check_limits().map_err(|error| error.of_option(KIND))?;
        let (stall, speed) = (self.stall_torque, self.no_load_speed);
        if (stall > 0.0) != (speed > 0.0) {
            return Err(Error::Inconsistent(format!(
                "actuators.stall_torque = {stall} N·m and actuators.no_load_speed = {speed} rad/s: a torque-speed curve \
                 needs both above 0"
            )));
        }
        for (name, value) in [("no_load_speed", speed), ("speed_limit", self.speed_limit)] {
            check(
                format_args!("actuators.{name}"),
                value,
                format_args!("0 (none) or at least {LEAST_SPEED} rad/s"),
                |v| v == 0.0 || v >= LEAST_SPEED,
            )?;
        }
        Ok(())
    }
}
