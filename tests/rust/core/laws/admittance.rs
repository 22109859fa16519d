//! The law that yields to a force, and its estimate.

use super::{CONTROL_DT, SIM_DT, lanes_equal_one_robot, law, made, presets, robot};
use ballbot_core::control::{
    Admittance, AdmittanceOptions, Controller, LaneSetpoint, LimitOptions, NamedLaw, Setpoint,
};
use ballbot_core::models::Scale;
use ballbot_core::{Ballbot, Force, LaneState, ModelKind, Params, State};
use nalgebra::{Vector2, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// The laws that estimate a force.
const ESTIMATING: [&str; 6] = ["lqr", "lqr_pi", "mpc", "cascade_pid", "hierarchical_sliding_mode", "admittance"];

/// A force that the robot of the paper can stand, N, scaled to a robot.
fn newtons(params: &Params, force: f64) -> f64 {
    force * Scale::of(params).factor("N").unwrap() * Scale::of(params).factor("rad").unwrap()
}

struct Led {
    robot: Ballbot,
    controller: Box<dyn Controller>,
    memory: Vec<f64>,
    setpoint: LaneSetpoint<f64>,
}

impl Led {
    fn new(name: &str, params: &Params, model: ModelKind, options: &[(&str, &[f64])], yaw: f64) -> Self {
        let controller = made(name, params, options);
        Self {
            robot: robot(params, model, &State::at_equilibrium(params, yaw)),
            memory: vec![0.0; controller.memory_len()],
            setpoint: LaneSetpoint::from(&Setpoint { yaw, ..Setpoint::default() }),
            controller,
        }
    }

    fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / CONTROL_DT).round() as usize {
            let state = LaneState::from(&self.robot.state());
            let torques = self.controller.torques_one(&state, &self.setpoint, f64::INFINITY, &mut self.memory);
            self.robot.step(torques, (CONTROL_DT / SIM_DT).round() as usize).unwrap();
            assert!(self.robot.state().tilt() < 1.0, "it falls");
        }
    }

    fn force(&mut self, force: Vector2<f64>, point: Option<Vector3<f64>>) {
        self.robot.apply_force(&Force::constant(force.push(0.0), point)).unwrap();
    }

    fn estimate(&self) -> Vector2<f64> {
        let index = self.controller.force_index().unwrap();
        Vector2::new(self.memory[index], self.memory[index + 1])
    }

    fn velocity(&self) -> Vector2<f64> {
        self.robot.state().ball_velocity.xy()
    }
}

const ON: &[(&str, &[f64])] = &[("lean_observer", &[2.0])];

/// A force at any height is found along both axes, at any heading, by every law that observes the equilibrium.
#[test]
fn the_estimate_converges_to_the_force() {
    for (preset, params) in presets() {
        let l = params.body_com_height;
        let size = newtons(&params, 0.8);
        for name in ESTIMATING {
            for (azimuth, height, yaw) in
                [(0.0_f64, 0.0, 0.0), (1.57, l, 0.0), (0.7, 2.0 * l, 1.1), (-2.0, 0.5 * l, -2.5)]
            {
                let force = Vector2::new(azimuth.cos(), azimuth.sin()) * size;
                let mut led =
                    Led::new(name, &params, ModelKind::Contact, if name == "admittance" { &[] } else { ON }, yaw);
                led.force(force, Some(Vector3::z() * height));
                led.run(8.0);
                let error = (led.estimate() - force).norm() / size;
                println!("{preset} {name}, height {height}: {error:e}");
                assert!(error < 0.03, "{preset} {name}, {azimuth}, height {height}: {} of {force}", led.estimate());
            }
        }
    }
}

