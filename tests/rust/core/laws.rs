//! The laws beyond the regulator and the paper's PID, one module each; shared code is here.

mod admittance;
mod cascade_pid;
mod delay;
mod fuzzy_mamdani;
mod hierarchical_sliding_mode;
mod lean_observer;
mod lqi;
mod lqr_pi;
mod mpc;
mod pd_inverse_dynamics;
mod sliding_mode;
mod takagi_sugeno;

use crate::support::general::any_general_robot;
use ballbot_core::control::{Controller, LaneSetpoint, LimitOptions, Setpoint, controller_kind, controller_kinds};
use ballbot_core::lanes::{EIGHT, Eight};
use ballbot_core::models::LinearModel;
use ballbot_core::{Ballbot, LaneState, ModelKind, Params, State, Wheels, attitude};
use nalgebra::{Complex, DMatrix, Vector2, Vector3};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::{RngSeed, TestRunner};
use std::f64::consts::TAU;

const SIM_DT: f64 = 0.001;
const STEPS: usize = 10;
const CONTROL_DT: f64 = SIM_DT * STEPS as f64;

/// The laws under test: all that hold the position, except the regulator, which they are compared with.
fn laws() -> impl Iterator<Item = &'static str> {
    controller_kinds().into_iter().map(|kind| kind.name).filter(|name| !["lqr", "pid", "admittance"].contains(name))
}

fn made(name: &str, params: &Params, options: &[(&str, &[f64])]) -> Box<dyn Controller> {
    let kind = controller_kind(name).unwrap();
    (kind.make)(params, CONTROL_DT, &kind.limits, options).unwrap()
}

fn law(name: &str, params: &Params) -> Box<dyn Controller> {
    made(name, params, &[])
}

/// The presets without the friction of the joints, which laws compensate.
fn presets() -> impl Iterator<Item = (&'static str, Params)> {
    Params::preset_names().iter().map(|name| (*name, without_joint_friction(&Params::preset(name).unwrap())))
}

fn without_joint_friction(params: &Params) -> Params {
    Params { wheel_viscous_friction: 0.0, wheel_coulomb_friction: 0.0, ..params.clone() }
}

/// A robot whose center of mass is off its mast, and whose wheels are asymmetric.
fn uneven() -> Params {
    let [a, b, c] = Params::paper().wheel_azimuths;
    Params { body_com_offset: [5e-3, -3e-3], wheel_azimuths: [a + 0.02, b - 0.03, c + 0.01], ..Params::paper() }
}

/// Every law is the law of the robot without friction in its joints, which is added to its torques.
#[test]
fn the_friction_of_the_joints_is_compensated() {
    let (viscous, dry) = (2e-3, 0.02);
    let robot = Params::paper();
    let rough = Params { wheel_viscous_friction: viscous, wheel_coulomb_friction: dry, ..Params::paper() };
    for kind in controller_kinds().into_iter().filter(|kind| !["mppi", "nmpc"].contains(&kind.name)) {
        let limits = LimitOptions { max_torque: Some(0.3), ..kind.limits };
        let make = |params: &Params| (kind.make)(params, CONTROL_DT, &limits, &[]).unwrap();
        let (mut plain, mut compensating) = (make(&robot), make(&rough));
        for (tilt, speed) in [(0.0, 0.0), (0.01, 0.5), (-0.02, -3.0), (0.01, 50.0)] {
            let mut state = State::tilted(&robot, Vector2::new(tilt, -tilt), 0.1);
            state.wheel_speeds = Wheels([speed, -0.5 * speed, 0.1 * speed]);
            let setpoint = Setpoint::default();
            plain.reset();
            compensating.reset();
            let (expected, found) =
                (plain.wheel_torques(&state, &setpoint), compensating.wheel_torques(&state, &setpoint));
            for i in 0..3 {
                let speed = state.wheel_speeds[i];
                let friction = viscous * speed + dry * speed / (1.0 + speed * speed).sqrt();
                let sum = (expected[i] + friction).clamp(-0.3, 0.3);
                assert!((found[i] - sum).abs() < 1e-12, "{}, wheel {i} at {speed}: {}, {sum}", kind.name, found[i]);
            }
        }
    }
}

