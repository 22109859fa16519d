//! The robot balanced on estimates, under noise, slip and a wrong center of mass.

use super::options;
use super::record::{Filter, Noise, Plan, Sensors, attitude_error, crooked, read};
use ballbot_core::control::{Controller, Lqr, Setpoint, default_max_torque};
use ballbot_core::sensor::estimator::EstimatorOptions;
use ballbot_core::{Ballbot, ModelKind, Params, State, Wheels};
use nalgebra::{Vector2, Vector3};

const DT: f64 = 0.01;
/// Model steps in a control step.
const SUBSTEPS: usize = 10;

/// A robot with its sensors, its estimator and the last output of both.
struct Plant {
    robot: Ballbot,
    sensors: Sensors,
    filter: Filter,
    estimate: State,
    substeps: usize,
}

impl Plant {
    /// The robot of `truth` with an estimator of the robot of `nominal`, both at the equilibrium of `truth`.
    fn new(truth: &Params, nominal: &Params, options: &EstimatorOptions, noise: &Noise, seed: u64) -> Self {
        Self::with_substeps(truth, nominal, options, noise, seed, SUBSTEPS)
    }

    fn with_substeps(
        truth: &Params,
        nominal: &Params,
        options: &EstimatorOptions,
        noise: &Noise,
        seed: u64,
        substeps: usize,
    ) -> Self {
        let mut robot = Ballbot::new(truth, ModelKind::Contact, DT / substeps as f64).unwrap();
        robot.reset(&State::at_equilibrium(truth, 0.0)).unwrap();
        let mut sensors = Sensors::new(noise, seed);
        let start = robot.state();
        let first = sensors.read(&read(truth, &start, &start, DT), DT);
        let filter = Filter::new(nominal, options, DT, &start, &first);
        Self { robot, sensors, filter, estimate: start, substeps }
    }

    fn step(&mut self, torques: Wheels<f64>) {
        let before = self.robot.state();
        self.robot.step(torques, self.substeps).unwrap();
        let exact = read(self.robot.params(), &before, &self.robot.state(), DT);
        self.estimate = self.filter.update(&self.sensors.read(&exact, DT));
    }
}

#[test]
fn robot_balances_on_estimates_under_noise() {
    let params = Params::paper();
    let noise = Noise::default();
    for seed in 0..5 {
        let mut plant = Plant::new(&params, &params, &options(), &noise, seed);
        let mut lqr = Lqr::new(&params, DT).unwrap();
        let (mut tilt, mut away, mut gated) = (0.0_f64, 0.0_f64, 0.0);
        for _ in 0..2000 {
            let torques = lqr.wheel_torques(&plant.estimate, &Setpoint::default());
            plant.step(torques);
            let state = plant.robot.state();
            tilt = tilt.max(state.tilt());
            away = away.max(state.ball_position.xy().norm());
            gated += plant.filter.slipping().iter().sum::<f64>();
        }
        println!("seed {seed}: tilt {:.3} deg, {:.1} mm away, {gated} gated", tilt.to_degrees(), away * 1e3);
        assert!(tilt < 2.0_f64.to_radians() && away < 0.1, "seed {seed}: tilt {tilt} rad, {away} m away");
    }
}

/// With the smallest errors that a filter may expect, its gates are tightest.
#[test]
fn gripping_wheels_are_used() {
    let options = EstimatorOptions {
        gyro_noise: 1e-4,
        gyro_bias: [0.0; 3],
        gyro_bias_walk: [0.0; 3],
        accelerometer_noise: 1e-2,
        encoder_noise: 1e-6,
        start_attitude: 1e-3,
        start_velocity: 1e-3,
        ..options()
    };
    let noise = Noise { gyro: 0.0, gyro_bias: 0.0, accelerometer: 0.0, tick: 1e-9 };
    for substeps in [10, 5, 2] {
        for params in [Params::paper(), crooked()] {
            let mut plant = Plant::with_substeps(&params, &params, &options, &noise, 0, substeps);
            let mut lqr = Lqr::new(&params, DT).unwrap();
            let (mut tilt, mut velocity, mut gated) = (0.0_f64, 0.0_f64, 0.0);
            for k in 0..1000 {
                plant.step(lqr.wheel_torques(&plant.estimate, &Plan::default().setpoint(k)));
                let state = plant.robot.state();
                gated += plant.filter.slipping().iter().sum::<f64>();
                tilt = tilt.max(attitude_error(&state, &plant.estimate).xy().norm());
                velocity = velocity.max((state.ball_velocity - plant.estimate.ball_velocity).norm());
            }
            println!("{substeps} model steps: {gated} gated, tilt {tilt:.2e} rad, velocity {velocity:.2e} m/s off");
            // With two steps the mean rates lag by a quarter of their change, more than a filter expects.
            let most = if substeps == 2 { 1.0 } else { 0.0 };
            assert!(gated <= most, "{gated} of 3000 readings excluded with {substeps} model steps");
            assert!(tilt < 2e-3 && velocity < 0.02, "{tilt} rad and {velocity} m/s off");
        }
    }
}

