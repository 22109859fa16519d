//! Torques of single motors against closed forms.

use super::{Shaft, TORQUE};
use ballbot_core::actuator::MotorOptions;

/// Largest torque of the paper's motors, N·m.
const LIMIT: f64 = 5.0;

/// Commands without repetition.
fn commands(k: usize) -> [f64; 3] {
    [0, 1, 2].map(|wheel| (1.7 * k as f64 + wheel as f64).sin())
}

#[test]
fn response_of_the_lag_is_exact_at_any_time_step() {
    let mut worst = 0.0_f64;
    for sim_dt in [1e-4, 1e-3, 2e-3, 0.02] {
        for lag in [2e-3, 0.05, 1.0] {
            let mut shaft = Shaft::new(&MotorOptions { lag, ..MotorOptions::default() }, TORQUE, sim_dt, 5);
            let command = [1.0, -0.5, 0.25];
            let mut last = [0.0; 3];
            for step in 1..=400 {
                last = shaft.torques(command, [0.0; 3]);
                let reached = -(-f64::from(step) * sim_dt / lag).exp_m1();
                for (torque, command) in last.iter().zip(command) {
                    worst = worst.max((torque / (command * TORQUE) - reached).abs());
                }
            }
            // Back to no torque.
            for step in 1..=400 {
                let torques = shaft.torques([0.0; 3], [0.0; 3]);
                let left = (-f64::from(step) * sim_dt / lag).exp();
                for (torque, last) in torques.iter().zip(last) {
                    worst = worst.max((torque - last * left).abs());
                }
            }
        }
    }
    println!("largest error of the lag: {worst:e} of the torque");
    assert!(worst < 1e-13, "{worst:e}");
}

#[test]
fn delay_is_exact_in_model_steps() {
    let sim_dt = 0.002;
    for substeps in [1, 2, 3, 5, 7] {
        for delay in 0..20 {
            let options = MotorOptions { delay: delay as f64 * sim_dt, ..MotorOptions::default() };
            let mut shaft = Shaft::new(&options, TORQUE, sim_dt, substeps);
            for step in 0..10 * substeps + 25 {
                let torques = shaft.torques(commands(step / substeps), [0.0; 3]);
                let expected = match step.checked_sub(delay) {
                    Some(given) => commands(given / substeps).map(|command| command * TORQUE),
                    None => [0.0; 3],
                };
                assert_eq!(torques, expected, "delay of {delay} steps, {substeps} a control step, step {step}");
            }
        }
    }
}

#[test]
fn lag_follows_the_delayed_command() {
    let (sim_dt, lag) = (0.002, 0.03);
    let options = MotorOptions { lag, delay: 7.0 * sim_dt, ..MotorOptions::default() };
    let mut shaft = Shaft::new(&options, TORQUE, sim_dt, 5);
    for step in 0..100 {
        let found = shaft.torques([1.0; 3], [0.0; 3])[0];
        let expected = TORQUE * -(-f64::from((step - 6).max(0)) * sim_dt / lag).exp_m1();
        assert!((found - expected).abs() < 1e-14, "step {step}: {found}, expected {expected}");
    }
}

#[test]
fn strength_applies_to_each_wheel() {
    let strength = [0.0, 0.8, 1.25];
    let mut shaft = Shaft::new(&MotorOptions { strength, ..MotorOptions::default() }, TORQUE, 0.002, 5);
    let expected = [0.0, -0.8 * TORQUE, 1.25 * TORQUE];
    assert_eq!(shaft.torques([1.0, -1.0, 1.0], [3.0; 3]), expected);
}

