//! Options of the motors, from names, presets and files.

use ballbot_base::error::{Error, Result, check};
use ballbot_base::fields;
use ballbot_base::fields::{Fields, Limit};
use ballbot_base::options::{OptionTable, PublishedOptions};
use ballbot_base::params::Params;

/// Smallest speed limit and no-load speed, rad/s.
const LEAST_SPEED: f64 = 1e-3;

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
    /// Whether the torque equals the command, instantly and at any speed.
    pub fn is_ideal(&self) -> bool {
        *self == Self::default()
    }

    /// Checks that the peak torque is within a robot's limit.
    pub(super) fn check_peak(&self, params: &Params) -> Result<()> {
        if self.peak_torque > 0.0 { params.check_torque("actuators.peak_torque", self.peak_torque) } else { Ok(()) }
    }

    /// Whether an option is a time in whole model steps; `index` counts in [`Fields::FIELDS`].
    pub fn in_model_steps(index: usize) -> bool {
        ["delay", "delay_jitter"].contains(&Self::FIELDS[index].name)
    }
}

impl OptionTable for MotorOptions {
    const NAME: &'static str = "actuators";
    const FILLS: bool = true;

    fn check_relations(&self) -> Result<()> {
        let (stall, speed) = (self.stall_torque, self.no_load_speed);
        if (stall > 0.0) != (speed > 0.0) {
            return Err(Error::Inconsistent(format!(
                "actuators.stall_torque = {stall} N·m and actuators.no_load_speed = {speed} rad/s: a torque-speed curve \
                 needs both above 0"
            )));
        }
        for (name, value) in [("no_load_speed", speed), ("speed_limit", self.speed_limit)] {
            let limit = format_args!("0 (none) or at least {LEAST_SPEED} rad/s");
            check(name, value, limit, |v| v == 0.0 || v >= LEAST_SPEED)?;
        }
        Ok(())
    }
}

impl PublishedOptions for MotorOptions {
    const DEFAULT: &'static str = "ideal";
}