/// Errors of velocity and position after torques under which wheels slip, and the steps with slip.
fn after_slip(options: &EstimatorOptions) -> (f64, f64, usize) {
    let params = Params { wheel_dynamic_friction: 0.5, wheel_static_friction: 0.5, ..Params::paper() };
    let quiet = Noise { gyro_bias: 0.0, ..Noise::default() };
    let mut plant = Plant::new(&params, &params, options, &quiet, 1);
    let mut lqr = Lqr::new(&params, DT).unwrap();
    let (mut velocity, mut position, mut slipped) = (0.0_f64, 0.0_f64, 0);
    for k in 0..400 {
        let mut torques = lqr.wheel_torques(&plant.robot.state(), &Setpoint::default());
        // A burst on each wheel in turn, with alternating sign.
        if k % 50 < 5 {
            torques[(k / 50) % 3] += if k % 100 < 50 { 0.5 } else { -0.5 };
        }
        plant.step(torques);
        let state = plant.robot.state();
        slipped += usize::from(plant.robot.contacts().wheel_slip_speeds.iter().any(|s| s.abs() > 0.05));
        velocity = velocity.max((state.ball_velocity - plant.estimate.ball_velocity).norm());
        position = position.max((state.ball_position - plant.estimate.ball_position).norm());
    }
    let tilt = plant.robot.state().tilt();
    println!("{slipped} steps with slip, {velocity} m/s and {position} m off, tilt {tilt}");
    assert!(tilt < 0.3, "the robot fell");
    (velocity, position, slipped)
}

#[test]
fn slipping_wheels_are_ignored() {
    let (velocity, position, slipped) = after_slip(&options());
    let open = EstimatorOptions { slip_gate: 1e6, jump_gate: 1e6, ..options() };
    let (velocity_open, position_open, _) = after_slip(&open);
    println!(
        "{slipped} steps with slip; gated: {velocity:.4} m/s, {position:.4} m; open: {velocity_open:.4}, {position_open:.4}"
    );
    assert!(slipped > 30, "only {slipped} steps with slip");
    assert!(velocity < 0.03 && position < 0.01, "gated: {velocity} m/s, {position} m off");
    assert!(velocity_open > 5.0 * velocity, "without gates: {velocity_open} m/s off");
}

/// Only wheels measure the spin: without them it would be lost for good.
#[test]
fn wheels_that_spin_the_ball_up_are_used() {
    for name in Params::preset_names() {
        let params = Params::preset(name).unwrap();
        let mut plant = Plant::new(&params, &params, &options(), &Noise::default(), 3);
        let mut lqr = Lqr::new(&params, DT).unwrap();
        let burst = 0.7 * default_max_torque(&params);
        let (mut error, mut spin) = (0.0_f64, 0.0_f64);
        for k in 0..100 {
            let mut torques = lqr.wheel_torques(&plant.robot.state(), &Setpoint::default());
            for torque in &mut torques {
                *torque += [burst, -burst, 0.0, 0.0, 0.0][k / 20];
            }
            plant.step(torques);
            let true_spin = plant.robot.state().ball_angular_velocity.z;
            spin = spin.max(true_spin);
            error = error.max((true_spin - plant.estimate.ball_angular_velocity.z).abs());
        }
        println!("{name}: {spin:.1} rad/s, {error:.2} rad/s off");
        assert!(spin > 2.0 && error < 3.0, "{name}: {spin} rad/s, {error} rad/s off");
    }
}

#[test]
fn lean_bias_of_an_unknown_center_of_mass_is_found() {
    let nominal = Params::paper();
    let truth = Params { body_com_offset: [5e-3, -3e-3], ..Params::paper() };
    let lean = truth.equilibrium_attitude(0.0) * Vector3::z();
    let mut offsets = [0.0; 2];
    for (compensated, offset) in [false, true].into_iter().zip(&mut offsets) {
        let mut plant = Plant::new(&truth, &nominal, &options(), &Noise::default(), 3);
        let mut lqr = Lqr::new(&nominal, DT).unwrap();
        let mut mean = Vector2::zeros();
        for k in 0..2000 {
            let state = if compensated { plant.filter.balanced(&plant.estimate) } else { plant.estimate.clone() };
            plant.step(lqr.wheel_torques(&state, &Setpoint::default()));
            if k >= 1500 {
                mean += plant.robot.state().ball_position.xy() / 500.0;
            }
        }
        *offset = mean.norm();
        let [x, y] = plant.filter.estimate().lean_bias;
        let off = Vector2::new(x - lean.x, y - lean.y).norm().to_degrees();
        println!(
            "compensated {compensated}: offset {:.1} mm, bias ({x:.4}, {y:.4}), true {:?}, off {off:.3} deg",
            *offset * 1e3,
            lean.xy().as_slice()
        );
        assert!(off < 0.15, "bias {off} deg off");
        assert!(attitude_error(&plant.robot.state(), &plant.estimate).xy().norm() < 3e-3);
    }
    assert!(offsets[0] > 0.1, "without compensation the robot comes to rest {} m away", offsets[0]);
    assert!(offsets[1] < 0.01, "with compensation {} m away", offsets[1]);
}
