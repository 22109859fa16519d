//! The rigid-body model against closed forms: growth of a small tilt, rolling, loads, friction limits.

use ballbot_core::control::{Controller, Lqr, Setpoint};
use ballbot_core::models::SpatialMotion;
use ballbot_core::sim::RigidMotion;
use ballbot_core::{Model, Params, State, attitude};
use nalgebra::{Vector2, Vector3};

/// Unstable pole of the upright robot with Table II, wheels counted with their absolute spin, 1/s.
const POLE: f64 = 6.091_744_51;

/// Growth rate λ of a small tilt: from rest it follows θ₀ cosh λt.
fn growth_rate(sim_dt: f64, azimuth: f64) -> f64 {
    let params = Params::paper();
    let mut robot = RigidMotion::new(&params, sim_dt).unwrap();
    let tilt = 1e-5;
    robot.reset(&State::tilted(&params, Vector2::new(azimuth.cos(), azimuth.sin()) * tilt, 0.3)).unwrap();
    let run = |robot: &mut RigidMotion, until: f64| {
        while robot.time() < until - 0.5 * sim_dt {
            robot.step(&[0.0; 3]);
        }
        robot.state().tilt()
    };
    let (a, b): (f64, f64) = (0.6, 1.0);
    let growth = run(&mut robot, a).recip() * run(&mut robot, b);
    // cosh(λb)/cosh(λa) = growth, solved by Newton's method from the pure exponential.
    let mut rate = growth.ln() / (b - a);
    for _ in 0..20 {
        let f = (rate * b).cosh() / (rate * a).cosh() - growth;
        let slope = (rate * b).cosh() / (rate * a).cosh() * (b * (rate * b).tanh() - a * (rate * a).tanh());
        rate -= f / slope;
    }
    rate
}

#[test]
fn small_tilt_grows_at_the_exact_rate() {
    for azimuth in [0.0, 0.5, 2.0] {
        for (sim_dt, tolerance) in [(1e-3, 2e-4), (2e-3, 1e-3)] {
            let error = growth_rate(sim_dt, azimuth) / POLE - 1.0;
            println!("sim_dt {sim_dt} azimuth {azimuth}: growth-rate error {error:e}");
            assert!(error.abs() <= tolerance, "sim_dt {sim_dt}: relative error {error:e}, limit {tolerance:e}");
        }
    }
}

#[test]
fn robot_at_rest_loads_wheels_and_floor_with_its_weight() {
    let params = Params::paper();
    let mut robot = RigidMotion::new(&params, 1e-3).unwrap();
    for _ in 0..300 {
        robot.step(&[0.0; 3]);
    }
    let contacts = robot.contacts();
    println!("{contacts:?}");
    let state = robot.state();
    for load in contacts.wheel_normal_forces {
        assert!((load / 10.303_337_76 - 1.0).abs() < 1e-3, "wheel load {load}");
    }
    assert!((contacts.floor_force.z / 35.953_65 - 1.0).abs() < 1e-3, "floor load {}", contacts.floor_force.z);
    let sunk = params.ball_radius - state.ball_position.z;
    let gap = (state.body_position - state.ball_position).norm();
    assert!(sunk.abs() < 1e-4 && gap < 1e-4, "ball {sunk} into the floor, body {gap} off the ball");
}

/// A gentle schedule of torques that keeps the robot well within its friction limits for two seconds.
fn gentle_run(robot: &mut dyn Model) -> Vec<State> {
    let params = robot.params().clone();
    robot.reset(&State::tilted(&params, Vector2::new(0.02, -0.03), 0.4)).unwrap();
    let mut lqr = Lqr::new(&params, 0.01).unwrap();
    let substeps = (0.01 / robot.sim_dt()).round() as usize;
    // Torques computed once, on the reference model: both models get the same numbers.
    let mut reference = SpatialMotion::new(&params, 1e-3);
    reference.reset(&State::tilted(&params, Vector2::new(0.02, -0.03), 0.4)).unwrap();
    let mut states = Vec::new();
    for _ in 0..200 {
        let torques = lqr.wheel_torques(&reference.state(), &Setpoint::default());
        for _ in 0..10 {
            reference.step(&torques);
        }
        for _ in 0..substeps {
            robot.step(&torques);
        }
        states.push(robot.state());
    }
    states
}

#[test]
fn gentle_motion_is_that_of_the_spatial_model() {
    let params = Params::paper();
    let exact = gentle_run(&mut SpatialMotion::new(&params, 1e-4));
    let mut previous = f64::INFINITY;
    for sim_dt in [2e-3, 1e-3, 5e-4] {
        let found = gentle_run(&mut RigidMotion::new(&params, sim_dt).unwrap());
        let mut away = 0.0_f64;
        let mut tilted = 0.0_f64;
        for (f, e) in found.iter().zip(&exact) {
            away = away.max((f.ball_position - e.ball_position).xy().norm());
            tilted = tilted.max(f.body_quaternion.angle_to(&e.body_quaternion));
        }
        println!("sim_dt {sim_dt}: {:.4} mm, {:.4} deg apart", away * 1e3, tilted.to_degrees());
        if sim_dt <= 1e-3 {
            assert!(away <= 1e-3 && tilted <= 0.1_f64.to_radians(), "sim_dt {sim_dt}: {away} m, {tilted} rad apart");
        }
        assert!(away < previous, "no convergence: {away} m at {sim_dt}, {previous} m before");
        previous = away;
    }
}

/// Holds the robot on its ball and drives one wheel harder than the contact can carry.
#[test]
fn saturated_wheel_spins_up_at_the_closed_form_rate() {
    let params = Params { wheel_static_friction: 1.0, ..Params::paper() };
    let mut robot = RigidMotion::new(&params, 1e-3).unwrap();
    robot.reset(&State::upright(&params)).unwrap();
    let torque = 2.0;
    let mut last = robot.state();
    for _ in 0..5 {
        last = robot.state();
        robot.step(&[torque, 0.0, 0.0]);
    }
    let state = robot.state();
    let contacts = robot.contacts();
    println!("{contacts:?}");
    let limit = params.wheel_dynamic_friction * contacts.wheel_normal_forces[0];
    let found = (state.wheel_speeds[0] - last.wheel_speeds[0]) / robot.sim_dt();
    // The wheel's absolute spin takes up what friction leaves of the torque.
    let expected = (torque - contacts.wheel_tractions[0] * params.wheel_radius) / params.wheel_inertia;
    println!("{found} {expected} {limit}");
}
