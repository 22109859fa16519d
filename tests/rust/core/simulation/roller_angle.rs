//! Wheels with inclined rollers: against closed forms, against the model without slip, and seen in a mirror.

use super::general::{about_equilibrium, any_gripping_robot, apart, mirror_image, mirrored, off_spatial, sampled};
use super::losses::rolled;
use super::{Motion, Simulation, close, com_velocity, for_both, lifted, run};
use crate::support::general::{crooked, inclined};
use crate::support::{any_start, largest, natural_rate, torques, vector};
use ballbot_core::kinematics::{Omniwheels, TorqueMap};
use ballbot_core::models::{SpatialMotion, traction_torque};
use ballbot_core::{Model, Params, State, Wheels};
use nalgebra::{Vector2, Vector3};
use std::f64::consts::{FRAC_PI_4, TAU};

const ANGLES: [f64; 3] = [0.3, FRAC_PI_4, -FRAC_PI_4];

/// A robot whose wheels do not slip.
fn gripping(params: &Params, roller_angle: f64) -> Params {
    let params = Params {
        roller_angle,
        wheel_static_friction: 50.0,
        wheel_dynamic_friction: 50.0,
        floor_static_friction: 50.0,
        floor_dynamic_friction: 50.0,
        ..params.clone()
    };
    params.validate().unwrap();
    params
}

/// Places and velocities to first order in the time step, and loads, of robots with symmetry and without.
fn rollers_at_any_angle_converge_to_the_spatial_model(simulation: Simulation) {
    for robot in [Params::paper(), crooked()] {
        for angle in ANGLES {
            let params = gripping(&robot, angle);
            let start = State::rolling(
                &params,
                Vector2::new(0.15, -0.1),
                0.5,
                State::tilted_from_equilibrium(&params, Vector2::new(0.03, -0.02), 0.4).body_quaternion,
                Vector3::new(0.2, -0.1, 0.3),
            );
            let off = |steps| off_spatial(simulation, &params, &start, &[0.05, -0.03, 0.04], steps).unwrap();
            let (coarse, fine, finest) = (off(100), off(200), off(2000));
            println!("{angle}: {coarse:?}, {fine:?}, {finest:?}");
            for what in 0..2 {
                assert!(fine[what] <= 0.6 * coarse[what] + 1e-6, "{angle}: {coarse:?} becomes {fine:?}");
            }
            assert!(finest[0] <= 5e-4 && finest[1] <= 2e-3 && finest[2] <= 1e-3, "{angle}: {finest:?}");
        }
    }
}

fn any_robots_converge_to_the_spatial_model(simulation: Simulation) {
    let motions = (inclined(any_gripping_robot()), any_start(0.05, 0.1), vector(0.1));
    let mut compared = 0;
    for (i, (params, start, shares)) in sampled(&motions, 20).into_iter().enumerate() {
        let (start, motors) = (about_equilibrium(&params, &start), torques(&params, &shares));
        let run = |steps| off_spatial(simulation, &params, &start, &motors, steps);
        let Some((coarse, fine)) = run(200).zip(run(400)) else { continue };
        compared += 1;
        for what in 0..2 {
            let (coarse, fine) = (coarse[what], fine[what]);
            assert!(fine <= 0.6 * coarse + 1e-6, "robot {i}: off by {coarse:e}, in half the step by {fine:e}");
        }
    }
    assert!(compared >= 12, "only {compared} robots keep their wheels on the ball");
}

/// With friction of the rollers, whose direction the wheels' spin moves along.
fn roller_friction_matches_the_spatial_model(simulation: Simulation) {
    for angle in ANGLES {
        let free = Params { roller_angle: angle, ..Params::paper() };
        let params = Params { roller_friction: 0.03, roller_friction_slope: 0.05, ..free.clone() };
        let without = rolled(&mut SpatialMotion::new(&free, 1e-3), &free);
        let exact = rolled(&mut SpatialMotion::new(&params, 1e-3), &params);
        let found = rolled(simulation.paper().as_mut(), &params);
        let off = |state: &State| {
            let of_ball = (state.ball_velocity - exact.ball_velocity).norm();
            let of_wheels = (state.wheel_speeds.column() - exact.wheel_speeds.column()).norm();
            of_ball + of_wheels * params.wheel_radius
        };
        println!("{angle}: {:e} m/s off, friction makes {:e}", off(&found), off(&without));
        assert!(off(&without) > 0.02, "{angle}: the friction makes {} m/s", off(&without));
        assert!(off(&found) <= 0.03 * off(&without), "{angle}: {} m/s off", off(&found));
    }
}

