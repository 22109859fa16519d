//! The preload of the wheels against closed forms, in the simulations with contacts and in the model without slip.

use super::{Motion, Simulation, close, com_velocity, for_both, lifted, run};
use crate::support::general::crooked;
use ballbot_core::models::SpatialMotion;
use ballbot_core::{Contacts, Model, Params, State, Wheels};
use nalgebra::{Matrix3, Vector2, Vector3};

/// Small torques, under which no wheel slips.
const SMALL: [f64; 3] = [0.05, -0.03, 0.02];

fn pressed(params: &Params, weights: f64) -> Params {
    let params = Params { wheel_preload: weights * params.body_mass * params.gravity, ..params.clone() };
    params.validate().unwrap();
    params
}

/// N with Σ N_i p_i = P e_z.
fn preloads(params: &Params) -> Wheels<f64> {
    let directions = Matrix3::from_columns(&params.contact_directions().0);
    Wheels::of_column(directions.try_inverse().unwrap() * Vector3::z() * params.wheel_preload)
}

fn at_rest_it_adds_to_the_loads_of_the_wheels_alone(simulation: Simulation) {
    let paper = Params::paper();
    let weight = paper.body_mass * paper.gravity;
    let floor = (paper.body_mass + paper.ball_mass) * paper.gravity;
    for weights in [0.0, 0.5, 2.0] {
        let params = pressed(&paper, weights);
        let expected = weight * (1.0 + weights) / (3.0 * params.wheel_zenith.cos());
        let mut simulated = simulation.robot(&params, 1e-3);
        let mut exact = SpatialMotion::new(&params, 1e-3);
        for (robot, limit) in [(simulated.as_mut(), 1e-6), (&mut exact as &mut dyn Model, 1e-12)] {
            run(robot, [0.0; 3], 300);
            let contacts = robot.contacts();
            for load in contacts.wheel_normal_forces {
                close("load of a wheel", load, expected, limit * expected);
            }
            close("load of the floor", contacts.floor_force.z, floor, limit * floor);
        }
        for load in params.equilibrium_wheel_loads() {
            close("load in equilibrium", load, expected, 1e-12 * expected);
        }
    }
}