#[test]
fn controllers_report_the_numbers_that_they_compute_with() {
    for kind in controller_kinds() {
        let name = kind.name;
        for (limits, scales) in [(LimitOptions::TRACTION, true), (LimitOptions::CAP, false)] {
            let law = (kind.make)(&uneven(), CONTROL_DT, &limits, &[]).unwrap();
            let Some(constants) = law.constants() else { continue };
            let mut names: Vec<_> = constants.iter().map(|constant| constant.name).collect();
            assert_eq!(names.contains(&"traction_rows"), scales, "{name}");
            for constant in constants.iter() {
                assert_eq!(constant.shape.iter().product::<usize>(), constant.values.len(), "{name} {}", constant.name);
                assert!(constant.values.iter().all(|value| value.is_finite()), "{name} {}", constant.name);
            }
            names.sort_unstable();
            names.dedup();
            assert_eq!(names.len(), constants.iter().count(), "{name}");
        }
    }
}

/// K of τ = −K (x, memory), from differences of the torques near the equilibrium.
fn gain_of(controller: &dyn Controller, params: &Params) -> DMatrix<f64> {
    const SMALL: f64 = 1e-5;
    let (setpoint, memory) = (LaneSetpoint::from(&Setpoint::default()), controller.memory_len());
    let torques = |x: &DMatrix<f64>| {
        let rate = params.to_balance_frame().inverse_transform_vector(&Vector3::new(x[7], x[8], x[9]));
        let body = attitude(Vector2::new(x[2], x[3]), x[4]) * params.to_balance_frame();
        let mut state = State::rolling(params, Vector2::new(x[5], x[6]), 0.0, body, rate);
        state.ball_position += Vector3::new(x[0], x[1], 0.0);
        let mut kept = x.as_slice()[10..].to_vec();
        controller.torques_one(&LaneState::from(&state), &setpoint, f64::INFINITY, &mut kept)
    };
    let mut gain = DMatrix::zeros(3, 10 + memory);
    for j in 0..10 + memory {
        let small = DMatrix::from_fn(10 + memory, 1, |i, _| if i == j { SMALL } else { 0.0 });
        let (above, below) = (torques(&small), torques(&-small));
        (0..3).for_each(|i| gain[(i, j)] = (below[i] - above[i]) / (2.0 * SMALL));
    }
    gain
}

/// A + B (−K) of the linear model, in continuous time, with the memory of the law.
fn closed_loop(params: &Params, gain: &DMatrix<f64>, kept: &DMatrix<f64>) -> DMatrix<f64> {
    let LinearModel { a, b } = LinearModel::new(params);
    let size = gain.ncols();
    let mut closed = DMatrix::zeros(size, size);
    closed.view_mut((0, 0), (10, 10)).copy_from(&a);
    let driven = closed.rows(0, 10) - b * gain;
    closed.rows_mut(0, 10).copy_from(&driven);
    closed.rows_mut(10, size - 10).copy_from(kept);
    closed
}

/// Asserts that a matrix has these eigenvalues and no others.
fn assert_poles(matrix: &DMatrix<f64>, expected: &[Complex<f64>], tolerance: f64) {
    let mut found: Vec<_> = matrix.complex_eigenvalues().iter().copied().collect();
    assert_eq!(found.len(), expected.len());
    for pole in expected {
        let off = |other: &Complex<f64>| (other - pole).norm();
        let nearest = (0..found.len()).min_by(|&i, &j| off(&found[i]).total_cmp(&off(&found[j]))).unwrap();
        let other = found.swap_remove(nearest);
        assert!(off(&other) < tolerance, "{other} in place of {pole}");
    }
}

/// Both poles of s² + 2 ζ ω s + ω², ζ < 1.
fn pair(frequency: f64, damping: f64) -> [Complex<f64>; 2] {
    let imaginary = frequency * (1.0 - damping * damping).sqrt();
    [imaginary, -imaginary].map(|imaginary| Complex::new(-damping * frequency, imaginary))
}

/// Record of a robot.
#[derive(Debug)]
struct Run {
    tilt: f64,
    speed: f64,
    end: State,
}