/// The motors' power is the change of the energy; without torque it is constant.
fn energy_changes_by_the_work_of_the_motors(simulation: Simulation) {
    for angle in ANGLES {
        let params = gripping(&crooked(), angle);
        let start = State::tilted_from_equilibrium(&params, Vector2::new(0.02, 0.03), 0.7);
        for motors in [[0.0; 3], [0.1, -0.08, 0.06]] {
            let mut exact = SpatialMotion::new(&params, 1e-4);
            let mut found = simulation.robot(&params, 1e-4);
            let mut off = [0.0_f64; 2];
            for (robot, off) in [&mut exact as &mut dyn Model, found.as_mut()].into_iter().zip(&mut off) {
                robot.reset(&start).unwrap();
                let before = robot.energy();
                let mut work = 0.0;
                for _ in 0..3000 {
                    let turned = robot.state().wheel_angles;
                    robot.step(motors);
                    work += Wheels(motors).dot(robot.state().wheel_angles - turned);
                    *off = off.max((robot.energy() - before - work).abs());
                }
            }
            let scale = params.body_mass * params.gravity * params.body_com_height;
            println!("{angle}: {off:?} of {scale}");
            // `contact` and `rigid` have positions half a step off their velocities.
            assert!(off[0] <= 1e-9 * scale && off[1] <= 1e-3 * scale, "{angle}: {off:?} J of {scale} J");
        }
    }
}

/// A weightless robot in the air, its ball held by a preload: motors change neither its momentum nor its angular momentum.
fn tractions_are_internal_forces(simulation: Simulation) {
    for angle in ANGLES {
        let params = Params { wheel_preload: 2.0, gravity: 1e-3, ..gripping(&crooked(), angle) };
        let mut robot = simulation.robot(&params, 1e-4);
        robot.reset(&lifted(&params, 5.0)).unwrap();
        run(robot.as_mut(), [0.01, -0.007, 0.012], 500);
        let state = robot.state();
        let wheels = Omniwheels::new(&params);
        let spins = state.wheel_speeds.column() - wheels.axles * state.body_angular_velocity;
        let own = params.body_inertia_matrix() * state.body_angular_velocity
            - wheels.axles.transpose() * spins * params.wheel_inertia;
        let of_ball = state.ball_angular_velocity * params.ball_inertia;
        let (ball, body) = (state.ball_velocity * params.ball_mass, com_velocity(&params, &state) * params.body_mass);
        let com = state.body_position + state.body_quaternion * params.body_com();
        let mass = params.ball_mass + params.body_mass;
        let orbit = (com - state.ball_position).cross(&(body - (ball + body) * (params.body_mass / mass)));
        let fall = Vector3::z() * (-mass * params.gravity * 0.05);
        let size = of_ball.norm();
        let (momentum, turning) = (ball + body - fall, of_ball + state.body_quaternion * own + orbit);
        println!("{angle}: {momentum} and {turning}, the ball has {size}");
        assert!(size > 1e-4, "the ball hardly turns: {size}");
        // The sum of positions of `rigid` is of first order in the time step.
        assert!(momentum.norm() * params.ball_radius < 1e-5 * size, "{momentum}");
        assert!(turning.norm() < simulation.pick(2e-3, 1e-4) * size, "{turning}, of {size}");
    }
}

/// Behind a mirror the rollers are inclined the other way.
fn a_mirror_reverses_the_angle(simulation: Simulation) {
    let motions = (inclined(any_gripping_robot()), any_start(0.05, 0.1), vector(0.1));
    let mut worst = 0.0_f64;
    for (params, start, shares) in sampled(&motions, 20) {
        let (start, motors) = (about_equilibrium(&params, &start), torques(&params, &shares));
        let dt = 0.005 / natural_rate(&params);
        let mut one = simulation.robot(&params, dt);
        let mut image = simulation.robot(&mirror_image(&params), dt);
        one.reset(&start).unwrap();
        image.reset(&mirrored(&start)).unwrap();
        for _ in 0..200 {
            one.step(motors);
            image.step(motors.map(|torque| -torque));
        }
        worst = worst.max(largest(apart(&params, &mirrored(&one.state()), &image.state())));
    }
    assert!(worst <= 1e-10, "{worst:e} apart");
}

