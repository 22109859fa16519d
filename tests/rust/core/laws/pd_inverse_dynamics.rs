//! Computed torque on the attitude.

use super::{
    CONTROL_DT, assert_poles, closed_loop, gain_of, law, made, pair, presets, robot, scattered_states, uneven,
};
use ballbot_core::control::{
    Controller, InverseDynamicsOptions, LimitOptions, NamedLaw, PdInverseDynamics, Setpoint, controller_kind,
};
use ballbot_core::models::{BallSpin, LinearModel, SpatialModel, WheelSpin};
use ballbot_core::{Ballbot, ModelKind, Params, State, Wheels, attitude};
use nalgebra::{Complex, DMatrix, Quaternion, Vector2, Vector3, Vector6};

/// λ, the mean of both planes.
pub fn toppling(params: &Params) -> f64 {
    let LinearModel { a, .. } = LinearModel::new(params);
    0.5 * (a[(8, 3)].sqrt() + a[(7, 2)].sqrt())
}

/// A robot with unlimited motors, and a law without a limit.
pub fn strong(params: &Params) -> Params {
    Params { max_wheel_torque: 1e3, ..params.clone() }
}

pub const UNLIMITED: LimitOptions = LimitOptions::capped(1e3);

/// v = vec(q_e), v̇ and v̈ under the torques, for a reference at rest.
pub fn attitude_error(params: &Params, state: &State, torques: Wheels<f64>, setpoint: &Setpoint) -> [Vector3<f64>; 3] {
    let to_balance = params.to_balance_frame();
    let rate = state.body_angular_velocity;
    let (v, spin) = (state.ball_velocity, state.ball_angular_velocity.z);
    let velocity = Vector6::new(v.x, v.y, rate.x, rate.y, rate.z, spin);
    let model = SpatialModel::new(params, WheelSpin::Absolute, BallSpin::Free);
    let change = model.accelerations(&state.body_quaternion, &velocity, torques);
    let part = |v: Vector3<f64>| Quaternion::from_imag(to_balance * v);
    let (rate, change) = (part(rate), part(change.fixed_rows::<3>(2).into_owned()));
    // The plane of x leans in proportion to the acceleration; this is for robots that are the same on all sides.
    let lean = setpoint.acceleration / acceleration_per_lean(params);
    let reference = attitude(Vector2::new(-lean.y, lean.x), setpoint.yaw);
    let error = (reference.inverse() * (state.body_quaternion * to_balance.inverse())).into_inner();
    let error = if error.w < 0.0 { -error } else { error };
    let first = error * rate * 0.5;
    let second = (first * rate + error * change) * 0.5;
    [error, first, second].map(|q| q.imag())
}

/// g of z̈ = g θ.
fn acceleration_per_lean(params: &Params) -> f64 {
    let LinearModel { a, b } = LinearModel::new(params);
    let turning = b.fixed_view::<3, 3>(7, 0).try_inverse().unwrap();
    let lever = -(b.fixed_view::<1, 3>(5, 0) * turning)[1];
    a[(5, 3)] + lever * a[(8, 3)]
}

#[test]
fn poles_match_the_design() {
    for (name, params) in presets() {
        let params = Params { ball_viscous_friction: 0.0, wheel_viscous_friction: 0.0, ..params };
        let [x, y, _] = params.body_inertia;
        let params = Params { body_inertia: [x.max(y), x.max(y), params.body_inertia[2]], ..params };
        let gain = gain_of(made("pd_inverse_dynamics", &params, &[("yaw_damping", &[0.7])]).as_ref(), &params);
        let rate = toppling(&params);
        let (lean, position) = ([3.2 * rate, 2.56 * rate * rate], [0.4 * rate, 0.0625 * rate * rate]);
        // The two poles of the lean that remain with the position loop.
        let sum = lean[0] - position[0];
        let product = lean[1] - position[0] * sum - position[1];
        let root = Complex::from(0.25 * sum * sum - product).sqrt();
        let others = [-root - 0.5 * sum, root - 0.5 * sum].to_vec();
        let plane = [pair(0.25 * rate, 0.8).to_vec(), others].concat();
        let expected = [plane.clone(), plane, pair(4.0, 0.7).to_vec()].concat();
        println!("{name}");
        assert_poles(&closed_loop(&params, &gain, &DMatrix::zeros(0, 10)), &expected, 1e-6 * rate);
    }
}

/// In the equations of the spatial model, in states from calm to wild.
#[test]
fn the_attitude_error_obeys_a_linear_equation() {
    let turned = Setpoint { yaw: 0.15, ..Setpoint::default() };
    let leaning = Setpoint { acceleration: Vector2::new(0.3, -0.5), ..turned };
    let drag = Params { ball_viscous_friction: 0.5, wheel_viscous_friction: 1e-3, ..Params::paper() };
    let [x, y, z] = Params::paper().body_inertia;
    let round = Params { body_inertia: [x.max(y), x.max(y), z], ..Params::paper() };
    for (params, setpoint) in [(drag, turned), (uneven(), turned), (round, leaning)] {
        let params = strong(&params);
        let options = InverseDynamicsOptions { max_lean: 0.0, lean_damping: 0.9, ..Default::default() };
        let mut law = PdInverseDynamics::with_options(&params, CONTROL_DT, &options, &UNLIMITED).unwrap();
        let frequency = 1.6 * toppling(&params);
        let (damping, stiffness) = (
            Vector3::new(1.8 * frequency, 1.8 * frequency, 8.0),
            Vector3::new(frequency * frequency, frequency * frequency, 16.0),
        );
        let mut checked = 0;
        for state in scattered_states(&params) {
            let torques = law.wheel_torques(&state, &setpoint);
            let [v, first, second] = attitude_error(&params, &state, torques, &setpoint);
            // Beyond that, the law follows a nearer heading.
            if state.tilt() > 0.8 || (state.yaw() - setpoint.yaw).abs() > 0.19 {
                continue;
            }
            checked += 1;
            let expected = -damping.component_mul(&first) - stiffness.component_mul(&v);
            let size = 1.0 + expected.amax();
            assert!((second - expected).amax() < 1e-9 * size, "{second}, expected {expected}");
        }
        assert!(checked > 50, "{checked}");
    }
}