/// The largest difference of two states in any number.
fn apart(a: &State, b: &State) -> f64 {
    a.to_array().iter().zip(b.to_array()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// States, contacts and energies of a robot that rolls under small torques.
fn rolled(robot: &mut dyn Model, start: &State) -> Vec<(State, Contacts, f64)> {
    robot.reset(start).unwrap();
    let mut found = Vec::new();
    for _ in 0..100 {
        robot.step(SMALL);
        found.push((robot.state(), robot.contacts(), robot.energy()));
    }
    found
}

fn it_moves_no_robot_that_rolls(simulation: Simulation) {
    let on_slope = Params { floor_tilt: [0.03, -0.02], ..crooked() };
    for plain in [Params::paper(), on_slope] {
        let params = pressed(&plain, 1.0);
        let start = State::tilted(&plain, Vector2::new(0.03, -0.02), 0.4);
        let simulated = [&plain, &params].map(|params| rolled(simulation.robot(params, 1e-3).as_mut(), &start));
        let exact = [&plain, &params].map(|params| rolled(&mut SpatialMotion::new(params, 1e-3), &start));
        // The ball of a simulation is off its place by a micrometer, and so are the directions of the loads. Differences by
        // rounding grow as the robot topples.
        for ([without, with], [motion, forces, loads]) in [(simulated, [1e-11, 1e-9, 1e-3]), (exact, [0.0, 0.0, 1e-12])]
        {
            let mut off = [0.0_f64; 4];
            let expected = preloads(&params);
            for ((a, before, energy), (b, after, same)) in without.iter().zip(&with) {
                let added = after.wheel_normal_forces - before.wheel_normal_forces - expected;
                let pulled = after.wheel_tractions - before.wheel_tractions;
                let found = [
                    apart(a, b),
                    (energy - same).abs(),
                    pulled.column().amax().max((after.floor_force - before.floor_force).amax()),
                    added.column().amax(),
                ];
                off = [0, 1, 2, 3].map(|i| off[i].max(found[i]));
            }
            close("motion", off[0], 0.0, motion);
            close("energy", off[1], 0.0, motion);
            close("tractions and force of the floor", off[2], 0.0, forces);
            close("loads", off[3], 0.0, loads);
        }
    }
}

fn wheels_that_slip_without_it_hold_with_it(simulation: Simulation) {
    let weak = Params { wheel_static_friction: 0.3, wheel_dynamic_friction: 0.3, ..Params::paper() };
    for (weights, slips) in [(0.0, true), (1.0, false)] {
        let mut robot = simulation.robot(&pressed(&weak, weights), 1e-3);
        // Three equal torques turn the ball about the mast.
        run(robot.as_mut(), [0.3; 3], 30);
        let slip = robot.contacts().wheel_slip_speeds.into_iter().fold(0.0, |most: f64, slip| most.max(slip.abs()));
        println!("{weights} weights: slip at {slip:e} m/s");
        assert_eq!(slip > 1e-3, slips, "{weights} weights: slip at {slip} m/s");
        assert!(slips || slip < 1e-6, "{weights} weights: slip at {slip} m/s");
    }
}

/// Off the wheels ball and body accelerate each other along the mast with P (1/M_k + 1/M_b), whatever their attitude.
fn it_pulls_a_ball_off_the_wheels_back_to_them(simulation: Simulation) {
    let params = pressed(&Params::paper(), 2.0);
    let mut start = lifted(&params, 5.0);
    start.body_quaternion = State::tilted(&params, Vector2::new(0.5, -0.8), 1.0).body_quaternion;
    let mast = start.body_quaternion * Vector3::z();
    start.ball_position -= mast * 0.02;
    let mut robot = simulation.robot(&params, 1e-4);
    robot.reset(&start).unwrap();
    run(robot.as_mut(), [0.0; 3], 50);
    let state = robot.state();
    let fall = Vector3::z() * (params.gravity * 5e-3);
    let [ball, body] = [state.ball_velocity, com_velocity(&params, &state)].map(|velocity| velocity + fall);
    let impulse = params.wheel_preload * 5e-3;
    println!("ball {ball}, body {body}");
    assert!((ball - mast * (impulse / params.ball_mass)).norm() < 1e-9);
    assert!((body + mast * (impulse / params.body_mass)).norm() < 1e-9);
    assert!(state.body_angular_velocity.norm() < 1e-9);
    run(robot.as_mut(), [0.0; 3], 2000);
    let gap = robot.state().body_position - robot.state().ball_position;
    assert!(gap.norm() < 1e-3, "the ball is {} m off its place", gap.norm());
}

/// Momentum and angular momentum of ball and body, of a body without symmetry whose ball is off its place.
fn it_is_an_internal_force(simulation: Simulation) {
    let params = pressed(&Params { gravity: 1e-3, ..crooked() }, 500.0);
    let mut start = lifted(&params, 5.0);
    start.ball_position += Vector3::new(0.02, -0.01, -0.04);
    let mut robot = simulation.robot(&params, 1e-4);
    robot.reset(&start).unwrap();
    run(robot.as_mut(), [0.0; 3], 500);
    let state = robot.state();
    let (ball, body) = (state.ball_velocity * params.ball_mass, com_velocity(&params, &state) * params.body_mass);
    let spins = state.wheel_speeds.column() - params.drive_matrix() * state.body_angular_velocity;
    let own = params.body_inertia_matrix() * state.body_angular_velocity
        - params.drive_matrix().transpose() * spins * params.wheel_inertia;
    let turning = state.body_quaternion * own;
    let com = state.body_position + state.body_quaternion * params.body_com();
    let total = ball + body;
    let fall = Vector3::z() * (-(params.ball_mass + params.body_mass) * params.gravity * 0.05);
    println!("{ball} {body} {turning}");
    assert!(ball.norm() > 1e-4 && turning.norm() > 1e-6, "{ball} {turning}");
    // The turning of a step is of first order in `rigid`.
    assert!((total - fall).norm() < 1e-8 * ball.norm() + 1e-12, "{total}");
    let shares =
        (com - state.ball_position).cross(&(body - total * (params.body_mass / (params.ball_mass + params.body_mass))));
    assert!((turning + shares).norm() < 1e-6 * turning.norm(), "{turning} and {shares}");
}

/// A robot that has lost its ball is not pulled to it from afar.
fn it_ends_where_the_ball_is_lost(simulation: Simulation) {
    let params = pressed(&Params::paper(), 1.0);
    let mut start = State::upright(&params);
    start.body_position.z += 200.0;
    let mut robot = simulation.robot(&params, 1e-3);
    robot.reset(&start).unwrap();
    run(robot.as_mut(), [0.0; 3], 100);
    let fall = params.gravity * 0.1;
    close("falls alone", robot.state().body_velocity.z, -fall, 1e-9);
    close("load of the floor", robot.contacts().floor_force.z, params.ball_mass * params.gravity, 1e-6);
}

fn it_may_change_in_motion(simulation: Simulation) {
    let params = Params::paper();
    let mut robot = simulation.robot(&params, 1e-3);
    run(robot.as_mut(), SMALL, 50);
    let before = robot.state();
    robot.set_params(&pressed(&params, 1.0)).unwrap();
    assert!(apart(&before, &robot.state()) < 1e-12);
    run(robot.as_mut(), SMALL, 50);
    let load = robot.contacts().wheel_normal_forces[0];
    assert!(load > 1.5 * params.static_wheel_load(), "{load}");
}

for_both!(
    at_rest_it_adds_to_the_loads_of_the_wheels_alone,
    it_moves_no_robot_that_rolls,
    wheels_that_slip_without_it_hold_with_it,
    it_pulls_a_ball_off_the_wheels_back_to_them,
    it_is_an_internal_force,
    it_ends_where_the_ball_is_lost,
    it_may_change_in_motion,
);