/// Runs a controller; `before` acts on the robot and the torques before each step of the simulation. `None` if the
/// robot falls.
fn run(
    robot: &mut Ballbot,
    controller: &mut dyn Controller,
    seconds: f64,
    setpoint: impl Fn(f64) -> Setpoint,
    before: impl Fn(&mut Ballbot, &mut Wheels<f64>),
) -> Option<Run> {
    let (mut tilt, mut speed) = (0.0_f64, 0.0_f64);
    for k in 0..(seconds / CONTROL_DT).round() as usize {
        let torques = controller.wheel_torques(&robot.state(), &setpoint(k as f64 * CONTROL_DT));
        for _ in 0..STEPS {
            let mut applied = torques;
            before(robot, &mut applied);
            robot.step(applied, 1).ok()?;
        }
        let state = robot.state();
        (tilt, speed) = (tilt.max(state.tilt()), speed.max(state.ball_velocity.norm()));
        if tilt > 1.0 {
            return None;
        }
    }
    Some(Run { tilt, speed, end: robot.state() })
}

fn robot(params: &Params, kind: ModelKind, start: &State) -> Ballbot {
    let mut robot = Ballbot::new(params, kind, SIM_DT).unwrap();
    robot.reset(start).unwrap();
    robot
}

fn position(x: f64, y: f64) -> impl Fn(f64) -> Setpoint {
    move |_| Setpoint { position: Vector2::new(x, y), ..Setpoint::default() }
}

/// Whether a robot recovers after a start and an impulse at its center of mass, in `contact`.
fn recovers(params: &Params, make: &dyn Fn() -> Box<dyn Controller>, start: &State, impulse: Vector3<f64>) -> bool {
    let mut robot = robot(params, ModelKind::Contact, start);
    robot.push(&impulse, None).unwrap();
    let end = run(&mut robot, make().as_mut(), 6.0, position(0.0, 0.0), |_, _| ());
    end.is_some_and(|run| run.end.tilt() < 0.03)
}

/// A third of a turn: the robot looks the same from each wheel.
fn around(count: u32) -> impl Iterator<Item = Vector2<f64>> {
    (0..count).map(move |k| TAU / 3.0 * f64::from(k) / f64::from(count)).map(|a| Vector2::new(a.cos(), a.sin()))
}

/// The largest of the numbers up to which a condition holds in all of 12 directions.
fn largest(numbers: impl Iterator<Item = f64>, holds: impl Fn(Vector2<f64>, f64) -> bool) -> f64 {
    numbers.take_while(|&number| around(12).all(|direction| holds(direction, number))).last().unwrap_or(0.0)
}

fn basin_of(params: &Params, make: &dyn Fn() -> Box<dyn Controller>) -> f64 {
    let degrees = (3..=32).map(f64::from);
    largest(degrees, |direction, degrees| {
        recovers(params, make, &State::tilted(params, direction * degrees.to_radians(), 0.0), Vector3::zeros())
    })
}

fn push_of(params: &Params, make: &dyn Fn() -> Box<dyn Controller>) -> f64 {
    let impulses = (3..=30).map(|k| 0.1 * f64::from(k));
    largest(impulses, |direction, size| recovers(params, make, &State::upright(params), direction.push(0.0) * size))
}

/// Tilts from rest in steps of 1 deg and impulses in steps of 0.1 N·s, worst of 12 directions.
#[test]
fn basins_and_pushes() {
    for (name, least_tilt, least_push) in [
        ("lqr", 26.0, 1.9),
        ("lqi", 26.0, 1.9),
        ("cascade_pid", 25.0, 1.8),
        ("hierarchical_sliding_mode", 26.0, 1.9),
        ("pd_inverse_dynamics", 25.0, 1.8),
        ("sliding_mode", 25.0, 1.8),
        ("fuzzy_mamdani", 25.0, 1.8),
        ("takagi_sugeno", 26.0, 1.9),
        ("mpc", 26.0, 1.9),
        ("lqr_pi", 24.0, 1.6),
    ] {
        let params = Params::paper();
        let make = || law(name, &params);
        let (tilt, push) = (basin_of(&params, &make), push_of(&params, &make));
        println!("{name}: {tilt} deg, {push:.1} N·s");
        assert!(tilt >= least_tilt && push >= least_push, "{name}: {tilt} deg, {push} N·s");
    }
}

