//! Nonlinear model predictive control along the derivatives of the contact model.

use ballbot_core::control::{
    Controller, LimitOptions, Lqr, Motion, Mpc, NamedLaw, Reference, Setpoint, Turning, controller_kind,
};
use ballbot_core::gradients::{Coordinates, Differentiable, Differentiated};
use ballbot_core::planning::{self, Nmpc, NmpcOptions};
use ballbot_core::sim::ContactMotion;
use ballbot_core::{Ballbot, Model, ModelKind, Params, State, Wheels};
use nalgebra::{Vector2, Vector3};
use std::f64::consts::TAU;

const CONTROL_DT: f64 = Nmpc::CONTROL_DT;

fn nmpc(params: &Params) -> Nmpc {
    Nmpc::with_options(params, CONTROL_DT, &NmpcOptions::default(), &LimitOptions::TRACTION).unwrap()
}

/// Whether a robot comes to rest within 6 s.
fn comes_to_rest(controller: &mut dyn Controller, params: &Params, start: &State, impulse: Vector3<f64>) -> bool {
    let mut robot = Ballbot::new(params, ModelKind::Contact, 0.002).unwrap();
    robot.reset(start).unwrap();
    robot.push(&impulse, None).unwrap();
    controller.reset();
    for _ in 0..(6.0 / CONTROL_DT) as usize {
        let torques = controller.wheel_torques(&robot.state(), &Setpoint::default());
        if robot.step(torques, 5).is_err() || robot.state().tilt() > 1.0 {
            return false;
        }
    }
    robot.state().tilt() < 0.02 && robot.state().ball_position.xy().norm() < 0.1
}

fn around(count: u32) -> impl Iterator<Item = Vector2<f64>> {
    (0..count).map(move |k| TAU / 3.0 * f64::from(k) / f64::from(count)).map(|a| Vector2::new(a.cos(), a.sin()))
}

/// It turns the robot back in all directions from a tilt at which the regulator and linear model predictive control let it
/// fall in some; traction can turn it back from 29.7 deg at most.
#[test]
fn it_recovers_from_tilts_beyond_linear_control() {
    let params = Params::paper();
    let mut fallen = [0; 2];
    for direction in around(6) {
        let start = State::tilted(&params, direction * 29_f64.to_radians(), 0.0);
        assert!(comes_to_rest(&mut nmpc(&params), &params, &start, Vector3::zeros()), "toward {direction:?}");
        let mut linear: [Box<dyn Controller>; 2] = [
            Box::new(Lqr::new(&params, CONTROL_DT).unwrap()),
            Box::new(Mpc::with_defaults(&params, CONTROL_DT).unwrap()),
        ];
        for (law, count) in linear.iter_mut().zip(&mut fallen) {
            *count += u32::from(!comes_to_rest(law.as_mut(), &params, &start, Vector3::zeros()));
        }
    }
    println!("of 6 directions: lqr falls in {}, mpc in {}", fallen[0], fallen[1]);
    assert!(fallen[0] > 0 && fallen[1] > 0, "{fallen:?}");
}

/// Deviations of the state from rolling on a level floor, and the height of a terrain, change nothing.
#[test]
fn only_what_the_regulator_feeds_back_counts() {
    let params = Params::paper();
    let mut state = State::tilted(&params, Vector2::new(0.4, 0.1), 0.3);
    let expected = nmpc(&params).wheel_torques(&state, &Setpoint::default());
    state.ball_position.z += 0.5;
    state.body_position.z += 0.503;
    state.body_position.x -= 0.002;
    state.body_velocity.y += 0.02;
    assert_eq!(nmpc(&params).wheel_torques(&state, &Setpoint::default()), expected);
}

