//! The double loop of wheel rates and state.

use super::{CONTROL_DT, made, position, presets, robot, run};
use ballbot_core::control::{Controller, LimitOptions, LqrPi, LqrPiOptions, NamedLaw, Setpoint};
use ballbot_core::kinematics::{Omniwheels, TorqueMap};
use ballbot_core::models::LinearModel;
use ballbot_core::{LaneState, ModelKind, Params, State};
use nalgebra::{Complex, DMatrix, Vector2, Vector3};

/// |L(iω)| of the PI on the rate of the virtual wheel, with the linear model.
fn open_loop(params: &Params, law: &LqrPi, axis: usize, frequency: f64) -> f64 {
    let LinearModel { a, b } = LinearModel::new(params);
    let s = Complex::new(0.0, frequency);
    // A torque that accelerates only the lean of this plane.
    let turning: nalgebra::Matrix3<f64> = b.fixed_view::<3, 3>(7, 0).into_owned();
    let acceleration = if axis == 0 { Vector3::y() } else { -Vector3::x() };
    let torque = turning.try_inverse().unwrap() * acceleration;
    let driven = DMatrix::from_fn(10, 1, |i, _| Complex::from((b * torque)[i]));
    let plant = DMatrix::from_fn(10, 10, |i, j| if i == j { s } else { Complex::from(0.0) } - a[(i, j)]);
    let x = plant.lu().solve(&driven).unwrap();
    let (velocity, rate) = if axis == 0 { (x[5], x[8]) } else { (x[6], -x[7]) };
    let [per_speed, per_rate] = law.wheel_rates()[axis];
    let [proportional, integral] = law.inner_gains()[axis];
    ((velocity * per_speed + rate * per_rate) * (Complex::from(integral) / s + proportional)).norm()
}

/// Where the loop gain falls below 1.
fn crossover(gain: impl Fn(f64) -> f64) -> f64 {
    let found: Vec<_> = (1..4000).map(|k| 0.05 * f64::from(k)).filter(|&w| gain(w) > 1.0).collect();
    *found.last().unwrap()
}

#[test]
fn the_inner_loop_has_its_crossover() {
    for (name, params) in presets() {
        let law = LqrPi::with_defaults(&params, CONTROL_DT).unwrap();
        for axis in 0..2 {
            let desired = 4.1 * LinearModel::new(&params).a[if axis == 0 { (8, 3) } else { (7, 2) }].sqrt();
            let found = crossover(|w| open_loop(&params, &law, axis, w));
            println!("{name}: crossover {found:.2} rad/s, designed {desired:.2}");
            assert!((found / desired - 1.0).abs() < 0.1, "{name}: {found}, designed {desired}");
            assert!(name != "paper" || (found / 25.0 - 1.0).abs() < 0.1, "{found}");
        }
    }
}

/// Gains (y, θ, ẏ, θ̇, ξ) of an independent computation in one plane, with the PI 0.10 N·m·s and 0.60 N·m at the virtual wheel.
#[test]
fn outer_gains_match_an_independent_computation() {
    let params = Params::paper();
    // Acceleration of the lean per torque of the virtual wheel in that computation, rad/s² per N·m.
    const PER_TORQUE: f64 = 42.845;
    let toppling = LinearModel::new(&params).a[(8, 3)].sqrt();
    let [per_unit, _] = LqrPi::with_defaults(&params, CONTROL_DT).unwrap().inner_gains()[0];
    let mut options = LqrPiOptions::default();
    options.loops.wheel_bandwidth *= 0.10 * PER_TORQUE / per_unit.abs();
    options.loops.wheel_integral = 6.0 / toppling;
    let law = LqrPi::with_options(&params, CONTROL_DT, &options, &LimitOptions::TRACTION).unwrap();
    let [x, y] = law.outer_gains();
    println!("{x:?}");
    for (found, expected) in x.into_iter().zip([-53.05, -130.55, -84.03, -20.41, 5.640]) {
        assert!((found / expected - 1.0).abs() < 1e-3, "{x:?}: {found}, expected {expected}");
    }
    for (x, y) in x.into_iter().zip(y) {
        assert!((x - y).abs() < 1e-6 * x.abs(), "{x}, {y}");
    }
}

/// A load on the motors: the integral takes it over, and no error of the wheel rates remains.
#[test]
fn a_constant_load_torque_leaves_no_error_of_the_wheel_rates() {
    let params = Params::paper();
    let load = Omniwheels::new(&params).torques_on_body(&Vector3::new(0.01, 0.02, 0.0), TorqueMap::Consistent);
    let mut robot = robot(&params, ModelKind::Spatial, &State::upright(&params));
    let mut law = LqrPi::with_defaults(&params, CONTROL_DT).unwrap();
    let mut kept = [0.0; 2];
    let mut before = kept;
    for _ in 0..3000 {
        let state = LaneState::from(&robot.state());
        before = kept;
        let torques = law.torques_one(&state, &(&Setpoint::default()).into(), f64::INFINITY, &mut kept);
        let loaded: [f64; 3] = std::array::from_fn(|i| torques[i] - load[i]);
        robot.step(loaded, super::STEPS).unwrap();
    }
    let errors = [0, 1].map(|axis| (kept[axis] - before[axis]) / CONTROL_DT);
    println!("errors {errors:?} rad/s, integrals {kept:?}, {:?} m off", robot.state().ball_position.xy());
    assert!(errors.iter().all(|error| error.abs() < 1e-6), "{errors:?}");
    assert!(kept.iter().all(|integral| integral.abs() > 1e-3), "{kept:?}");
    let torques = law.wheel_torques(&robot.state(), &Setpoint::default());
    assert!(torques.iter().any(|torque| torque.abs() > 1e-4));
}

/// Largest distance from the mean position of a robot in the last ten seconds, m.
fn limit_cycle(name: &str, params: &Params) -> (f64, f64) {
    let start = State::tilted(params, Vector2::new(0.02, 0.01), 0.0);
    let mut robot = robot(params, ModelKind::Contact, &start);
    let mut controller = made(name, params, &[]);
    run(&mut robot, controller.as_mut(), 20.0, position(0.0, 0.0), |_, _| ()).expect(name);
    let mut places = Vec::new();
    let mut tilt = 0.0_f64;
    for _ in 0..1000 {
        run(&mut robot, controller.as_mut(), CONTROL_DT, position(0.0, 0.0), |_, _| ()).expect(name);
        places.push(robot.state().ball_position.xy());
        tilt = tilt.max(robot.state().tilt());
    }
    let middle = places.iter().sum::<Vector2<f64>>() / places.len() as f64;
    (places.iter().map(|place| (place - middle).norm()).fold(0.0, f64::max), tilt)
}

#[test]
fn dry_friction_moves_the_robot_less_than_the_regulator_does() {
    let params = Params { wheel_coulomb_friction: 0.1, ..Params::preset("asroballet").unwrap() };
    let [regulator, double] = ["lqr", "lqr_pi"].map(|name| limit_cycle(name, &params));
    println!("lqr {regulator:?}, lqr_pi {double:?} (m, rad)");
    assert!(double.0 < 0.5 * regulator.0, "{double:?}, regulator {regulator:?}");
}
