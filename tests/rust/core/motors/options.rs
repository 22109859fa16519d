//! Options of the motors: presets, files, and what is rejected.

use super::{TORQUE, everything};
use ballbot_core::actuator::{MotorOptions, Motors};
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Environment};
use ballbot_core::fields::Fields;
use ballbot_core::options::PublishedOptions;
use ballbot_core::{Error, ModelKind, Params, Result};
use std::path::Path;

fn motors(options: &MotorOptions) -> Result<Motors> {
    Motors::new(options, &Params::paper(), TORQUE, 0.002, 5)
}

fn assert_rejected(options: &MotorOptions, parts: &[&str]) {
    let config = BalanceConfig { actuators: options.clone(), ..BalanceConfig::default() };
    let batch = Batch::new(&config, 2, Autoreset::SameStep, Some(1), 0).err();
    let single = Environment::new(&config, 0).err();
    for error in [motors(options).err(), batch, single] {
        let error = error.unwrap_or_else(|| panic!("{options:?} was taken")).to_string();
        for part in parts {
            assert!(error.contains(part), "'{part}' is not in: {error}");
        }
    }
}

#[test]
fn every_number_out_of_range_is_named() {
    for (index, field) in MotorOptions::FIELDS.iter().enumerate() {
        for bad in [-1.0, -1e-300, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e10] {
            let mut options = everything();
            *options.values_mut(index).last_mut().unwrap() = bad;
            assert_rejected(&options, &[&format!("actuators.{}", field.name), "out of range"]);
        }
    }
}

#[test]
fn delay_between_two_steps_is_rejected_with_both_numbers() {
    for delay in [0.003, 0.0051, 1e-9] {
        let options = MotorOptions { delay, ..MotorOptions::default() };
        assert_rejected(
            &options,
            &["actuators.delay", "whole number", &format!("delay = {delay} s"), "sim_dt = 0.002 s"],
        );
    }
    let options = MotorOptions { delay: 1.0, ..MotorOptions::default() };
    let error = Motors::new(&options, &Params::paper(), TORQUE, 5e-5, 5).unwrap_err().to_string();
    assert!(error.contains("20000") && error.contains("at most 10000"), "{error}");
    // A multiple up to rounding is accepted, a value in between is not.
    motors(&MotorOptions { delay: 0.1 + 0.2, ..MotorOptions::default() }).unwrap();
}

#[test]
fn half_a_curve_is_rejected() {
    let options = MotorOptions { stall_torque: 2.0, ..MotorOptions::default() };
    assert_rejected(&options, &["stall_torque = 2 N·m", "no_load_speed = 0 rad/s", "needs both"]);
    let options = MotorOptions { no_load_speed: 2.0, ..MotorOptions::default() };
    assert_rejected(&options, &["stall_torque = 0 N·m", "no_load_speed = 2 rad/s", "needs both"]);
}

#[test]
fn speeds_too_low_to_divide_by_are_rejected() {
    assert_rejected(&MotorOptions { speed_limit: 1e-9, ..MotorOptions::default() }, &["speed_limit", "at least 0.001"]);
    let options = MotorOptions { stall_torque: 1e-9, no_load_speed: 1e-300, ..MotorOptions::default() };
    assert_rejected(&options, &["no_load_speed", "at least 0.001"]);
}

/// A torque-speed curve so steep that a free wheel would oscillate about its no-load speed.
#[test]
fn curve_too_steep_for_the_time_step_is_rejected() {
    let options = MotorOptions { stall_torque: 5.0, no_load_speed: 50.0, ..MotorOptions::default() };
    assert_rejected(&options, &["stall_torque / actuators.no_load_speed = 0.1", "wheel_inertia", "sim_dt = 0.002 s"]);
    Motors::new(&options, &Params::paper(), TORQUE, 1e-3, 5).unwrap();
}

#[test]
fn torque_beyond_the_parameters_is_rejected() {
    let options = MotorOptions { peak_torque: 5.1, ..MotorOptions::default() };
    assert_rejected(&options, &["actuators.peak_torque = 5.1", "params.max_wheel_torque = 5 N·m"]);
}

