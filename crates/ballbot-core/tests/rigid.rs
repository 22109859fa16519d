//! The rigid-body model against closed forms: growth of a small tilt, rolling, loads, friction limits.

use ballbot_core::control::{Controller, Lqr, Setpoint};
use ballbot_core::kinematics::{Omniwheels, TorqueMap};
use ballbot_core::models::{SpatialModel, SpatialMotion};
use ballbot_core::sim::RigidMotion;
use ballbot_core::{JointDynamics, Model, Params, State, attitude};
use nalgebra::{UnitQuaternion, Vector2, Vector3, Vector6};

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
        println!("wheel load {load} N, relative error {:e}", load / 10.303_337_76 - 1.0);
        assert!((load / 10.303_337_76 - 1.0).abs() < 1e-3, "wheel load {load}");
    }
    assert!((contacts.floor_force.z / 35.953_65 - 1.0).abs() < 1e-3, "floor load {}", contacts.floor_force.z);
    let sunk = params.ball_radius - state.ball_position.z;
    let gap = (state.body_position - state.ball_position).norm();
    assert!(sunk.abs() < 1e-4 && gap < 1e-4, "ball {sunk} into the floor, body {gap} off the ball");
}

/// States every 10 ms of two seconds under the regulator, from a tilted start with a heading error.
fn regulated_run(robot: &mut dyn Model) -> Vec<State> {
    let params = robot.params().clone();
    robot.reset(&State::tilted(&params, Vector2::new(0.03, -0.04), 0.3)).unwrap();
    let mut lqr = Lqr::new(&params, 0.01).unwrap();
    let substeps = (0.01 / robot.sim_dt()).round() as usize;
    let run = |_| {
        let torques = lqr.wheel_torques(&robot.state(), &Setpoint::default());
        for _ in 0..substeps {
            robot.step(&torques);
        }
        robot.state()
    };
    (0..200).map(run).collect()
}

/// States every 10 ms of half a second under torques that topple and turn the robot: longer, and the instability
/// (e^{6.09 t}) would show the solver's rounding instead of its physics.
fn toppling_run(robot: &mut dyn Model) -> Vec<State> {
    let substeps = (0.01 / robot.sim_dt()).round() as usize;
    let run = |_| {
        for _ in 0..substeps {
            robot.step(&[0.02, 0.005, 0.01]);
        }
        robot.state()
    };
    (0..50).map(run).collect()
}

/// Largest distance of the balls (m) and angle between the bodies (rad) over two runs.
fn apart(a: &[State], b: &[State]) -> (f64, f64) {
    let distance = |(f, e): (&State, &State)| (f.ball_position - e.ball_position).xy().norm();
    let angle = |(f, e): (&State, &State)| f.body_quaternion.angle_to(&e.body_quaternion);
    (a.iter().zip(b).map(distance).fold(0.0, f64::max), a.iter().zip(b).map(angle).fold(0.0, f64::max))
}

#[test]
fn motion_without_slip_is_that_of_the_spatial_model_and_converges_to_it() {
    let params = Params::paper();
    for run in [regulated_run, toppling_run] {
        let exact = run(&mut SpatialMotion::new(&params, 1e-4));
        let errors = [2e-3, 1e-3, 5e-4].map(|dt| apart(&run(&mut RigidMotion::new(&params, dt).unwrap()), &exact));
        println!("{errors:?}");
        let (distance, angle) = errors[1];
        assert!(distance <= 1e-3 && angle <= 0.1_f64.to_radians(), "at 1 kHz: {distance} m, {angle} rad apart");
        assert!(errors[2].0 < 0.7 * errors[0].0, "no convergence in position: {errors:?}");
        assert!(errors[2].1 < 0.7 * errors[0].1, "no convergence in attitude: {errors:?}");
    }
}