/// Tilts in directions in which a plan that used all traction would lift wheels in turn.
#[test]
fn rezero_recovers_from_tilts_from_which_the_regulator_recovers() {
    let params = Params::preset("rezero").unwrap();
    for k in 0..12 {
        let angle = 0.03 + TAU / 12.0 * f64::from(k);
        let tilt = Vector2::new(angle.cos(), angle.sin()) * 0.25;
        let start = State::tilted_from_equilibrium(&params, tilt, 0.0);
        let mut regulator = Lqr::new(&params, CONTROL_DT).unwrap();
        let [own, linear]: [&mut dyn Controller; 2] = [&mut nmpc(&params), &mut regulator];
        let [own, linear] = [own, linear].map(|law| comes_to_rest(law, &params, &start, Vector3::zeros()));
        assert!(own >= linear, "at {angle}");
    }
}

#[test]
fn every_preset_comes_to_rest_after_a_tilt_and_a_push() {
    for name in Params::preset_names() {
        let params = Params::preset(name).unwrap();
        let upright = State::upright(&params);
        let strength =
            0.7 * (params.body_mass + params.ball_mass) * (params.gravity * params.body_com_height).sqrt() * 0.2;
        for direction in around(2) {
            let tilted = State::tilted(&params, direction * 0.1, 0.0);
            let mut law = nmpc(&params);
            assert!(comes_to_rest(&mut law, &params, &tilted, Vector3::zeros()), "{name} tilted");
            assert!(comes_to_rest(&mut law, &params, &upright, direction.push(0.0) * strength), "{name} pushed");
        }
    }
}

/// A far setpoint is approached as fast as the regulator's largest lean and speed allow.
#[test]
fn it_drives_to_a_setpoint_ten_meters_away() {
    let params = Params::paper();
    let mut controller = nmpc(&params);
    let mut robot = Ballbot::new(&params, ModelKind::Contact, 0.002).unwrap();
    let target = Setpoint { position: Vector2::new(10.0, -4.0), yaw: 2.0, ..Setpoint::default() };
    for _ in 0..2000 {
        let torques = controller.wheel_torques(&robot.state(), &target);
        robot.step(torques, 5).unwrap();
        assert!(robot.state().tilt() < 0.4, "{}", robot.state().tilt());
    }
    let left = (robot.state().ball_position.xy() - target.position).norm();
    assert!(left < 0.05, "{left} m");
}

/// Of the regulator's lag on a fast circle a third is left.
#[test]
fn it_follows_a_fast_circle_closer_than_the_regulator() {
    let params = Params::paper();
    let circle = Motion::Circle { radius: 0.5, period: 4.0, start: 2.0 };
    let circle = Reference::new(&params, circle, Turning::default(), None).unwrap();
    let rms = |controller: &mut dyn Controller| {
        let mut robot = Ballbot::new(&params, ModelKind::Contact, 0.002).unwrap();
        let mut squares = 0.0;
        for k in 0..1000 {
            let target = circle.at(f64::from(k) * CONTROL_DT);
            squares += (robot.state().ball_position.xy() - target.position).norm_squared();
            robot.step(controller.wheel_torques(&robot.state(), &target), 5).unwrap();
        }
        (squares / 1000.0).sqrt()
    };
    let [own, linear] = [rms(&mut nmpc(&params)), rms(&mut Lqr::new(&params, CONTROL_DT).unwrap())];
    println!("{:.2} mm rms, lqr {:.2} mm", own * 1e3, linear * 1e3);
    assert!(own < 0.5 * linear, "{own} m, {linear} m");
}

/// Near rest nothing is left to improve.
#[test]
fn near_its_setpoint_it_is_the_regulator() {
    let params = Params { wheel_coulomb_friction: 0.01, wheel_viscous_friction: 1e-3, ..Params::paper() };
    let weights = NmpcOptions::default().weights();
    let mut regulator = Lqr::with_weights(&params, CONTROL_DT, &weights, &LimitOptions::TRACTION).unwrap();
    let mut state = State::tilted(&params, Vector2::new(1e-4, -2e-4), 0.001);
    state.wheel_speeds[0] = 0.3;
    assert_eq!(
        nmpc(&params).wheel_torques(&state, &Setpoint::default()),
        regulator.wheel_torques(&state, &Setpoint::default())
    );
}

