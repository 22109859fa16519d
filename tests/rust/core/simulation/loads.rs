//! Loads of the contacts.

use super::{Motion, Simulation, for_both, lifted, run};
use ballbot_core::control::{Controller, Lqr, Setpoint};
use ballbot_core::kinematics::Omniwheels;
use ballbot_core::models::SpatialMotion;
use ballbot_core::{Model, Params, State};
use nalgebra::{Vector2, Vector3};

fn robot_at_rest_loads_wheels_and_floor_with_its_weight(simulation: Simulation) {
    let params = Params::paper();
    let mut robot = simulation.robot(&params, 1e-3);
    run(robot.as_mut(), [0.0; 3], 300);
    let (contacts, state) = (robot.contacts(), robot.state());
    let limit = 1e-6;
    let wheel = params.body_mass * params.gravity / (3.0 * params.wheel_zenith.cos());
    let floor = (params.body_mass + params.ball_mass) * params.gravity;
    assert!((wheel / 10.303_337_76 - 1.0).abs() < 1e-9 && (floor / 35.953_65 - 1.0).abs() < 1e-9);
    for load in contacts.wheel_normal_forces {
        println!("wheel load {load} N, relative error {:e}", load / wheel - 1.0);
        assert!((load / wheel - 1.0).abs() < limit, "wheel load {load}");
    }
    println!("floor: {:e}", contacts.floor_force.z / floor - 1.0);
    assert!((contacts.floor_force.z / floor - 1.0).abs() < limit, "floor load {}", contacts.floor_force.z);
    let sunk = params.ball_radius - state.ball_position.z;
    let gap = (state.body_position - state.ball_position).norm();
    println!("ball {sunk:e} into the floor, body {gap:e} off the ball");
    let deepest = 1e-6;
    assert!(sunk.abs() < deepest && gap < deepest, "ball {sunk} into the floor, body {gap} off the ball");
}

fn contact_forces_match_the_spatial_model(simulation: Simulation) {
    let params = Params::paper();
    let start = State::tilted(&params, Vector2::new(0.05, 0.02), 0.0);
    let mut exact = SpatialMotion::new(&params, 1e-3);
    let mut simulated = simulation.robot(&params, 1e-3);
    for robot in [&mut exact as &mut dyn Model, simulated.as_mut()] {
        robot.reset(&start).unwrap();
        run(robot, [0.15, -0.1, 0.05], 100);
    }
    let (found, expected) = (simulated.contacts(), exact.contacts());
    let (loads, tractions, floor) = (5e-3, 1e-3, 0.02);
    for i in 0..3 {
        let (f, e) = (found.wheel_normal_forces[i], expected.wheel_normal_forces[i]);
        println!("wheel {i}: load {:e}", f / e - 1.0);
        assert!((f / e - 1.0).abs() < loads, "load of wheel {i}: {f} N, expected {e} N");
        let (f, e) = (found.wheel_tractions[i], expected.wheel_tractions[i]);
        println!("wheel {i}: traction {:e} N", f - e);
        assert!((f - e).abs() < tractions, "traction of wheel {i}: {f} N, expected {e} N");
    }
    let off = (found.floor_force - expected.floor_force).norm();
    println!("floor {off:e} N");
    assert!(off < floor, "floor force {}, expected {}", found.floor_force, expected.floor_force);
}

fn wheels_pass_force_along_the_drive_direction_only(simulation: Simulation) {
    let params = Params::paper();
    let mut robot = simulation.robot(&params, 1e-3);
    let mut lqr = Lqr::new(&params, 0.001).unwrap();
    robot.reset(&State::tilted(&params, Vector2::new(0.05, 0.03), 0.7)).unwrap();
    let wheels = Omniwheels::new(&params);
    let mut worst = 0.0_f64;
    for step in 0..300 {
        let before = robot.state();
        let torques = lqr.wheel_torques(&before, &Setpoint::default());
        robot.step(torques);
        let (after, contacts) = (robot.state(), robot.contacts());
        let momentum = (after.ball_velocity - before.ball_velocity) * params.ball_mass / robot.sim_dt();
        let mut unexplained = momentum - contacts.floor_force + Vector3::z() * params.ball_mass * params.gravity;
        for i in 0..3 {
            let (normal, drive) = (wheels.contact_directions[i], wheels.drive_directions[i]);
            let force = drive * contacts.wheel_tractions[i] - normal * contacts.wheel_normal_forces[i];
            unexplained -= before.body_quaternion * force;
        }
        let share = unexplained.norm() / (params.wheel_dynamic_friction * contacts.wheel_normal_forces[0]);
        // The first steps of `contact` settle its contacts.
        if step >= simulation.pick(0, 5) {
            worst = worst.max(share);
        }
    }
    println!("unexplained: {worst:e} of the friction limit");
    assert!(worst <= 3e-5, "{worst:e} of the friction limit is unexplained");
}

fn wheels_push_the_ball_but_neither_pull_nor_sink_into_it(simulation: Simulation) {
    let params = Params::paper();
    let blows = [Vector3::zeros(), Vector3::new(1.0, 0.0, -2.0), Vector3::new(0.0, 0.3, 0.6), Vector3::zeros()];
    for (height, blow) in [0.0, 0.0, 0.0, 0.05].into_iter().zip(blows) {
        let mut robot = simulation.robot(&params, 1e-3);
        robot.reset(&lifted(&params, height)).unwrap();
        let mut deepest = 0.0_f64;
        for step in 0..300 {
            if step == 50 {
                robot.push(&blow, &Vector3::new(0.0, 0.0, 0.3));
            }
            robot.step([0.05, -0.02, 0.01]);
            let (state, contacts) = (robot.state(), robot.contacts());
            for load in contacts.wheel_normal_forces {
                assert!(load >= -1e-9, "{blow}: a wheel pulls with {load} N in step {step}");
            }
            let up = state.body_quaternion.inverse_transform_vector(&(state.body_position - state.ball_position));
            deepest = deepest.max(-up.z);
            assert!(up.z >= -1e-4, "{blow}: the body is {} m into the ball in step {step}", -up.z);
        }
        println!("{blow:?}: {deepest:e} m into the ball");
    }
}

for_both!(
    robot_at_rest_loads_wheels_and_floor_with_its_weight,
    contact_forces_match_the_spatial_model,
    wheels_pass_force_along_the_drive_direction_only,
    wheels_push_the_ball_but_neither_pull_nor_sink_into_it,
);