#[test]
fn contact_forces_are_those_of_the_spatial_model() {
    let params = Params::paper();
    let start = State::tilted(&params, Vector2::new(0.05, 0.02), 0.0);
    let torques = [0.15, -0.1, 0.05];
    let mut exact = SpatialMotion::new(&params, 1e-3);
    let mut rigid = RigidMotion::new(&params, 1e-3).unwrap();
    for robot in [&mut exact as &mut dyn Model, &mut rigid] {
        robot.reset(&start).unwrap();
        for _ in 0..100 {
            robot.step(&torques);
        }
    }
    let (found, expected) = (rigid.contacts(), exact.contacts());
    for i in 0..3 {
        let (f, e) = (found.wheel_normal_forces[i], expected.wheel_normal_forces[i]);
        assert!((f / e - 1.0).abs() < 5e-3, "load of wheel {i}: {f} N, expected {e} N");
        let (f, e) = (found.wheel_tractions[i], expected.wheel_tractions[i]);
        assert!((f - e).abs() < 0.02, "traction of wheel {i}: {f} N, expected {e} N");
    }
    let off = (found.floor_force - expected.floor_force).norm();
    assert!(off < 0.05, "floor force {}, expected {}", found.floor_force, expected.floor_force);
}

#[test]
fn wheels_turn_with_the_ball_and_the_ball_rolls_without_drift() {
    let params = Params::paper();
    let mut robot = RigidMotion::new(&params, 1e-3).unwrap();
    let mut lqr = Lqr::new(&params, 0.01).unwrap();
    let wheels = Omniwheels::new(&params);
    let (mut worst_slip, mut fastest, mut rolled, mut deepest) = (0.0_f64, 0.0_f64, Vector2::zeros(), 0.0_f64);
    for k in 0..400 {
        // A metre along a slanted line in two seconds, then standing.
        let share = (f64::from(k) / 200.0).min(1.0);
        let position = Vector2::new(0.8, 0.6) * share * share * (3.0 - 2.0 * share);
        let torques = lqr.wheel_torques(&robot.state(), &Setpoint { position, ..Setpoint::default() });
        for _ in 0..10 {
            robot.step(&torques);
            let state = robot.state();
            let ideal =
                wheels.wheel_speeds(&state.body_quaternion, &state.ball_angular_velocity, &state.body_angular_velocity);
            worst_slip = worst_slip.max((Vector3::from(state.wheel_speeds) - ideal).amax());
            fastest = fastest.max(ideal.amax());
            let rate = state.ball_angular_velocity;
            rolled += Vector2::new(rate.y, -rate.x) * params.ball_radius * robot.sim_dt();
            deepest = deepest.max((params.ball_radius - state.ball_position.z).abs());
            deepest = deepest.max((state.body_position - state.ball_position).norm());
        }
    }
    let position = robot.state().ball_position.xy();
    println!("slip {worst_slip:e} of {fastest}, rolled {rolled}, at {position}, penetration {deepest:e}");
    assert!((position - Vector2::new(0.8, 0.6)).norm() < 0.02, "did not get there: {position}");
    assert!(worst_slip <= 1e-3 * fastest, "wheel speeds off by {worst_slip} rad/s of {fastest}");
    assert!((rolled - position).norm() <= 1e-3, "rolled {rolled}, moved {position}");
    assert!(deepest <= 1e-4, "penetration {deepest} m");
}

#[test]
fn wheels_pass_force_along_the_drive_direction_only() {
    let params = Params::paper();
    let mut robot = RigidMotion::new(&params, 1e-3).unwrap();
    let mut lqr = Lqr::new(&params, 0.001).unwrap();
    robot.reset(&State::tilted(&params, Vector2::new(0.05, 0.03), 0.7)).unwrap();
    let wheels = Omniwheels::new(&params);
    for step in 0..300 {
        let before = robot.state();
        let torques = lqr.wheel_torques(&before, &Setpoint::default());
        robot.step(&torques);
        let (after, contacts) = (robot.state(), robot.contacts());
        let momentum = (after.ball_velocity - before.ball_velocity) * params.ball_mass / robot.sim_dt();
        let mut unexplained = momentum - contacts.floor_force + Vector3::z() * params.ball_mass * params.gravity;
        for i in 0..3 {
            let (normal, drive) = (wheels.contact_directions[i], wheels.drive_directions[i]);
            let force = drive * contacts.wheel_tractions[i] - normal * contacts.wheel_normal_forces[i];
            unexplained -= before.body_quaternion * force;
        }
        // The first steps settle the contacts, whose forces change within a step.
        let limit = 1e-3 * params.wheel_dynamic_friction * contacts.wheel_normal_forces[0];
        assert!(step < 5 || unexplained.norm() <= limit, "step {step}: {unexplained} N unexplained, limit {limit} N");
    }
}

