//! Coulomb's limit at floor and wheels.

use super::{Motion, Simulation, for_both, run};
use ballbot_core::kinematics::{Omniwheels, TorqueMap};
use ballbot_core::models::SpatialModel;
use ballbot_core::{Params, State, Wheels};
use nalgebra::{UnitQuaternion, Vector2, Vector3, Vector6};

/// Friction of the wheels does not interfere when the floor's friction is measured.
fn sticky_wheels(floor: f64) -> Params {
    Params {
        wheel_static_friction: 50.0,
        wheel_dynamic_friction: 50.0,
        floor_static_friction: floor,
        floor_dynamic_friction: floor,
        ..Params::paper()
    }
}

/// Horizontal over vertical floor force while virtual torques about a horizontal axis make the ball slip.
fn floor_friction_is_isotropic(simulation: Simulation) {
    let params = sticky_wheels(0.05);
    let wheels = Omniwheels::new(&params);
    let mut worst = 0.0_f64;
    for degrees in (0..360).step_by(15) {
        let direction = f64::from(degrees).to_radians();
        let torque = Vector3::new(direction.cos(), direction.sin(), 0.0) * 1.0;
        let torques = wheels.wheel_torques(&torque, TorqueMap::Consistent).0;
        let mut robot = simulation.robot(&params, 1e-3);
        run(robot.as_mut(), torques, 40);
        let contacts = robot.contacts();
        assert!(contacts.floor_slip_velocity.norm() > 0.01, "does not slip at {degrees} deg: {contacts:?}");
        let friction = contacts.floor_force.xy().norm() / contacts.floor_force.z;
        let error = (friction / 0.05 - 1.0).abs();
        worst = worst.max(error);
        let along = contacts.floor_force.xy().normalize().dot(&-contacts.floor_slip_velocity.normalize());
        assert!(along > 0.999, "{degrees} deg: friction is not opposite to slip ({along})");
    }
    println!("friction coefficient, worst relative error over 24 directions: {worst:e}");
    assert!(worst < 1e-9, "friction coefficient off by {worst:e}");
}

/// The smallest torque at which wheel 0 slips, found from the loads of the spatial model, against the simulation.
fn wheels_slip_at_the_coulomb_limit_whatever_the_yaw(simulation: Simulation) {
    let params = Params { wheel_static_friction: 0.3, wheel_dynamic_friction: 0.3, ..Params::paper() };
    // All wheels driven alike turn the ball under the body and keep every load at M_b g / (3 cos α): the wheel and the
    // part of the ball and the body that it has to turn leave the contact f = τ c, with c from the spatial model.
    let probe = SpatialModel::new(&params, true, true);
    let upright = UnitQuaternion::identity();
    let per_torque =
        probe.contacts(&upright, &Vector6::zeros(), Wheels::of_column(Vector3::repeat(1.0))).wheel_tractions[0];
    let limit = 0.3 * params.static_wheel_load() / per_torque;
    for yaw in [0.0, 0.4, 1.1, 2.5, -2.0] {
        let slips = |torque: f64| {
            let mut robot = simulation.robot(&params, 1e-3);
            robot.reset(&State::tilted(&params, Vector2::zeros(), yaw)).unwrap();
            run(robot.as_mut(), [torque; 3], 30);
            robot.contacts().wheel_slip_speeds[0].abs() > 1e-3
        };
        assert!(!slips(0.995 * limit), "yaw {yaw}: slips below {limit} N·m");
        assert!(slips(1.005 * limit), "yaw {yaw}: sticks above {limit} N·m");
    }
}

fn slipping_wheel_spins_up_at_the_closed_form_rate(simulation: Simulation) {
    let params = Params { wheel_static_friction: 0.5, wheel_dynamic_friction: 0.5, ..Params::paper() };
    let wheels = Omniwheels::new(&params);
    let mut robot = simulation.robot(&params, 1e-3);
    let torque = 0.6;
    let spin = |state: &State| state.wheel_speeds[0] - (wheels.u * state.body_angular_velocity)[0];
    let (mut before, mut friction) = (0.0, 0.0);
    for step in 0..40 {
        if step == 20 {
            before = spin(&robot.state());
        }
        robot.step([torque; 3]);
        let load = robot.contacts().wheel_normal_forces[0];
        if step >= 20 {
            friction += params.wheel_dynamic_friction * load / 20.0;
            assert!(robot.contacts().wheel_slip_speeds[0] > 0.0);
        }
    }
    let found = (spin(&robot.state()) - before) / 0.02;
    let expected = (torque - friction * params.wheel_radius) / params.wheel_inertia;
    println!("spins up {:e} too fast", found / expected - 1.0);
    assert!((found / expected - 1.0).abs() < 1e-8, "spins up at {found} rad/s², expected {expected}");
}

fn static_friction_holds_beyond_dynamic_friction(simulation: Simulation) {
    let params = Params { wheel_static_friction: 0.6, wheel_dynamic_friction: 0.3, ..Params::paper() };
    let slip = |torque: f64, kick: f64| {
        let mut robot = simulation.robot(&params, 1e-3);
        let mut state = State::upright(&params);
        state.wheel_speeds = Wheels([kick; 3]);
        robot.reset(&state).unwrap();
        run(robot.as_mut(), [torque; 3], 60);
        robot.contacts().wheel_slip_speeds[0].abs()
    };
    // 0.45 of the load is between the two coefficients.
    let torque = 0.45 * params.static_wheel_load() * params.wheel_radius;
    assert!(slip(torque, 0.0) < 1e-3, "breaks loose from rest");
    assert!(slip(torque, 10.0) > 0.1, "a slipping wheel is caught");
}

/// Friction bounded only by the load of the previous step would make the loads oscillate more at every step.
fn wheels_that_slip_keep_their_loads(simulation: Simulation) {
    let params = Params::paper();
    for sim_dt in [2e-3, 1e-3] {
        let mut robot = simulation.robot(&params, sim_dt);
        run(robot.as_mut(), [0.0; 3], 20);
        run(robot.as_mut(), [1.0; 3], 60);
        let contacts = robot.contacts();
        for (load, slip) in contacts.wheel_normal_forces.into_iter().zip(contacts.wheel_slip_speeds) {
            assert!(slip > 5.0, "the wheels do not slip: {contacts:?}");
            let error = load / params.static_wheel_load() - 1.0;
            assert!(error.abs() < 5e-3, "at {sim_dt} s: {load} N, off by {error:e}");
        }
    }
}

for_both!(
    floor_friction_is_isotropic,
    wheels_slip_at_the_coulomb_limit_whatever_the_yaw,
    slipping_wheel_spins_up_at_the_closed_form_rate,
    static_friction_holds_beyond_dynamic_friction,
    wheels_that_slip_keep_their_loads,
);