/// The error in simulation, extrapolated to a sampling time of zero.
#[test]
fn the_attitude_follows_its_equation_in_simulation() {
    let params = strong(&uneven());
    let options = InverseDynamicsOptions { max_lean: 0.0, ..Default::default() };
    let frequency = 1.6 * toppling(&params);
    let after = 0.2;
    let start = State::tilted_from_equilibrium(&params, Vector2::new(0.2, -0.1), 0.1);
    let first = attitude_error(&params, &start, Wheels::default(), &Setpoint::default())[0];
    let left = |dt: f64| {
        let mut law = PdInverseDynamics::with_options(&params, dt, &options, &UNLIMITED).unwrap();
        let mut robot = Ballbot::new(&params, ModelKind::Spatial, dt).unwrap();
        robot.reset(&start).unwrap();
        for _ in 0..(after / dt).round() as usize {
            robot.step(law.wheel_torques(&robot.state(), &Setpoint::default()), 1).unwrap();
        }
        attitude_error(&params, &robot.state(), Wheels::default(), &Setpoint::default())[0]
    };
    let [one, two, three] = [4e-4, 2e-4, 1e-4].map(left);
    // Errors of first and second order in the sampling time.
    let found = (three * 8.0 - two * 6.0 + one) / 3.0;
    let critical = |rate: f64| (1.0 + rate * after) * (-rate * after).exp();
    let expected = first.component_mul(&Vector3::new(critical(frequency), critical(frequency), critical(4.0)));
    println!("{} off at 0.1 ms, {} extrapolated", (three - expected).amax(), (found - expected).amax());
    assert!((found - expected).amax() < 1e-8, "{found}, expected {expected}");
    assert!((three - expected).amax() > 1e-5, "the sampling time matters");
}

/// The lean, and the torques, of a motion with acceleration, jerk and snap are fed forward: no deviation remains.
#[test]
fn a_motion_is_fed_forward() {
    let params = Params::paper();
    let kinds = ["lqr", "pd_inverse_dynamics", "sliding_mode"];
    for name in kinds {
        assert!(controller_kind(name).unwrap().parts.contains(&"snap"));
        let mut robot = robot(&params, ModelKind::Spatial, &State::upright(&params));
        let mut controller = law(name, &params);
        // z moves by one meter in four seconds, along a polynomial of ninth degree.
        let (duration, mut off) = (4.0_f64, 0.0_f64);
        let derivative = |order: usize, s: f64| {
            [(5, 126.0), (6, -420.0), (7, 540.0), (8, -315.0), (9, 70.0)]
                .map(|(power, factor)| {
                    let falling: f64 = (0..order).map(|k| f64::from(power) - k as f64).product();
                    factor * falling * s.powi(power - order as i32)
                })
                .iter()
                .sum::<f64>()
                / duration.powi(order as i32)
        };
        let lever = {
            let LinearModel { a, .. } = LinearModel::new(&params);
            (acceleration_per_lean(&params) - a[(5, 3)]) / a[(8, 3)]
        };
        let lean = |order: usize, s: f64| derivative(order + 2, s) / acceleration_per_lean(&params);
        for step in 0..400 {
            let s = f64::from(step) * CONTROL_DT / duration;
            let along = |value: f64| Vector2::new(0.8, 0.6) * value;
            let setpoint = Setpoint {
                position: along(derivative(0, s) - lever * lean(0, s)),
                velocity: along(derivative(1, s) - lever * lean(1, s)),
                acceleration: along(derivative(2, s)),
                jerk: along(derivative(3, s)),
                snap: along(derivative(4, s)),
                ..Setpoint::default()
            };
            off = off.max((robot.state().ball_position.xy() - setpoint.position).norm());
            robot.step(controller.wheel_torques(&robot.state(), &setpoint), 10).unwrap();
        }
        println!("{name}: {:.2} mm", off * 1e3);
        assert!(off < 2e-3, "{name}: {off} m");
    }
}

#[test]
fn loops_that_are_not_stable_are_rejected() {
    let rejected = |params: &Params, control_dt: f64, options: InverseDynamicsOptions| {
        let made = PdInverseDynamics::with_options(params, control_dt, &options, &LimitOptions::TRACTION);
        made.unwrap_err().to_string()
    };
    let fast = InverseDynamicsOptions { lean_bandwidth: 50.0, ..Default::default() };
    let message = rejected(&Params::paper(), 0.01, fast);
    assert!(message.contains("control_dt = 0.01 s") && message.contains("it must be below 1"), "{message}");
    let slow = rejected(&uneven(), 0.5, InverseDynamicsOptions::default());
    assert!(slow.contains("control_dt = 0.5 s"), "{slow}");
    let negative = InverseDynamicsOptions { position_damping: -0.1, ..Default::default() };
    assert!(rejected(&Params::paper(), 0.01, negative).contains("position_damping = -0.1 is out of range"));
}