/// Friction of the wheels is out of the way when the floor's is measured.
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
#[test]
fn floor_friction_is_the_same_in_all_directions() {
    let params = sticky_wheels(0.05);
    let wheels = Omniwheels::new(&params);
    let mut worst = 0.0_f64;
    for degrees in (0..360).step_by(15) {
        let direction = f64::from(degrees).to_radians();
        let torque = Vector3::new(direction.cos(), direction.sin(), 0.0) * 1.0;
        let torques = wheels.wheel_torques(&torque, TorqueMap::Consistent).into();
        let mut robot = RigidMotion::new(&params, 1e-3).unwrap();
        for _ in 0..40 {
            robot.step(&torques);
        }
        let contacts = robot.contacts();
        assert!(contacts.floor_slip_velocity.norm() > 0.01, "does not slip at {degrees} deg: {contacts:?}");
        let friction = contacts.floor_force.xy().norm() / contacts.floor_force.z;
        let error = (friction / 0.05 - 1.0).abs();
        worst = worst.max(error);
        assert!(error < 5e-3, "{degrees} deg: friction coefficient {friction}");
        let along = contacts.floor_force.xy().normalize().dot(&-contacts.floor_slip_velocity.normalize());
        assert!(along > 0.999, "{degrees} deg: friction is not opposite to slip ({along})");
    }
    println!("friction coefficient, worst relative error over 24 directions: {worst:e}");
}

/// The smallest torque at which wheel 0 slips, found from the loads of the spatial model, against where it does.
#[test]
fn wheels_slip_at_the_coulomb_limit_whatever_the_yaw() {
    let params = Params { wheel_static_friction: 0.3, wheel_dynamic_friction: 0.3, ..Params::paper() };
    // All wheels driven alike turn the ball under the body and keep every load at M_b g / (3 cos α): the wheel and the
    // share of the ball and the body that it has to turn leave the contact f = τ c, with c from the spatial model.
    let probe = SpatialModel::new(&params, true, true);
    let upright = UnitQuaternion::identity();
    let per_torque = probe.contacts(&upright, &Vector6::zeros(), &Vector3::repeat(1.0)).wheel_tractions[0];
    let limit = 0.3 * params.static_wheel_load() / per_torque;
    for yaw in [0.0, 0.4, 1.1, 2.5, -2.0] {
        let slips = |torque: f64| {
            let mut robot = RigidMotion::new(&params, 1e-3).unwrap();
            robot.reset(&State::tilted(&params, Vector2::zeros(), yaw)).unwrap();
            for _ in 0..30 {
                robot.step(&[torque; 3]);
            }
            robot.contacts().wheel_slip_speeds[0].abs() > 1e-3
        };
        assert!(!slips(0.995 * limit), "yaw {yaw}: slips below {limit} N·m");
        assert!(slips(1.005 * limit), "yaw {yaw}: sticks above {limit} N·m");
    }
}