/// A step of 0.5 m: overshoot, undershoot and the time until the error stays below 20 mm.
#[test]
fn steps_of_the_setpoint() {
    const STEP: f64 = 0.5;
    let params = Params::paper();
    for name in ["lqr"].into_iter().chain(laws()) {
        let mut robot = robot(&params, ModelKind::Contact, &State::upright(&params));
        let mut controller = law(name, &params);
        let (mut over, mut under, mut settled) = (0.0_f64, 0.0_f64, 0.0);
        for _ in 0..1500 {
            run(&mut robot, controller.as_mut(), CONTROL_DT, position(STEP, 0.0), |_, _| ()).unwrap();
            let x = robot.state().ball_position.x;
            (over, under) = (over.max(x - STEP), under.max(-x));
            if (x - STEP).abs() > 0.02 {
                settled = robot.time();
            }
        }
        println!(
            "{name}: overshoot {:.1} %, undershoot {:.1} %, {settled:.2} s",
            over / STEP * 100.0,
            under / STEP * 100.0
        );
        assert!(over < 0.06 * STEP && under < 0.04 * STEP && settled < 4.0, "{name}: {over} m over, {settled} s");
    }
}

#[test]
fn controllers_recover_from_eight_degrees_on_all_presets() {
    for (preset, params) in presets() {
        for name in laws() {
            for kind in [ModelKind::Spatial, ModelKind::Contact] {
                for direction in around(2) {
                    let start = State::tilted(&params, direction * 8_f64.to_radians(), 0.6);
                    let mut robot = robot(&params, kind, &start);
                    let setpoint = |_| Setpoint { yaw: 0.6, ..Setpoint::default() };
                    let end = run(&mut robot, law(name, &params).as_mut(), 20.0, setpoint, |_, _| ());
                    let end = end.unwrap_or_else(|| panic!("{name} falls: {preset}, {kind}")).end;
                    let left = end.ball_position.xy().norm();
                    assert!(end.tilt() < 1e-3 && left < 5e-3, "{name}, {preset}, {kind}: {} rad, {left} m", end.tilt());
                }
            }
        }
    }
}

/// Robots from half a kilogram to fifty with their center of mass off the mast: the default options are in units of λ.
/// They grip, and each wheel carries load.
#[test]
fn controllers_bring_any_robot_to_rest() {
    let config = ProptestConfig { rng_seed: RngSeed::Fixed(2), failure_persistence: None, ..ProptestConfig::default() };
    let mut runner = TestRunner::new(config);
    let sampled = std::iter::repeat_with(|| any_general_robot().new_tree(&mut runner).unwrap().current());
    let carried = |params: &Params| {
        let least = 0.15 * params.body_mass * params.gravity;
        params.equilibrium_wheel_loads().iter().all(|load| *load > least)
    };
    for (number, sampled) in sampled.filter(carried).take(8).enumerate() {
        let params =
            Params { wheel_coulomb_friction: 0.0, wheel_static_friction: 5.0, wheel_dynamic_friction: 5.0, ..sampled };
        for name in laws() {
            let start = State::tilted_from_equilibrium(&params, Vector2::new(0.02, -0.01), 0.0);
            let mut robot = robot(&params, ModelKind::Spatial, &start);
            let end = run(&mut robot, law(name, &params).as_mut(), 30.0, position(0.0, 0.0), |_, _| ());
            let end = end.unwrap_or_else(|| panic!("{name} falls with robot {number}")).end;
            let left = end.ball_position.xy().norm();
            assert!(left < 0.01, "{name}, robot {number}: {left} m left");
        }
    }
}

/// Setpoints far beyond what the robot can do.
#[test]
fn a_far_setpoint_topples_no_robot() {
    let params = Params::paper();
    for name in laws() {
        for (distance, seconds) in [(1.0, 15.0), (5.0, 25.0), (1000.0, 20.0)] {
            for direction in around(3) {
                let mut robot = robot(&params, ModelKind::Contact, &State::upright(&params));
                let target = direction * distance;
                let found =
                    run(&mut robot, law(name, &params).as_mut(), seconds, position(target.x, target.y), |_, _| ());
                let found = found.unwrap_or_else(|| panic!("{name} falls on its way to {distance} m"));
                assert!(
                    found.tilt < 0.3 && found.speed < 1.4,
                    "{name}, {distance} m: {} rad, {}",
                    found.tilt,
                    found.speed
                );
                let left = (found.end.ball_position.xy() - target).norm();
                assert!(distance > 5.0 || left < 0.02, "{name}, {distance} m: {left} m left");
            }
        }
    }
}