#[test]
fn torque_beyond_the_peak_is_cut_with_its_sign() {
    let options = MotorOptions { peak_torque: 0.3, ..MotorOptions::default() };
    let mut shaft = Shaft::new(&options, TORQUE, 0.002, 5);
    assert_eq!(shaft.torques([1.0, -1.0, 0.5], [0.0; 3]), [0.3, -0.3, 0.25]);
    // Without their own peak torque the motors have the limit of the parameters.
    let options = MotorOptions { strength: [10.0; 3], ..MotorOptions::default() };
    let mut shaft = Shaft::new(&options, 1.0, 0.002, 5);
    assert_eq!(shaft.torques([1.0, -1.0, 0.25], [0.0; 3]), [LIMIT, -LIMIT, 2.5]);
}

/// Stall torque, no-load speed and peak torque whose corner is at 12 rad/s.
fn curve() -> MotorOptions {
    MotorOptions { stall_torque: 1.0, no_load_speed: 30.0, peak_torque: 0.6, ..MotorOptions::default() }
}

#[test]
fn torque_falls_from_the_corner_to_the_no_load_speed() {
    let options = curve();
    let corner = options.no_load_speed * (1.0 - options.peak_torque / options.stall_torque);
    let mut shaft = Shaft::new(&options, 2.0, 1e-3, 5);
    for k in 0..=60 {
        let speed = 0.5 * f64::from(k);
        let full = options.stall_torque * (1.0 - speed / options.no_load_speed);
        let expected = if speed < corner { options.peak_torque } else { full };
        let [forward, backward, _] = shaft.torques([1.0, -1.0, 0.0], [speed, -speed, 0.0]);
        assert!((forward - expected).abs() < 1e-15, "{forward} at {speed} rad/s, expected {expected}");
        assert_eq!(backward, -forward, "at {speed} rad/s");
    }
    // Within the curve a command is unchanged.
    assert_eq!(shaft.torques([0.05, -0.05, 0.05], [corner, corner, -corner]), [0.1, -0.1, 0.1]);
}

/// The four quadrants: driving is limited by the voltage, braking by the current, and beyond the no-load speed the
/// back-EMF brakes for any command.
#[test]
fn quadrants_of_the_curve_match_a_dc_motor() {
    let options = curve();
    let slope = options.stall_torque / options.no_load_speed;
    let mut shaft = Shaft::new(&options, 2.0, 1e-3, 5);
    let speeds = [20.0, 20.0, 20.0];
    let [driving, idle, braking] = shaft.torques([1.0, 0.0, -1.0], speeds);
    assert!((driving - slope * 10.0).abs() < 1e-15, "{driving}");
    assert_eq!(idle, 0.0);
    // The voltage would allow 1.67 N·m.
    assert_eq!(braking, -options.peak_torque);
    let [driving, idle, braking] = shaft.torques([1.0, 0.0, -1.0], [36.0; 3]);
    for torque in [driving, idle] {
        assert!((torque + slope * 6.0).abs() < 1e-15, "{torque}");
    }
    assert_eq!(braking, -options.peak_torque);
    // The current limit also holds beyond it.
    assert_eq!(shaft.torques([1.0, 0.0, -1.0], [300.0, -300.0, -300.0]), [-0.6, 0.6, 0.6]);
}

/// A torque of ±0.4 N·m on a wheel with a speed limit.
#[test]
fn torque_fades_to_the_speed_limit_and_brakes_beyond_it() {
    let limit = 10.0;
    let options = MotorOptions { speed_limit: limit, ..MotorOptions::default() };
    let mut shaft = Shaft::new(&options, 0.4, 0.002, 5);
    for (speed, share) in [(0.0, 1.0), (8.9, 1.0), (9.0, 1.0), (9.25, 0.75), (9.5, 0.5), (10.0, 0.0), (11.0, 0.0)] {
        let [forward, backward, braking] = shaft.torques([1.0, -1.0, -1.0], [speed, -speed, speed]);
        assert!((forward - 0.4 * share).abs() < 1e-14, "{forward} at {speed} rad/s");
        assert_eq!(backward, -forward, "at {speed} rad/s");
        let expected = if speed > 0.0 { -0.4 } else { -0.4 * share };
        assert_eq!(braking, expected, "at {speed} rad/s");
    }
}