/// A robot whose motors allow less than the batch's motors may give is rejected, and nothing changes.
#[test]
fn robot_that_does_not_fit_the_motors_is_rejected() {
    let curve = MotorOptions { stall_torque: 1.0, no_load_speed: 30.0, ..MotorOptions::default() };
    let config = BalanceConfig {
        max_wheel_torque: Some(0.5),
        actuators: curve,
        model: ModelKind::Contact,
        ..Default::default()
    };
    let mut batch = Batch::new(&config, 3, Autoreset::SameStep, Some(1), 0).unwrap();
    let weak = Params { max_wheel_torque: 4.0, ..Params::paper() };
    let error = batch.set_params(1, &weak).unwrap_err().to_string();
    assert!(error.contains("= 5 ") && error.contains("params.max_wheel_torque = 4 N·m"), "{error}");
    let light = Params { wheel_inertia: 5e-5, ..Params::paper() };
    let error = batch.set_params(1, &light).unwrap_err().to_string();
    assert!(error.contains("wheel_inertia = 0.00005 kg·m²"), "{error}");
    assert_eq!(batch.params(1).unwrap(), &Params::paper());
    let limited = MotorOptions { peak_torque: 0.5, ..config.actuators };
    let config = BalanceConfig { actuators: limited, ..config };
    Batch::new(&config, 3, Autoreset::SameStep, Some(1), 0).unwrap().set_params(1, &weak).unwrap();
}

#[test]
fn motors_by_name_match_the_files_of_the_robots() {
    let names = MotorOptions::preset_names();
    assert_eq!(names, ["ideal", "kugle"]);
    assert!(MotorOptions::preset("ideal").unwrap().is_ideal());
    for name in &names[1..] {
        let options = MotorOptions::preset(name).unwrap();
        assert!(!options.is_ideal(), "{name}");
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../crates/ballbot-base/robots/{name}.toml"));
        assert_eq!(MotorOptions::from_toml_file(&file).unwrap(), options, "{name}");
        let params = Params::preset(name).unwrap();
        Motors::new(&options, &params, 1.0, 0.002, 5).unwrap();
    }
    let error = MotorOptions::preset("paper").unwrap_err().to_string();
    assert!(error.contains("unknown actuators 'paper'") && error.contains("ideal, kugle"), "{error}");
}

/// The numbers of Constants_Kugle.m, from its motor to its wheel.
#[test]
fn motors_of_kugle_match_the_published_motors_at_fifteen_volts() {
    let options = MotorOptions::preset("kugle").unwrap();
    let (gear, volts) = (13.0 / 3.0, 15.0 / 12.0);
    assert!((options.stall_torque - gear * 2.85 * volts).abs() < 1e-4);
    let no_load = 3710.0 / 60.0 * std::f64::consts::TAU * volts / gear;
    assert!((options.no_load_speed - no_load).abs() < 1e-2, "{no_load}");
}

#[test]
fn options_come_from_toml() {
    let text = "[actuators]\ndelay = 0.01\nstrength = 0.9\nlag = 0.02\n";
    let options = MotorOptions::from_toml(text).unwrap();
    let expected = MotorOptions { delay: 0.01, strength: [0.9; 3], lag: 0.02, ..MotorOptions::default() };
    assert_eq!(options, expected);
    let options = MotorOptions::from_toml("[actuators]\nstrength = [1, 0.9, 0.8]\n").unwrap();
    assert_eq!(options.strength, [1.0, 0.9, 0.8]);
    // Parameters next to them do not affect the motors, nor the motors the parameters.
    let robot = format!("{}\n{text}", Params::paper().to_toml());
    assert_eq!(MotorOptions::from_toml(&robot).unwrap(), expected);
    assert_eq!(Params::from_toml(&robot).unwrap(), Params::paper());
}

#[test]
fn broken_toml_is_rejected_with_its_reason() {
    for (text, part) in [
        ("delay = 0.01", "there is no table [actuators]"),
        ("actuators = 3", "actuators = 3 is not a table"),
        ("[actuators]\ndelay = \"x\"", "delay = \"x\" is not a number"),
        ("[actuators]\ndelai = 1", "unknown option of actuators 'delai': expected one of delay, strength"),
        ("[actuators]\nstrength = [1, 2]", "actuators.strength has 2 values, expected 3"),
        ("[actuators]\nlag = -1", "actuators.lag = -1"),
        ("[actuators", "cannot decode"),
    ] {
        let error = MotorOptions::from_toml(text).unwrap_err().to_string();
        assert!(error.contains(part), "'{part}' is not in: {error}");
    }
    let missing = MotorOptions::from_toml_file(Path::new("no_such_file.toml")).unwrap_err();
    assert!(matches!(missing, Error::Io { .. }), "{missing}");
}
