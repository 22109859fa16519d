//! Wheels without traction, which spin only under their motors.

use crate::run::Run;
use ballbot_core::actuator::MotorOptions;
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, ResetRequest};
use ballbot_core::{ModelKind, Params, State, Wheels};

const SIM_DT: f64 = 0.001;

/// The paper's robot on a ball without friction.
fn slippery() -> Params {
    Params { wheel_static_friction: 0.0, wheel_dynamic_friction: 0.0, ..Params::paper() }
}

/// A robot upright at rest, its wheels on the ball without traction, an action of 1 being 0.5 N·m.
fn spinning(actuators: MotorOptions, model: ModelKind) -> Run {
    let config = BalanceConfig {
        params: slippery(),
        model,
        sim_dt: SIM_DT,
        control_dt: SIM_DT,
        max_wheel_torque: Some(0.5),
        actuators,
        ..BalanceConfig::default()
    };
    let mut run = Run::new(Batch::new(&config, 1, Autoreset::Disabled, Some(1), 0).unwrap());
    let starts = [Some(State::upright(&config.params))];
    let request = ResetRequest { starts: Some(&starts), ..ResetRequest::default() };
    run.batch.reset_with(&request, &mut run.observations).unwrap();
    run
}

fn speeds(run: &Run) -> [f64; 3] {
    run.batch.state(0).unwrap().wheel_speeds.0
}

/// Acceleration of the wheels relative to the body for equal torques of 1 N·m, rad/s²: the body turns the other way.
fn acceleration(params: &Params) -> f64 {
    1.0 / params.wheel_inertia + 3.0 * params.wheel_zenith.sin().powi(2) / params.body_inertia[2]
}

#[test]
fn free_wheel_comes_to_the_no_load_speed() {
    let options = MotorOptions { stall_torque: 0.3, no_load_speed: 20.0, ..MotorOptions::default() };
    let share = SIM_DT * acceleration(&slippery()) * options.stall_torque / options.no_load_speed;
    let mut run = spinning(options.clone(), ModelKind::Contact);
    let mut worst = 0.0_f64;
    for step in 1..=300 {
        run.step(&[1.0; 3]).unwrap();
        let expected = options.no_load_speed * (1.0 - (1.0 - share).powi(step));
        for speed in speeds(&run) {
            worst = worst.max((speed - expected).abs());
        }
    }
    println!("free wheel, largest error on the way to {} rad/s: {worst:e} rad/s", options.no_load_speed);
    assert!(worst < 1e-9, "{worst:e}");
    assert!((speeds(&run)[0] - options.no_load_speed).abs() < 1e-9, "{:?}", speeds(&run));
}

/// A wheel that another effect has driven beyond the no-load speed is braked without a command, and its energy falls.
#[test]
fn wheel_beyond_the_no_load_speed_is_braked() {
    let options = MotorOptions { stall_torque: 0.3, no_load_speed: 20.0, ..MotorOptions::default() };
    let mut run = spinning(options.clone(), ModelKind::Contact);
    let fast = State { wheel_speeds: Wheels([30.0; 3]), ..State::upright(&slippery()) };
    let starts = [Some(fast)];
    let request = ResetRequest { starts: Some(&starts), ..ResetRequest::default() };
    run.batch.reset_with(&request, &mut run.observations).unwrap();
    let share = SIM_DT * acceleration(&slippery()) * options.stall_torque / options.no_load_speed;
    for step in 1..=200 {
        run.step(&[0.0; 3]).unwrap();
        let expected = options.no_load_speed + 10.0 * (1.0 - share).powi(step);
        for speed in speeds(&run) {
            assert!((speed - expected).abs() < 1e-9, "{speed} after {step} steps, expected {expected}");
        }
    }
}

#[test]
fn free_wheel_stays_within_its_speed_limit_and_a_step() {
    let options = MotorOptions { speed_limit: 25.0, ..MotorOptions::default() };
    let step = SIM_DT * acceleration(&slippery()) * 0.5;
    let mut run = spinning(options.clone(), ModelKind::Contact);
    let mut highest = 0.0_f64;
    for _ in 0..300 {
        run.step(&[1.0; 3]).unwrap();
        highest = speeds(&run).into_iter().fold(highest, f64::max);
    }
    assert!(highest < options.speed_limit + step, "{highest} rad/s, a step of {step} rad/s");
    assert!(speeds(&run)[0] > 0.9 * options.speed_limit, "{:?}", speeds(&run));
    // Ideal motors do not stop there.
    let mut ideal = spinning(MotorOptions::default(), ModelKind::Contact);
    for _ in 0..300 {
        ideal.step(&[1.0; 3]).unwrap();
    }
    assert!(speeds(&ideal)[0] > 10.0 * options.speed_limit, "{:?}", speeds(&ideal));
}
