//! The motors of a URDF: the velocity limit of its wheel joints.

use super::checked::{Checked, TOLERANCE, invalid_file, read_file};
use super::tree::Tree;
use ballbot_base::error::Result;
use ballbot_base::options::OptionTable;
use ballbot_stages::actuator::MotorOptions;
use std::path::Path;

/// Motors of the bot described by the file `bot`: the `velocity` of its wheel joints is [`MotorOptions::speed_limit`].
/// Their `effort` is a parameter, [`ballbot_base::Params::max_wheel_torque`].
///
/// # Errors
/// [`ballbot_base::Error::Io`] for a file that cannot be read; the errors of [`motors_from_urdf_text`], with the name
/// of the file.
pub fn motors_from_urdf(bot: &Path) -> Result<MotorOptions> {
    read_motors(&bot.display().to_string(), &read_file(bot)?)
}

/// Motors of the bot described by the text `bot`; without a velocity limit (zero, none or infinite) they are ideal.
///
/// # Errors
/// [`ballbot_base::Error::Urdf`] for malformed text, unless there are three wheels, and for limits that differ or that
/// [`OptionTable::validate`] rejects.
pub fn motors_from_urdf_text(bot: &str) -> Result<MotorOptions> {
    read_motors("bot URDF", bot)
}

fn read_motors(label: &str, bot: &str) -> Result<MotorOptions> {
    let speed_limit = speed_limit(bot).map_err(invalid_file(label))?;
    let options = MotorOptions { speed_limit, ..MotorOptions::default() };
    options.validate().map_err(|error| invalid_file(label)(error.to_string()))?;
    Ok(options)
}

/// The common velocity limit of all wheel joints, rad/s; zero if there is none.
fn speed_limit(text: &str) -> Checked<f64> {
    let tree = Tree::read(text)?;
    let joints = tree.turning_joints();
    let Ok([first, second, third]) = <[usize; 3]>::try_from(joints.as_slice()) else {
        return Err(format!("{} joints are continuous or revolute, expected exactly 3, one a wheel", joints.len()));
    };
    let velocity = |joint: usize| {
        let velocity = tree.joints[joint].limit.velocity;
        // From version 1.2 of the format on, "no limit" is written as infinity.
        if velocity == f64::INFINITY { 0.0 } else { velocity }
    };
    let limit = velocity(first);
    for joint in [second, third] {
        let other = velocity(joint);
        if !(..=TOLERANCE * limit.abs()).contains(&(other - limit).abs()) {
            return Err(format!(
                "the wheels differ: joint velocity limit = {other} of joint '{}', {limit} of joint '{}': at most \
                 {TOLERANCE:e} of it apart",
                tree.joints[joint].name, tree.joints[first].name
            ));
        }
    }
    Ok(limit)
}