#[test]
fn slipping_wheel_spins_up_at_the_closed_form_rate() {
    let params = Params { wheel_static_friction: 0.5, wheel_dynamic_friction: 0.5, ..Params::paper() };
    let wheels = Omniwheels::new(&params);
    let mut robot = RigidMotion::new(&params, 1e-3).unwrap();
    let torque = 0.6;
    let spin = |state: &State| state.wheel_speeds[0] - (wheels.u * state.body_angular_velocity)[0];
    for _ in 0..20 {
        robot.step(&[torque; 3]);
    }
    let before = spin(&robot.state());
    let mut friction = 0.0;
    for _ in 0..20 {
        // The load of one step limits the friction of the next.
        friction += params.wheel_dynamic_friction * robot.contacts().wheel_normal_forces[0] / 20.0;
        robot.step(&[torque; 3]);
        assert!(robot.contacts().wheel_slip_speeds[0] > 0.0);
    }
    let found = (spin(&robot.state()) - before) / 0.02;
    let expected = (torque - friction * params.wheel_radius) / params.wheel_inertia;
    assert!((found / expected - 1.0).abs() < 5e-3, "spins up at {found} rad/s², expected {expected}");
}

#[test]
fn static_friction_holds_what_dynamic_friction_does_not() {
    let params = Params { wheel_static_friction: 0.6, wheel_dynamic_friction: 0.3, ..Params::paper() };
    let slip = |torque: f64, kick: f64| {
        let mut robot = RigidMotion::new(&params, 1e-3).unwrap();
        let mut state = State::upright(&params);
        state.wheel_speeds = [kick; 3];
        robot.reset(&state).unwrap();
        for _ in 0..60 {
            robot.step(&[torque; 3]);
        }
        robot.contacts().wheel_slip_speeds[0].abs()
    };
    // 0.45 of the load is between the two coefficients.
    let torque = 0.45 * params.static_wheel_load() * params.wheel_radius;
    assert!(slip(torque, 0.0) < 1e-3, "breaks loose from rest");
    assert!(slip(torque, 10.0) > 0.1, "a slipping wheel is caught");
}

#[test]
fn lifted_robot_falls_freely_and_lands() {
    let params = Params::paper();
    let mut robot = RigidMotion::new(&params, 1e-3).unwrap();
    let mut state = State::upright(&params);
    state.ball_position.z += 0.05;
    state.body_position.z += 0.05;
    robot.reset(&state).unwrap();
    for _ in 0..50 {
        robot.step(&[0.0; 3]);
    }
    // Semi-implicit integration of v' = −g: v is exact, z is g t dt / 2 ahead.
    let speed = robot.state().ball_velocity.z;
    assert!((speed + 9.81 * 0.05).abs() < 1e-9, "falls at {speed}");
    assert_eq!(robot.contacts().floor_force.norm(), 0.0);
    for _ in 0..400 {
        robot.step(&[0.0; 3]);
    }
    let contacts = robot.contacts();
    assert!((contacts.floor_force.z / 35.95 - 1.0).abs() < 0.05, "has not landed: {contacts:?}");
}

#[test]
fn toppled_robot_comes_to_lie_on_the_floor() {
    let params = Params::paper();
    let mut robot = RigidMotion::new(&params, 1e-3).unwrap();
    robot.reset(&State::tilted(&params, Vector2::new(0.2, 0.1), 0.0)).unwrap();
    let start = robot.energy();
    let mut highest = start;
    for _ in 0..4000 {
        robot.step(&[0.0; 3]);
        highest = highest.max(robot.energy());
    }
    let state = robot.state();
    assert!(robot.contacts().bot_on_floor);
    assert!(state.tilt() > 1.0 && state.body_position.z > 0.0, "{state:?}");
    assert!(highest <= start * (1.0 + 1e-3), "energy rose from {start} to {highest} J");
    assert!(state.body_angular_velocity.norm() < 1.0, "still tumbling: {state:?}");
}

