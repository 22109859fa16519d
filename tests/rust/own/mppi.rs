//! Path integral control by samples of the contact model.

use ballbot_core::control::{
    Controller, LimitOptions, Lqr, Motion, Reference, Setpoint, Turning, controller_kind, register_controller,
};
use ballbot_core::planning::{self, Mppi, MppiOptions};
use ballbot_core::{Ballbot, ModelKind, Params, State};
use nalgebra::{Vector2, Vector3};
use std::f64::consts::TAU;

const CONTROL_DT: f64 = Mppi::CONTROL_DT;

fn mppi(options: &MppiOptions) -> Mppi {
    Mppi::with_options(&Params::paper(), CONTROL_DT, options, &LimitOptions::TRACTION).unwrap()
}

/// The final state after a time under a controller, if the robot has not fallen.
fn end(controller: &mut dyn Controller, start: &State, impulse: Vector3<f64>, seconds: f64) -> Option<State> {
    let mut robot = Ballbot::new(&Params::paper(), ModelKind::Contact, 0.002).unwrap();
    robot.reset(start).unwrap();
    robot.push(&impulse, None).unwrap();
    for _ in 0..(seconds / CONTROL_DT) as usize {
        let torques = controller.wheel_torques(&robot.state(), &Setpoint::default());
        robot.step(torques, 10).unwrap();
        if robot.state().tilt() > 1.0 {
            return None;
        }
    }
    Some(robot.state())
}

fn around(count: u32) -> impl Iterator<Item = Vector2<f64>> {
    (0..count).map(move |k| TAU / 3.0 * f64::from(k) / f64::from(count)).map(|a| Vector2::new(a.cos(), a.sin()))
}

#[test]
fn samples_depend_only_on_the_seed_and_the_call() {
    let options = MppiOptions { samples: 64.0, ..MppiOptions::default() };
    let state = State::tilted(&Params::paper(), Vector2::new(0.1, 0.05), 0.3);
    let calls = |mut controller: Mppi| {
        [(); 3].map(|()| controller.wheel_torques(&state, &Setpoint::default()).map(f64::to_bits))
    };
    let first = calls(mppi(&options));
    assert_eq!(first, calls(mppi(&options)));
    assert_ne!(first, calls(mppi(&MppiOptions { seed: 1.0, ..options })));
    let mut again = mppi(&options);
    again.wheel_torques(&state, &Setpoint::default());
    again.reset();
    assert_eq!(first, calls(again));
}

/// With a single sample nothing is added to the regulator's torques where all samples cost the
/// same.
#[test]
fn without_noise_it_is_the_regulator() {
    let options = MppiOptions { samples: 8.0, noise: 1e-300, ..MppiOptions::default() };
    let mut regulator = Lqr::new(&Params::paper(), CONTROL_DT).unwrap();
    let state = State::tilted(&Params::paper(), Vector2::new(0.05, -0.02), 0.3);
    let found = mppi(&options).wheel_torques(&state, &Setpoint::default());
    let expected = regulator.wheel_torques(&state, &Setpoint::default());
    for (found, expected) in found.into_iter().zip(expected) {
        assert!((found - expected).abs() < 1e-12, "{found}, {expected}");
    }
}

#[test]
fn the_height_of_a_terrain_changes_nothing() {
    let options = MppiOptions { samples: 64.0, ..MppiOptions::default() };
    let mut state = State::tilted(&Params::paper(), Vector2::new(0.1, 0.05), 0.3);
    let expected = mppi(&options).wheel_torques(&state, &Setpoint::default());
    state.ball_position.z += 0.5;
    state.body_position.z += 0.5;
    let found = mppi(&options).wheel_torques(&state, &Setpoint::default());
    for (found, expected) in found.into_iter().zip(expected) {
        assert!((found - expected).abs() < 1e-9, "{found}, {expected}");
    }
}

/// With fewer samples than the default, which takes long in a test build.
fn few() -> MppiOptions {
    MppiOptions { samples: 64.0, ..MppiOptions::default() }
}

#[test]
fn it_comes_to_rest_from_tilts_and_pushes_at_the_limit() {
    let params = Params::paper();
    for direction in around(3) {
        let tilted = State::tilted(&params, direction * 25_f64.to_radians(), 0.0);
        let push = direction.push(0.0) * 1.8;
        for (start, impulse) in [(tilted, Vector3::zeros()), (State::upright(&params), push)] {
            let end = end(&mut mppi(&few()), &start, impulse, 6.0).expect("it balances");
            let left = end.ball_position.xy().norm();
            assert!(end.tilt() < 0.02 && left < 0.1, "{} rad, {left} m", end.tilt());
        }
    }
}

/// The cost of a motion is only the robot's deviation from it: no lag.
#[test]
fn it_follows_a_circle_without_trailing() {
    let params = Params::paper();
    let circle = Motion::Circle { radius: 0.5, period: 4.0, start: 2.0 };
    let circle = Reference::new(&params, circle, Turning::default(), None).unwrap();
    let mut controller = mppi(&MppiOptions { horizon: 0.2, ..few() });
    let mut robot = Ballbot::new(&params, ModelKind::Contact, 0.002).unwrap();
    robot.reset(&State::upright(&params)).unwrap();
    let (mut along, mut count) = (0.0, 0.0);
    for k in 0..300 {
        let target = circle.at(f64::from(k) * CONTROL_DT);
        if k >= 100 {
            let off = robot.state().ball_position.xy() - target.position;
            along += off.dot(&target.velocity.normalize());
            count += 1.0;
        }
        let torques = controller.wheel_torques(&robot.state(), &target);
        robot.step(torques, 10).unwrap();
    }
    println!("{:.1} mm along the circle", along / count * 1e3);
    assert!((along / count).abs() < 0.015, "{} m", along / count);
}

#[test]
fn it_is_found_by_name_once_registered() {
    planning::register().unwrap();
    planning::register().unwrap();
    let kind = controller_kind("mppi").unwrap();
    assert_eq!(kind.control_dt, Some(CONTROL_DT));
    assert!(register_controller(kind).is_err());
}

#[test]
fn numbers_out_of_range_are_rejected() {
    let rejected = |options: MppiOptions, words: &str| {
        let made = Mppi::with_options(&Params::paper(), CONTROL_DT, &options, &LimitOptions::TRACTION);
        let message = made.unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    };
    let options = MppiOptions::default();
    rejected(MppiOptions { samples: 0.0, ..options }, "samples = 0");
    rejected(MppiOptions { horizon: 0.01, ..options }, "horizon = 0.01");
    rejected(MppiOptions { temperature: 0.0, ..options }, "temperature = 0");
    rejected(MppiOptions { correlation: 1.0, ..options }, "correlation = 1");
}

/// Diverged samples are not simulated further.
#[test]
fn for_a_diverged_state_the_torques_equal_the_regulator() {
    let mut state = State::upright(&Params::paper());
    state.ball_velocity.x = f64::NAN;
    let torques = mppi(&MppiOptions::default()).wheel_torques(&state, &Setpoint::default());
    assert!(torques.iter().any(|torque| torque.is_nan()));
}
