//! Encoders of 512 ticks read every 2 ms, a tick of which is 6 rad/s.

use super::options;
use super::record::{Filter, Noise, Plan, Sensors, read};
use ballbot_core::control::{Controller, Lqr};
use ballbot_core::sensor::estimator::EstimatorOptions;
use ballbot_core::{Ballbot, ModelKind, Params, State};
use std::f64::consts::TAU;

const DT: f64 = 0.002;
const TICK: f64 = TAU / 512.0;

/// Results of a run.
#[derive(Debug, Default)]
struct Seen {
    /// Steps in which a wheel slips on the ball.
    slipped: usize,
    /// Wheels that were gated, in steps with slip and in other steps.
    gated: f64,
    gated_in_grip: f64,
    /// Largest error of the ball's velocity, m/s.
    velocity: f64,
}

/// The robot under LQR on the true state, with torques of `burst` (N·m) on each wheel in turn.
fn run(friction: f64, burst: f64, gates: f64) -> Seen {
    let params = Params { wheel_static_friction: friction, wheel_dynamic_friction: friction, ..Params::paper() };
    let options = EstimatorOptions {
        gyro_noise: 1e-4,
        gyro_bias: [0.0; 3],
        gyro_bias_walk: [0.0; 3],
        accelerometer_noise: 1e-2,
        encoder_noise: TICK / 12.0_f64.sqrt(),
        slip_gate: gates * options().slip_gate,
        jump_gate: gates * options().jump_gate,
        ..options()
    };
    let noise = Noise { gyro: 0.0, gyro_bias: 0.0, accelerometer: 0.0, tick: TICK };
    let mut robot = Ballbot::new(&params, ModelKind::Contact, DT / 2.0).unwrap();
    robot.reset(&State::at_equilibrium(&params, 0.0)).unwrap();
    let mut lqr = Lqr::new(&params, DT).unwrap();
    let mut sensors = Sensors::new(&noise, 0);
    let start = robot.state();
    let mut filter = Filter::new(&params, &options, DT, &start, &sensors.read(&read(&params, &start, &start, DT), DT));
    let plan = Plan { dt: DT, ..Plan::default() };
    let mut seen = Seen::default();
    for k in 0..2500 {
        let before = robot.state();
        let mut torques = lqr.wheel_torques(&before, &plan.setpoint(k));
        if k % 250 < 15 {
            torques[(k / 250) % 3] += if k % 500 < 250 { burst } else { -burst };
        }
        robot.step(torques, 2).unwrap();
        let now = robot.state();
        let found = filter.update(&sensors.read(&read(&params, &before, &now, DT), DT));
        let gated = filter.slipping().iter().sum::<f64>();
        let slips = robot.contacts().wheel_slip_speeds.iter().any(|speed| speed.abs() > 0.05);
        seen.slipped += usize::from(slips);
        *if slips { &mut seen.gated } else { &mut seen.gated_in_grip } += gated;
        seen.velocity = seen.velocity.max((now.ball_velocity - found.ball_velocity).norm());
    }
    assert!(robot.state().tilt() < 0.3, "the robot fell");
    println!("friction {friction}, burst {burst} N·m, gates {gates}: {seen:?}");
    seen
}

#[test]
fn an_encoder_tick_is_not_slip() {
    let seen = run(Params::paper().wheel_dynamic_friction, 0.0, 1.0);
    assert_eq!((seen.slipped, seen.gated_in_grip), (0, 0.0));
}

#[test]
fn slip_is_found_between_the_ticks() {
    let (gated, open) = (run(0.5, 0.5, 1.0), run(0.5, 0.5, 1e5));
    assert!(gated.slipped > 30 && gated.gated > 0.5 * gated.slipped as f64, "{gated:?}");
    assert!(open.gated == 0.0 && open.velocity > 3.0 * gated.velocity, "{open:?} without gates, {gated:?} with them");
}
