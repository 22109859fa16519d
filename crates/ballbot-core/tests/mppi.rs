//! Path integral control by samples of the contact model.

use ballbot_core::control::{Controller, LimitOptions, Lqr, Setpoint, controller_kind, register_controller};
use ballbot_core::planning::{self, Mppi, MppiOptions};
use ballbot_core::{Ballbot, ModelKind, Params, State};
use nalgebra::{Vector2, Vector3};
use std::f64::consts::TAU;

const CONTROL_DT: f64 = Mppi::CONTROL_DT;

fn mppi(options: &MppiOptions) -> Mppi {
    Mppi::with_options(&Params::paper(), CONTROL_DT, options, &LimitOptions::TRACTION).unwrap()
}

/// The end after a time under a controller, if the robot has not fallen; and the sum of squared tilts.
fn end(controller: &mut dyn Controller, start: &State, impulse: Vector3<f64>, seconds: f64) -> Option<(State, f64)> {
    let mut robot = Ballbot::new(&Params::paper(), ModelKind::Contact, 0.002).unwrap();
    robot.reset(start).unwrap();
    robot.push(&impulse, None).unwrap();
    let mut sum = 0.0;
    for _ in 0..(seconds / CONTROL_DT) as usize {
        let torques = controller.wheel_torques(&robot.state(), &Setpoint::default());
        robot.step(&torques, 10).unwrap();
        sum += robot.state().tilt().powi(2);
        if robot.state().tilt() > 1.0 {
            return None;
        }
    }
    Some((robot.state(), sum))
}

fn around(count: u32) -> impl Iterator<Item = Vector2<f64>> {
    (0..count).map(move |k| TAU / 3.0 * f64::from(k) / f64::from(count)).map(|a| Vector2::new(a.cos(), a.sin()))
}

#[test]
fn samples_depend_on_the_seed_and_the_call_alone() {
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

/// A single sample has nothing to choose from: nothing is added to the regulator's torques where all cost the same.
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
fn it_comes_to_rest_and_stands_what_the_regulator_stands() {
    let params = Params::paper();
    for direction in around(3) {
        let start = State::tilted(&params, direction * 20_f64.to_radians(), 0.0);
        let (end, _) = end(&mut mppi(&MppiOptions::default()), &start, Vector3::zeros(), 6.0).unwrap();
        let left = end.ball_position.xy().norm();
        assert!(end.tilt() < 0.02 && left < 0.05, "{} rad, {left} m", end.tilt());
    }
}

/// Largest tilt from rest, steps of 1 deg, and largest impulse, steps of 0.1 N·s, worst of 6 directions.
#[test]
fn basin_and_push() {
    let params = Params::paper();
    let largest = |numbers: Vec<f64>, holds: &dyn Fn(Vector2<f64>, f64) -> bool| {
        numbers.into_iter().take_while(|&number| around(6).all(|d| holds(d, number))).last().unwrap_or(0.0)
    };
    let stands = |controller: &mut dyn Controller, start: &State, impulse: Vector3<f64>| {
        end(controller, start, impulse, 5.0).is_some_and(|(end, _)| end.tilt() < 0.05)
    };
    let mut found = Vec::new();
    for name in ["mppi", "lqr"] {
        let make = || -> Box<dyn Controller> {
            match name {
                "lqr" => Box::new(Lqr::new(&params, CONTROL_DT).unwrap()),
                _ => Box::new(mppi(&MppiOptions::default())),
            }
        };
        let tilt = largest((22..=31).map(f64::from).collect(), &|direction, degrees| {
            let start = State::tilted(&params, direction * degrees.to_radians(), 0.0);
            stands(make().as_mut(), &start, Vector3::zeros())
        });
        let push = largest((14..=30).map(|k| 0.1 * f64::from(k)).collect(), &|direction, size| {
            stands(make().as_mut(), &State::upright(&params), direction.push(0.0) * size)
        });
        println!("{name}: {tilt} deg, {push:.1} N·s");
        found.push((tilt, push));
    }
    assert!(found[0].0 >= 26.0 && found[0].1 >= 1.9, "{found:?}");
}

#[test]
fn it_is_known_by_its_name_once_registered() {
    planning::register().unwrap();
    planning::register().unwrap();
    let kind = controller_kind("mppi").unwrap();
    assert_eq!(kind.control_dt, Some(CONTROL_DT));
    assert!(register_controller(kind).is_err());
}

#[test]
fn numbers_out_of_range_are_refused() {
    let refused = |options: MppiOptions, says: &str| {
        let made = Mppi::with_options(&Params::paper(), CONTROL_DT, &options, &LimitOptions::TRACTION);
        let message = made.unwrap_err().to_string();
        assert!(message.contains(says), "{message}");
    };
    let options = MppiOptions::default();
    refused(MppiOptions { samples: 0.0, ..options }, "samples = 0");
    refused(MppiOptions { horizon: 0.01, ..options }, "horizon = 0.01");
    refused(MppiOptions { temperature: 0.0, ..options }, "temperature = 0");
    refused(MppiOptions { correlation: 1.0, ..options }, "correlation = 1");
}

/// What has diverged is not simulated on.
#[test]
fn a_diverged_state_gives_what_the_regulator_gives() {
    let mut state = State::upright(&Params::paper());
    state.ball_velocity.x = f64::NAN;
    let torques = mppi(&MppiOptions::default()).wheel_torques(&state, &Setpoint::default());
    assert!(torques.iter().any(|torque| torque.is_nan()));
}
