//! Off the floor.

use super::{Motion, Simulation, com_velocity, for_both, lifted, run};
use crate::support::general::crooked;
use ballbot_core::kinematics::Omniwheels;
use ballbot_core::{Params, State, Wheels};
use nalgebra::Vector3;

fn lifted_robot_falls_freely_and_lands(simulation: Simulation) {
    let params = Params::paper();
    let mut robot = simulation.robot(&params, 1e-3);
    robot.reset(&lifted(&params, 0.05)).unwrap();
    run(robot.as_mut(), [0.0; 3], 50);
    // Semi-implicit integration of v' = −g: v is exact, z is g t dt / 2 ahead.
    let speed = robot.state().ball_velocity.z;
    assert!((speed + 9.81 * 0.05).abs() < 1e-9, "falls at {speed}");
    assert_eq!(robot.contacts().floor_force.norm(), 0.0);
    run(robot.as_mut(), [0.0; 3], 400);
    let contacts = robot.contacts();
    assert!((contacts.floor_force.z / 35.95 - 1.0).abs() < 0.05, "has not landed: {contacts:?}");
}

/// Angular momentum of the bot about its CoM, inertial frame.
fn angular_momentum(params: &Params, state: &State) -> Vector3<f64> {
    let wheels = Omniwheels::new(params);
    let rate = state.body_angular_velocity;
    let spins = state.wheel_speeds.column() - wheels.u * rate;
    let own = params.body_inertia_matrix() * rate;
    state.body_quaternion * (own - wheels.u.transpose() * spins * params.wheel_inertia)
}

/// Energy of its rotation; the energy of its flight is exact anyway.
fn turning_energy(params: &Params, state: &State) -> f64 {
    let wheels = Omniwheels::new(params);
    let rate = state.body_angular_velocity;
    let spins = state.wheel_speeds.column() - wheels.u * rate;
    0.5 * (rate.dot(&(params.body_inertia_matrix() * rate)) + params.wheel_inertia * spins.norm_squared())
}

/// Largest changes, relative, over a second of tumbling: of angular momentum with the attitude half a step before the rate,
/// of the same with the attitude of the rate's own step, and of energy.
fn tumbling(simulation: Simulation, params: &Params, sim_dt: f64) -> [f64; 3] {
    let mut robot = simulation.robot(params, sim_dt);
    let mut start = State::upright(params);
    start.ball_position.z = 20.0;
    start.body_position.z = 40.0;
    start.body_angular_velocity = Vector3::new(1.0, 2.0, -1.5).normalize() * 10.0;
    start.wheel_speeds = Wheels([30.0, -10.0, 5.0]);
    robot.reset(&start).unwrap();
    robot.step([0.0; 3]);
    let halfway = |before: &State, after: &State| {
        let body_quaternion = before.body_quaternion.slerp(&after.body_quaternion, 0.5);
        angular_momentum(params, &State { body_quaternion, ..after.clone() })
    };
    let mut last = robot.state();
    let (momentum, exact) = (halfway(&start, &last), angular_momentum(params, &start));
    let energy = turning_energy(params, &start);
    let thrown = com_velocity(params, &start);
    // `rigid` moves the CoM of the body without its wheels, and rotates it about the CoM of the whole with the rates of
    // half a step before.
    let wheels = Omniwheels::new(params);
    let center =
        wheels.contact_directions.iter().sum::<Vector3<f64>>() * (params.ball_radius + params.wheel_radius) / 3.0;
    let share = 3.0 * params.wheel_mass / (params.body_mass - 3.0 * params.wheel_mass);
    let root = (center - params.body_com()).norm() * share;
    let limit = simulation.pick(sim_dt * start.body_angular_velocity.norm_squared() * root, 1e-9);
    let mut worst = [0.0_f64; 3];
    while robot.time() < 1.0 {
        robot.step([0.0; 3]);
        let state = robot.state();
        let off = [
            (halfway(&last, &state) - momentum).norm() / momentum.norm(),
            (angular_momentum(params, &state) - exact).norm() / exact.norm(),
            (turning_energy(params, &state) / energy - 1.0).abs(),
        ];
        let falling = com_velocity(params, &state) - thrown + Vector3::z() * (params.gravity * robot.time());
        assert!(falling.norm() <= limit, "the CoM is pushed: {falling}");
        worst = [0, 1, 2].map(|i| worst[i].max(off[i]));
        last = state;
    }
    assert_eq!(robot.contacts().wheel_normal_forces, Wheels::default());
    assert!((last.body_angular_velocity - start.body_angular_velocity).norm() > 1.0, "does not tumble: {last:?}");
    worst
}

/// The gyroscopic term is evaluated at the middle of the step.
///
/// A step turns the body by the rate at its end (semi-implicit Euler), so the rates belong to half a step before the
/// attitude: with this, momentum is conserved to second order; read off one state, it is off by up to the rotation of
/// half a step.
fn tumbling_bot_keeps_its_angular_momentum_and_energy(simulation: Simulation) {
    // Three different moments of inertia, otherwise the tumbling would be a mere precession.
    let even = Params { body_inertia: [0.0583, 0.04, 0.0137], ..Params::paper() };
    let general = Params {
        body_com_offset: [0.03, -0.04],
        body_products_of_inertia: [4e-3, -6e-3, 3e-3],
        body_inertia: [0.0583, 0.04, 0.0237],
        ..crooked()
    };
    general.validate().expect("its principal moments are possible");
    for params in [even, general] {
        let [coarse, usual] = [2e-3, 1e-3].map(|dt| tumbling(simulation, &params, dt));
        println!("{usual:?} at 1 kHz, {coarse:?} at 500 Hz");
        let [momentum, of_one_state, energy] = usual;
        assert!(momentum <= 5e-5, "angular momentum off by {momentum:e}");
        assert!(of_one_state <= 0.5 * 10.0 * 1e-3, "angular momentum of a state off by {of_one_state:e}");
        // The midpoint rule of `rigid` is solved to rounding.
        let limit = simulation.pick(1e-10, 3e-5);
        assert!(energy <= limit, "energy off by {energy:e}");
        // Second order.
        assert!(momentum < 0.3 * coarse[0], "no convergence: {usual:?}, {coarse:?}");
        assert!(energy < (0.3 * coarse[2]).max(1e-10), "no convergence: {usual:?}, {coarse:?}");
    }
}

for_both!(lifted_robot_falls_freely_and_lands, tumbling_bot_keeps_its_angular_momentum_and_energy);
