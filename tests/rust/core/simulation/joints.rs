//! Friction of the wheel joints.

use super::{Motion, Simulation, for_both, leaning, run};
use ballbot_core::models::SpatialMotion;
use ballbot_core::{Model, Params, State, Wheels, attitude};
use nalgebra::{Vector2, Vector3};

/// The paper's robot with friction in its wheel joints: viscous, N·m/(rad/s), and dry, N·m.
fn with_friction(viscous: f64, dry: f64) -> Params {
    Params { wheel_viscous_friction: viscous, wheel_coulomb_friction: dry, ..Params::paper() }
}

fn viscous() -> Params {
    with_friction(1e-3, 0.0)
}

fn dry() -> Params {
    with_friction(0.0, 0.01)
}

fn joint_friction_slows_wheels_that_turn_in_the_air(simulation: Simulation) {
    let params = Params::paper();
    let mut state = State::upright(&params);
    state.ball_position.z = 20.0;
    state.body_position.z = 30.0;
    state.wheel_speeds = Wheels([20.0, 20.0, 20.0]);
    let speed_after = |damped: &Params, steps: usize| {
        let mut robot = simulation.robot(&params, 1e-4);
        robot.set_params(damped).unwrap();
        robot.reset(&state).unwrap();
        run(robot.as_mut(), [0.0; 3], steps);
        robot.state().wheel_speeds[0]
    };
    // Three wheels against the body about the vertical: the body's yaw takes up a fraction c of each relative speed.
    let share = 1.0 + 3.0 * params.wheel_inertia * 0.5 / params.body_inertia[2];
    let expected = 20.0 * (-1e-3 * share / params.wheel_inertia * 0.1).exp();
    let found = speed_after(&viscous(), 1000);
    println!("viscous {:e}", found / expected - 1.0);
    assert!((found / expected - 1.0).abs() < 1e-3, "viscous: {found}, expected {expected}");
    let expected = 20.0 - 0.01 * share / params.wheel_inertia * 0.1;
    let found = speed_after(&dry(), 1000);
    println!("dry {:e}", found / expected - 1.0);
    assert!((found / expected - 1.0).abs() < 1e-9, "dry: {found}, expected {expected}");
    assert!(speed_after(&dry(), 6000).abs() < 1e-6, "dry friction does not bring the wheel to rest");
}

/// Ball and body velocities after 0.2 s of rolling.
fn rolled(robot: &mut dyn Model, params: &Params) -> State {
    robot.set_params(params).unwrap();
    let start = State::rolling(params, Vector2::new(0.4, 0.1), 0.5, attitude(Vector2::zeros(), 0.3), Vector3::zeros());
    robot.reset(&start).unwrap();
    run(robot, [0.0; 3], 200);
    robot.state()
}

fn joint_friction_of_a_rolling_robot_matches_the_spatial_model(simulation: Simulation) {
    let params = Params::paper();
    let free = rolled(&mut SpatialMotion::new(&params, 1e-3), &params);
    // The spatial model builds dry friction up over 0.05 rad/s, these simulations let wheels stick.
    for (damped, limit) in [(viscous(), simulation.pick(3e-3, 5e-4)), (dry(), 1e-2)] {
        let exact = rolled(&mut SpatialMotion::new(&params, 1e-3), &damped);
        let found = rolled(simulation.paper().as_mut(), &damped);
        let off = (found.ball_velocity - exact.ball_velocity).norm();
        let matters = (free.ball_velocity - exact.ball_velocity).norm();
        println!("{off:e} m/s apart, friction makes {matters}");
        assert!(off < limit * matters, "{off} m/s apart, friction makes {matters}");
    }
}

/// A motor weaker than its joint's dry friction turns nothing.
fn dry_friction_holds_a_wheel_at_rest(simulation: Simulation) {
    let turned = |torque: f64| {
        let mut robot = simulation.paper();
        robot.set_params(&with_friction(0.0, 0.1)).unwrap();
        // In the air, where nothing else holds it.
        let mut start = State::upright(&Params::paper());
        start.ball_position.z = 20.0;
        start.body_position.z = 30.0;
        robot.reset(&start).unwrap();
        run(robot.as_mut(), [torque, 0.0, 0.0], 200);
        let state = robot.state();
        (state.wheel_speeds[0].abs(), state.wheel_angles[0].abs(), state.body_angular_velocity.norm())
    };
    let (speed, angle, body) = turned(0.099);
    println!("held: {speed:e} rad/s, {angle:e} rad, body {body:e} rad/s");
    assert!(speed < 1e-6 && angle < 1e-6 && body < 1e-6, "turns with {speed} rad/s, by {angle} rad, body {body} rad/s");
    let (speed, ..) = turned(0.101);
    assert!(speed > 0.1, "held beyond its friction: {speed} rad/s");
}

/// Wheels held by dry friction do not turn, whatever the robot does: it tips over with its ball as one body.
fn dry_friction_does_not_creep(simulation: Simulation) {
    for sim_dt in [2e-3, 1e-3] {
        let params = with_friction(0.0, 0.4);
        let mut robot = simulation.robot(&params, sim_dt);
        robot.reset(&leaning(&params, 1.0)).unwrap();
        let steps = (0.2 / sim_dt).round() as usize;
        run(robot.as_mut(), [0.05, -0.03, 0.02], steps);
        let state = robot.state();
        let turned = state.wheel_angles.into_iter().fold(0.0, |most: f64, angle| most.max(angle.abs()));
        println!("{sim_dt} s: turned by {turned:e} rad, tilt {}", state.tilt());
        assert!(turned <= simulation.pick(1e-9, 1e-4), "{sim_dt} s: the wheels turn by {turned:e} rad");
        assert!(state.tilt() > 1.2_f64.to_radians(), "does not tip over");
    }
}

for_both!(
    dry_friction_does_not_creep,
    joint_friction_slows_wheels_that_turn_in_the_air,
    joint_friction_of_a_rolling_robot_matches_the_spatial_model,
    dry_friction_holds_a_wheel_at_rest,
);
