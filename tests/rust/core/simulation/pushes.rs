//! Impulses on the body.

use super::{Motion, Simulation, com_velocity, for_both, run};
use ballbot_core::kinematics::Omniwheels;
use ballbot_core::models::SpatialMotion;
use ballbot_core::{Model, Params, State};
use nalgebra::{Vector2, Vector3};

fn pushes_change_the_momentum_by_their_impulse(simulation: Simulation) {
    let params = Params::paper();
    let mut robot = simulation.robot(&params, 1e-3);
    let mut state = State::tilted(&params, Vector2::new(0.4, -0.7), 1.1);
    let attitude = state.body_quaternion;
    // In the air, clear of the ball, so that nothing else acts.
    state.ball_position.z = 1.0;
    state.body_position.z = 2.0;
    robot.reset(&state).unwrap();
    let impulse = Vector3::new(0.2, -0.1, 0.05);
    let point = Vector3::new(0.03, 0.0, 0.3);
    robot.push(&impulse, &point);
    robot.step([0.0; 3]);
    let state = robot.state();
    let com = Vector3::z() * params.body_com_height;
    let velocity = com_velocity(&params, &state);
    let momentum = velocity * params.body_mass + Vector3::z() * params.body_mass * 9.81e-3;
    println!("momentum {:e}", (momentum - impulse).norm() / impulse.norm());
    let limit = simulation.pick(1e-4, 1e-12);
    assert!((momentum - impulse).norm() < limit * impulse.norm(), "{momentum}");
    // The wheels turn freely on their axles, which takes part of the angular impulse.
    let wheels = Omniwheels::new(&params);
    let spin = state.wheel_speeds.column() - wheels.u * state.body_angular_velocity;
    let angular = Vector3::from(params.body_inertia).component_mul(&state.body_angular_velocity)
        - wheels.u.transpose() * spin * params.wheel_inertia;
    let expected = (point - com).cross(&attitude.inverse_transform_vector(&impulse));
    println!("angular {:e}", (angular - expected).norm() / expected.norm());
    assert!((angular - expected).norm() < 1e-12 * expected.norm(), "{angular}, expected {expected}");
}

/// Body rate 10 ms after an impulse on the CoM of a robot that has been at rest for half a second.
fn rate_after_push(robot: &mut dyn Model, impulse: &Vector3<f64>) -> Vector3<f64> {
    let com = Vector3::z() * robot.params().body_com_height;
    run(robot, [0.0; 3], 500);
    robot.push(impulse, &com);
    run(robot, [0.0; 3], 10);
    robot.state().body_angular_velocity
}

fn rotation_after_a_push_matches_the_spatial_model(simulation: Simulation) {
    for impulse in [Vector3::new(0.02, 0.0, 0.0), Vector3::new(0.0, 0.02, 0.0)] {
        let expected = rate_after_push(&mut SpatialMotion::new(&Params::paper(), 1e-3), &impulse);
        let found = rate_after_push(simulation.paper().as_mut(), &impulse);
        let error = (found - expected).norm() / expected.norm();
        println!("{impulse:?}: {error:e}");
        assert!(error <= simulation.pick(3e-3, 1e-3), "{found}, expected {expected}: {error:e}");
    }
}

fn zero_pushes_change_nothing(simulation: Simulation) {
    let after = |pushed: bool| {
        let mut robot = simulation.paper();
        run(robot.as_mut(), [0.02, -0.01, 0.0], 100);
        if pushed {
            robot.push(&Vector3::zeros(), &Vector3::new(0.1, 0.2, 0.3));
        }
        run(robot.as_mut(), [0.02, -0.01, 0.0], 100);
        robot.save()
    };
    assert!(after(true) == after(false));
}

for_both!(
    pushes_change_the_momentum_by_their_impulse,
    rotation_after_a_push_matches_the_spatial_model,
    zero_pushes_change_nothing,
);