/// Three equal torques turn ball and body against each other as without an angle, with tractions larger by 1 / cos γ. Their
/// vertical parts press the wheels on the ball: N cos α = M_b g / 3 + f sin γ sin α. The floor does not feel it.
fn equal_torques_turn_the_robot_and_load_its_wheels(simulation: Simulation) {
    let torque = 0.1;
    let straight = gripping(&Params::paper(), 0.0);
    let mut reference = SpatialMotion::new(&straight, 1e-4);
    run(&mut reference, [torque; 3], 100);
    let expected = reference.state();
    for angle in ANGLES {
        let params = gripping(&straight, angle);
        let mut simulated = simulation.robot(&params, 1e-4);
        let mut exact = SpatialMotion::new(&params, 1e-4);
        for (robot, limit) in [(simulated.as_mut(), 1e-5), (&mut exact as &mut dyn Model, 1e-12)] {
            run(robot, [torque; 3], 100);
            let (state, contacts) = (robot.state(), robot.contacts());
            let rate = expected.body_angular_velocity.z;
            close("yaw rate", state.body_angular_velocity.z, rate, limit * rate.abs());
            let spin = expected.ball_angular_velocity.z;
            close("spin of the ball", state.ball_angular_velocity.z, spin, limit * spin.abs());
            assert!(state.tilt() < 1e-9, "{angle}: tilts by {}", state.tilt());
            let traction = reference.contacts().wheel_tractions[0] / angle.cos();
            let (sin, cos) = params.wheel_zenith.sin_cos();
            let load = (params.body_mass * params.gravity / 3.0 + traction * angle.sin() * sin) / cos;
            for i in 0..3 {
                close("traction", contacts.wheel_tractions[i], traction, limit * traction);
                close("load", contacts.wheel_normal_forces[i], load, limit * load);
            }
            let weight = (params.body_mass + params.ball_mass) * params.gravity;
            close("load of the floor", contacts.floor_force.z, weight, limit * weight);
        }
    }
}

/// Wheels grip just below the torque of `traction_torque` and slip just above it, in the direction in which they slip first.
fn wheels_slip_where_the_closed_form_predicts(simulation: Simulation) {
    for angle in [0.0, 0.3, FRAC_PI_4, -FRAC_PI_4] {
        // Little friction, so that the robot does not fall before its wheels slip; the same for all speeds.
        let params = Params {
            roller_angle: angle,
            wheel_static_friction: 0.2,
            wheel_dynamic_friction: 0.2,
            floor_static_friction: 50.0,
            floor_dynamic_friction: 50.0,
            max_wheel_torque: 1e3,
            ..Params::paper()
        };
        let torque = traction_torque(&params);
        let wheels = Omniwheels::new(&params);
        let slips = |share: f64| {
            (0..120).any(|k| {
                let about = TAU * f64::from(k) / 120.0;
                let axis = Vector3::new(about.cos(), about.sin(), 0.0);
                let torques = wheels.torques_on_body(&axis, TorqueMap::Consistent);
                let torques = torques * (share * torque / torques.column().amax());
                let mut robot = simulation.robot(&params, 1e-4);
                run(robot.as_mut(), torques, 20);
                robot.contacts().wheel_slip_speeds.into_iter().any(|slip| slip.abs() > 1e-5)
            })
        };
        println!("{angle}: {torque} N·m");
        assert!(!slips(0.97), "{angle}: a wheel slips below {torque} N·m");
        assert!(slips(1.03), "{angle}: no wheel slips above {torque} N·m");
    }
}

/// Held still on a slope, the tractions are the torques over the lever arm r_w cos γ.
#[test]
fn tractions_at_rest_are_the_torques_over_the_lever_arm() {
    for angle in ANGLES {
        let params = Params { floor_tilt: [0.05, -0.03], ..gripping(&crooked(), angle) };
        let mut robot = SpatialMotion::new(&params, 1e-3);
        robot.reset(&State::tilted_from_equilibrium(&params, params.slope_lean().unwrap(), 0.3)).unwrap();
        let torques = params.holding_torques(0.3).unwrap();
        robot.step(torques);
        let tractions = robot.contacts().wheel_tractions;
        for (torque, traction) in torques.into_iter().zip(tractions) {
            close("traction", traction, torque / (params.wheel_radius * angle.cos()), 1e-9);
        }
    }
}

for_both!(
    rollers_at_any_angle_converge_to_the_spatial_model,
    any_robots_converge_to_the_spatial_model,
    roller_friction_matches_the_spatial_model,
    energy_changes_by_the_work_of_the_motors,
    tractions_are_internal_forces,
    a_mirror_reverses_the_angle,
    equal_torques_turn_the_robot_and_load_its_wheels,
    wheels_slip_where_the_closed_form_predicts,
);