#[test]
fn position_and_heading_are_reached() {
    for params in [Params::paper(), uneven()] {
        for name in laws() {
            let mut robot = robot(&params, ModelKind::Spatial, &State::at_equilibrium(&params, -2.0));
            let target = Setpoint { position: Vector2::new(0.2, -0.1), yaw: 2.5, ..Setpoint::default() };
            let end = run(&mut robot, law(name, &params).as_mut(), 20.0, |_| target, |_, _| ()).unwrap().end;
            let left = (end.ball_position.xy() - target.position).norm();
            assert!(left < 2e-3 && (end.yaw() - target.yaw).abs() < 1e-3, "{name}: {left} m, heading {}", end.yaw());
        }
    }
}

/// A robot rotated and translated together with its setpoint has the same torques.
#[test]
fn torques_do_not_depend_on_heading_and_position() {
    let params = uneven();
    let torques = |name: &str, yaw: f64, offset: Vector2<f64>| {
        let turn = nalgebra::Rotation2::new(yaw);
        let body = attitude(turn * Vector2::new(0.05, -0.03), yaw + 0.1) * params.to_balance_frame();
        let velocity = turn * Vector2::new(0.2, 0.1);
        let mut state = State::rolling(&params, velocity, 0.0, body, Vector3::new(0.3, -0.1, 0.2));
        state.ball_position += (offset + turn * Vector2::new(0.02, 0.03)).push(0.0);
        law(name, &params).wheel_torques(&state, &Setpoint { position: offset, yaw, ..Setpoint::default() })
    };
    for name in laws() {
        let expected = torques(name, 0.0, Vector2::zeros()).column();
        let found = torques(name, 2.0, Vector2::new(3.0, -1.0)).column();
        assert!((found - expected).amax() < 1e-12, "{name}: {found}, expected {expected}");
    }
}

/// States from calm to wild.
fn scattered_states(params: &Params) -> Vec<State> {
    let state = |k: usize| {
        let wave = |i: usize| (k as f64 * 0.37 + i as f64 * 1.7).sin() * k as f64 / 400.0;
        let body = attitude(Vector2::new(wave(0), wave(1)) * 1.5, wave(2) * 3.0);
        let rate = Vector3::new(wave(3), wave(4), wave(5)) * 10.0;
        let mut state = State::rolling(params, Vector2::new(wave(6), wave(7)) * 3.0, 0.0, body, rate);
        state.ball_position += Vector3::new(wave(8), wave(9), 0.0) * 5.0;
        state
    };
    (0..400).map(state).collect()
}

#[test]
fn lanes_equal_the_scalar_law() {
    for name in laws() {
        lanes_equal_one_robot(name, &[]);
    }
}

fn lanes_equal_one_robot(name: &str, options: &[(&str, &[f64])]) {
    let params = uneven();
    let controller = made(name, &params, options);
    let setpoint = |i: usize| Setpoint {
        position: Vector2::new(0.1, -0.05) * i as f64,
        velocity: Vector2::new(-0.02, 0.03) * i as f64,
        yaw: i as f64 - 3.0,
        ..Setpoint::default()
    };
    let mut targets = LaneSetpoint::<Eight>::default();
    (0..EIGHT).for_each(|i| targets.set_lane(i, &(&setpoint(i)).into()));
    let mut memory = vec![Eight::default(); controller.memory_len()];
    let mut single = vec![vec![0.0; controller.memory_len()]; EIGHT];
    for eight in scattered_states(&params).chunks_exact(EIGHT) {
        let mut all = LaneState::<Eight>::default();
        eight.iter().enumerate().for_each(|(i, state)| all.set_lane(i, &LaneState::from(state)));
        let torques = controller.torques_eight(&all, &targets, f64::INFINITY, &mut memory);
        for (i, kept) in single.iter_mut().enumerate() {
            let expected =
                controller.torques_one(&LaneState::from(&eight[i]), &(&setpoint(i)).into(), f64::INFINITY, kept);
            let found = torques.map(|cell| cell.0[i]);
            assert_eq!(found.map(f64::to_bits), expected.map(f64::to_bits), "{name}, lane {i}");
            assert!(found.iter().any(|torque| *torque != 0.0));
            for (number, kept) in kept.iter().enumerate() {
                assert_eq!(memory[number].0[i].to_bits(), kept.to_bits(), "{name}, lane {i}, number {number}");
            }
        }
    }
}

/// The default limits of the laws are the traction limits.
#[test]
fn controllers_are_limited_by_the_traction() {
    for name in laws() {
        assert_eq!(controller_kind(name).unwrap().limits, LimitOptions::TRACTION);
    }
}