#[test]
fn wheels_push_the_ball_but_neither_pull_nor_sink_into_it() {
    let params = Params::paper();
    let drop = |height: f64| {
        let mut state = State::upright(&params);
        state.ball_position.z += height;
        state.body_position.z += height;
        state
    };
    let blows = [Vector3::zeros(), Vector3::new(1.0, 0.0, -2.0), Vector3::new(0.0, 0.3, 0.6), Vector3::zeros()];
    let starts = [drop(0.0), drop(0.0), drop(0.0), drop(0.05)];
    for (start, blow) in starts.iter().zip(blows) {
        let mut robot = RigidMotion::new(&params, 1e-3).unwrap();
        robot.reset(start).unwrap();
        for step in 0..300 {
            if step == 50 {
                robot.push(&blow, &Vector3::new(0.0, 0.0, 0.3));
            }
            robot.step(&[0.05, -0.02, 0.01]);
            let (state, contacts) = (robot.state(), robot.contacts());
            for load in contacts.wheel_normal_forces {
                assert!(load >= -1e-9, "{blow}: a wheel pulls with {load} N in step {step}");
            }
            let up = state.body_quaternion.inverse_transform_vector(&(state.body_position - state.ball_position));
            assert!(up.z >= -1e-4, "{blow}: the body is {} m into the ball in step {step}", -up.z);
        }
    }
}

#[test]
fn a_push_changes_the_momentum_by_its_impulse() {
    let params = Params::paper();
    let mut robot = RigidMotion::new(&params, 1e-3).unwrap();
    let mut state = State::upright(&params);
    // In the air, clear of the ball, so that nothing else acts.
    state.ball_position.z = 1.0;
    state.body_position.z = 2.0;
    robot.reset(&state).unwrap();
    let impulse = Vector3::new(0.2, -0.1, 0.05);
    let point = Vector3::new(0.03, 0.0, 0.3);
    robot.push(&impulse, &point);
    robot.step(&[0.0; 3]);
    let state = robot.state();
    let com = Vector3::z() * params.body_com_height;
    let velocity = state.body_velocity + state.body_angular_velocity.cross(&com);
    let momentum = velocity * params.body_mass + Vector3::z() * params.body_mass * 9.81e-3;
    assert!((momentum - impulse).norm() < 1e-3 * impulse.norm(), "{momentum}");
    // The wheels turn freely on their axles, which takes part of the angular impulse.
    let wheels = Omniwheels::new(&params);
    let spin = Vector3::from(state.wheel_speeds) - wheels.u * state.body_angular_velocity;
    let angular = Vector3::from(params.body_inertia).component_mul(&state.body_angular_velocity)
        - wheels.u.transpose() * spin * params.wheel_inertia;
    let expected = (point - com).cross(&impulse);
    assert!((angular - expected).norm() < 2e-3 * expected.norm(), "{angular}, expected {expected}");
}

#[test]
fn joint_friction_slows_wheels_that_turn_in_the_air() {
    let params = Params::paper();
    let mut state = State::upright(&params);
    state.ball_position.z = 20.0;
    state.body_position.z = 30.0;
    state.wheel_speeds = [20.0, 20.0, 20.0];
    let speed_after = |dynamics: JointDynamics, steps: usize| {
        let mut robot = RigidMotion::new(&params, 1e-4).unwrap();
        robot.set_joint_dynamics(dynamics);
        robot.reset(&state).unwrap();
        for _ in 0..steps {
            robot.step(&[0.0; 3]);
        }
        robot.state().wheel_speeds[0]
    };
    // Three wheels against the body about the vertical: the body's yaw takes up a share c of each relative speed.
    let share = 1.0 + 3.0 * params.wheel_inertia * 0.5 / params.body_inertia[2];
    let viscous = JointDynamics { viscous_friction: 1e-3, coulomb_friction: 0.0 };
    let expected = 20.0 * (-1e-3 * share / params.wheel_inertia * 0.1).exp();
    let found = speed_after(viscous, 1000);
    assert!((found / expected - 1.0).abs() < 0.01, "viscous: {found}, expected {expected}");
    let dry = JointDynamics { viscous_friction: 0.0, coulomb_friction: 0.01 };
    let expected = 20.0 - 0.01 * share / params.wheel_inertia * 0.1;
    let found = speed_after(dry, 1000);
    assert!((found / expected - 1.0).abs() < 0.01, "dry: {found}, expected {expected}");
    assert!(speed_after(dry, 6000).abs() < 1e-6, "dry friction does not bring the wheel to rest");
}