/// A center of mass that is off, by which the robot leans as under a force, does not count; a slope does.
#[test]
fn a_slope_counts_as_a_force_and_a_center_of_mass_that_is_off_does_not() {
    let params = Params::paper();
    let off = Params { body_com_offset: [8e-3, -5e-3], ..params };
    let mut led = Led::new("lqr", &params, ModelKind::Contact, ON, 0.0);
    led.robot = robot(&off, ModelKind::Contact, &State::at_equilibrium(&off, 0.0));
    led.run(10.0);
    assert!(led.estimate().norm() < 2e-3, "{}", led.estimate());
    // It leans by 3.8 deg, as under a force of 0.8 N.
    assert!(led.robot.state().tilt() > 0.06);
    led.force(Vector2::new(0.5, 0.3), None);
    led.run(8.0);
    assert!((led.estimate() - Vector2::new(0.5, 0.3)).norm() < 1e-2, "{}", led.estimate());

    let tilted = Params { floor_tilt: [0.0, 0.02], ..params };
    led.robot = robot(&tilted, ModelKind::Contact, &State::upright(&tilted));
    led.memory.fill(0.0);
    led.run(10.0);
    let weight = (params.body_mass + params.ball_mass) * params.gravity * 0.02_f64.sin();
    assert!((led.estimate().norm() - weight).abs() < 0.03 * weight, "{} of {weight}", led.estimate());
}

/// With white noise of the state the error of the estimate has the stated standard deviation.
#[test]
fn the_error_of_the_estimate_has_its_standard_deviation() {
    let noise = [5e-4, 1e-3, 2.5e-3];
    for (preset, params) in presets() {
        let mut led = Led::new("lqr", &params, ModelKind::Spatial, ON, 0.0);
        let force = Vector2::new(0.6, -0.4) * newtons(&params, 1.0);
        led.force(force, None);
        led.run(8.0);
        let stated = Vector2::from(led.controller.force_deviation(&noise).unwrap());
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
        let (mut within_one, mut within_two, mut squares, mut count) = (0, 0, Vector2::zeros(), 0);
        for k in 0..20_000 {
            let mut state = led.robot.state();
            state.ball_velocity += Vector3::new(normal(), normal(), 0.0) * noise[1];
            let turn = ballbot_core::attitude(Vector2::new(normal(), normal()) * noise[0], 0.0);
            state.body_quaternion = turn * state.body_quaternion;
            state.body_angular_velocity += Vector3::new(normal(), normal(), 0.0) * noise[2];
            let state = LaneState::from(&state);
            let torques = led.controller.torques_one(&state, &led.setpoint, f64::INFINITY, &mut led.memory);
            led.robot.step(torques, 10).unwrap();
            if k >= 300 {
                let error = led.estimate() - force;
                for axis in 0..2 {
                    let normed = error[axis] / stated[axis];
                    within_one += usize::from(normed.abs() < 1.0);
                    within_two += usize::from(normed.abs() < 2.0);
                    squares[axis] += normed * normed;
                    count += 1;
                }
            }
        }
        let (one, two) = (within_one as f64 / count as f64, within_two as f64 / count as f64);
        let mean = squares * (2.0 / count as f64);
        println!("{preset}: {stated:?} N, {one:.3} and {two:.3} within one and two, squares {mean:?}");
        assert!((0.6..0.76).contains(&one) && (0.93..0.975).contains(&two), "{preset}: {one}, {two}");
        assert!(mean.iter().all(|mean| (0.75..1.3).contains(mean)), "{preset}: {mean}");
    }
}