#[test]
fn torques_depend_only_on_the_calls_since_the_reset() {
    let params = Params::paper();
    let state = State::tilted(&params, Vector2::new(0.1, 0.05), 0.3);
    let target = Setpoint { position: Vector2::new(0.5, 0.2), ..Setpoint::default() };
    let mut law = nmpc(&params);
    let mut calls = || {
        law.reset();
        [(); 3].map(|()| law.wheel_torques(&state, &target).map(f64::to_bits))
    };
    let first = calls();
    assert_eq!(first, calls());
    assert_ne!(first[0], first[2]);
}

#[test]
fn robots_that_lie_fly_or_diverge_get_finite_torques() {
    let params = Params::paper();
    let mut law = nmpc(&params);
    for tilt in [0.8, 1.5, 3.0] {
        let state = State::tilted(&params, Vector2::new(tilt, 0.0), 0.0);
        assert!(law.wheel_torques(&state, &Setpoint::default()).iter().all(|torque| torque.is_finite()), "{tilt}");
    }
    let mut flying = State::upright(&params);
    flying.ball_position.z += 1.0;
    flying.body_position.z += 1.0;
    flying.body_angular_velocity = Vector3::new(20.0, -5.0, 3.0);
    assert!(law.wheel_torques(&flying, &Setpoint::default()).iter().all(|torque| torque.is_finite()));
    let mut diverged = State::upright(&params);
    diverged.body_velocity.x = f64::NAN;
    law.wheel_torques(&diverged, &Setpoint::default());
    law.reset();
    let again = law.wheel_torques(&State::upright(&params), &Setpoint::default());
    assert!(again.iter().all(|torque| torque.is_finite()));
}

#[test]
fn it_is_found_by_name_once_registered() {
    planning::register().unwrap();
    planning::register().unwrap();
    assert_eq!(controller_kind("nmpc").unwrap().control_dt, Some(CONTROL_DT));
}

#[test]
fn numbers_out_of_range_are_rejected() {
    for (options, words) in [
        (NmpcOptions { horizon: 0.005, ..NmpcOptions::default() }, "horizon"),
        (NmpcOptions { horizon: 6.0, ..NmpcOptions::default() }, "horizon"),
        (NmpcOptions { step: 0.0, ..NmpcOptions::default() }, "step"),
        (NmpcOptions { iterations: 0.0, ..NmpcOptions::default() }, "iterations"),
        (NmpcOptions { violation: 0.0, ..NmpcOptions::default() }, "violation"),
        (NmpcOptions { max_lean: -1.0, ..NmpcOptions::default() }, "max_lean"),
    ] {
        let made = Nmpc::with_options(&Params::paper(), CONTROL_DT, &options, &LimitOptions::TRACTION);
        let error = made.unwrap_err().to_string();
        assert!(error.contains(words), "{words}: {error}");
    }
}

/// It plans along the derivatives of the whole Jacobian.
#[test]
fn derivatives_along_rolling_are_the_same_as_of_the_whole_jacobian() {
    for name in Params::preset_names() {
        let params = Params { wheel_viscous_friction: 1e-4, ..Params::preset(name).unwrap() };
        let mut state = State::tilted(&params, Vector2::new(0.1, -0.2), 0.4);
        state.body_angular_velocity = Vector3::new(0.3, 0.2, -0.4);
        let mut motion = ContactMotion::new(&params, 0.002);
        motion.place(&state);
        let robot = || {
            let memory = motion.memory().clone();
            Differentiated::new(&params, motion.constants(), memory, None, &[], Coordinates::All).unwrap()
        };
        let torques = Wheels([0.1, -0.05, 0.02]);
        for steps in [1, 5, 100] {
            let whole = robot().advance(torques, steps).unwrap().rolling(&params).unwrap();
            let own = robot().advance_rolling(torques, steps, &params).unwrap();
            for (own, whole) in [(own.a, whole.a), (own.b, whole.b), (own.c, whole.c), (own.d, whole.d)] {
                let error = (&own - &whole).amax() / whole.amax();
                assert!(error < 1e-11, "{name}, {steps} steps: {error}");
            }
        }
    }
}