#[test]
fn viscous_floor_friction_takes_the_power_it_should() {
    let params = Params { ball_viscous_friction: 5.0, ..Params::paper() };
    let mut exact = SpatialMotion::new(&params, 1e-3);
    let mut rigid = RigidMotion::new(&params, 1e-3).unwrap();
    let start = State::rolling(&params, Vector2::new(0.4, 0.1), 0.0, attitude(Vector2::zeros(), 0.0), Vector3::zeros());
    for robot in [&mut exact as &mut dyn Model, &mut rigid] {
        robot.reset(&start).unwrap();
        for _ in 0..200 {
            robot.step(&[0.0; 3]);
        }
    }
    let off = (rigid.state().ball_velocity - exact.state().ball_velocity).norm();
    assert!(off < 2e-3, "{off} m/s apart after 0.2 s");
}

/// A run with everything in it: feedback, a push, a fall.
fn eventful(robot: &mut RigidMotion) -> [f64; State::LEN] {
    let params = robot.params().clone();
    let mut lqr = Lqr::new(&params, 0.01).unwrap();
    robot.reset(&State::tilted(&params, Vector2::new(0.06, -0.02), 1.0)).unwrap();
    for k in 0..150 {
        if k == 40 {
            robot.push(&Vector3::new(0.1, 0.2, 0.0), &Vector3::new(0.0, 0.0, 0.3));
        }
        let torques = if k < 80 { lqr.wheel_torques(&robot.state(), &Setpoint::default()) } else { [0.3, -0.2, 0.1] };
        for _ in 0..10 {
            robot.step(&torques);
        }
    }
    robot.state().to_array()
}

#[test]
fn runs_and_resets_are_equal_to_the_last_bit() {
    let params = Params::paper();
    let mut robot = RigidMotion::new(&params, 1e-3).unwrap();
    let first = eventful(&mut robot);
    assert!(first.iter().all(|v| v.is_finite()));
    assert_eq!(first, eventful(&mut RigidMotion::new(&params, 1e-3).unwrap()), "two robots differ");
    assert_eq!(first, eventful(&mut robot), "a reset robot differs from a new one");
}

#[test]
fn saved_world_continues_to_the_last_bit() {
    let params = Params::paper();
    let mut robot = RigidMotion::new(&params, 1e-3).unwrap();
    robot.reset(&State::tilted(&params, Vector2::new(0.06, -0.02), 1.0)).unwrap();
    for _ in 0..100 {
        robot.step(&[0.05, -0.1, 0.0]);
    }
    robot.push(&Vector3::new(0.0, 0.1, 0.0), &Vector3::zeros());
    let saved = robot.save();
    let mut other = RigidMotion::new(&params, 1e-3).unwrap();
    other.load(&saved).unwrap();
    for _ in 0..300 {
        robot.step(&[0.1, 0.0, -0.05]);
        other.step(&[0.1, 0.0, -0.05]);
        assert_eq!(robot.state().to_array(), other.state().to_array(), "at {} s", robot.time());
    }
    assert!(other.load(&saved[..100]).is_err());
}

#[test]
fn a_bot_in_the_floor_is_refused() {
    let params = Params::paper();
    let mut robot = RigidMotion::new(&params, 1e-3).unwrap();
    for (tilt, part) in [(2.0, "body"), (3.1, "body")] {
        let message = robot.reset(&State::tilted(&params, Vector2::new(tilt, 0.0), 0.0)).unwrap_err().to_string();
        assert!(message.starts_with(&format!("height of the lowest point of the {part} = -")), "{message}");
    }
    // Lying with its wheels at the floor's level, but the body lifted clear.
    let mut state = State::tilted(&params, Vector2::new(3.1, 0.0), 0.0);
    state.body_position.z = 1.0;
    state.ball_position.z = 2.0;
    robot.reset(&state).unwrap();
}