/// The virtual damping sets the steady velocity under a force, less the deadband; when the force ends, the robot stops and stays.
#[test]
fn every_preset_is_led_by_a_force_and_stays_where_it_is_left() {
    for (preset, params) in presets() {
        let scale = Scale::of(&params);
        let factor = |unit: &str| scale.factor(unit).unwrap();
        for model in [ModelKind::Spatial, ModelKind::Contact] {
            let mut led = Led::new("admittance", &params, model, &[], 0.4);
            let size = newtons(&params, 1.0);
            let force = Vector2::new(0.8, -0.6) * size;
            led.force(force, Some(Vector3::z() * (1.5 * params.body_com_height)));
            led.run(12.0 * factor("s"));
            let Yields { damping, deadband, speed } = Yields::of(factor);
            let expected = ((size - deadband) / damping).min(speed);
            let found = led.velocity().dot(&force) / size;
            println!(
                "{preset} {model}: {size:.3} N, {found:.4} of {expected:.4} m/s, tilt {:.4}",
                led.robot.state().tilt()
            );
            assert!((found - expected).abs() < 0.06 * expected, "{preset}, {model}: {found} of {expected} m/s");
            led.force(Vector2::zeros(), None);
            led.run(8.0 * factor("s"));
            assert!(led.velocity().norm() < 2e-3, "{preset}, {model}: {} m/s", led.velocity());
            let left = led.robot.state().ball_position;
            led.run(12.0);
            let drift = (led.robot.state().ball_position - left).norm();
            assert!(drift < 2e-3, "{preset}, {model}: {drift} m");
        }
    }
}

struct Yields {
    damping: f64,
    deadband: f64,
    speed: f64,
}

impl Yields {
    /// Of the defaults.
    fn of(factor: impl Fn(&str) -> f64) -> Self {
        Self { damping: 4.0 * factor("N·s/m"), deadband: 0.2 * factor("N"), speed: 0.6 * factor("m/s") }
    }
}

#[test]
fn without_a_force_it_is_the_regulator_and_holds_still() {
    for (preset, params) in presets() {
        let mut led = Led::new("admittance", &params, ModelKind::Contact, &[], 0.0);
        let start = State::tilted_from_equilibrium(&params, Vector2::new(0.02, -0.01), 0.0);
        led.robot.reset(&start).unwrap();
        led.run(20.0 * Scale::of(&params).time);
        let (state, left) = (led.robot.state(), led.robot.state().ball_position.xy().norm());
        assert!(state.tilt() < 1e-3 && left < 0.02, "{preset}: {left} m");
    }
}

#[test]
fn lanes_equal_one_robot_too() {
    lanes_equal_one_robot("admittance", &[]);
    lanes_equal_one_robot("admittance", &[("delay", &[0.02]), ("deadband", &[0.0])]);
}

/// Forces up to the largest, in all directions: it yields no faster than its limits, and a force too large for the robot
/// topples it as it topples the regulator.
#[test]
fn its_motion_keeps_its_limits() {
    let params = Params::paper();
    let limits = LimitOptions::TRACTION;
    let controller = Admittance::with_options(&params, CONTROL_DT, &AdmittanceOptions::default(), &limits).unwrap();
    let mut memory = vec![0.0; controller.memory_len()];
    let index = controller.force_index().unwrap();
    let setpoint = LaneSetpoint::from(&Setpoint::default());
    let state = LaneState::from(&State::upright(&params));
    let mut before = Vector2::zeros();
    for force in [0.1, 0.3, 5.0, 1e3, 1e8, 0.0] {
        for _ in 0..300 {
            memory[index] = force;
            memory[index + 1] = -force;
            let torques = controller.torques_one(&state, &setpoint, f64::INFINITY, &mut memory);
            assert!(torques.iter().all(|torque| torque.is_finite()));
            let velocity = Vector2::new(memory[2], memory[3]);
            assert!(
                velocity.norm() < 0.6 + 1e-9 && (velocity - before).norm() < 0.4 * CONTROL_DT + 1e-12,
                "{velocity}"
            );
            before = velocity;
        }
    }
}

#[test]
fn a_law_without_an_estimate_has_none() {
    let params = Params::paper();
    for name in ["lqr", "pid", "lqi", "sliding_mode"] {
        assert_eq!(law(name, &params).force_index(), None, "{name}");
        assert_eq!(law(name, &params).force_deviation(&[1.0; 3]), None, "{name}");
    }
}
