//! The cascade of position and lean.

use super::{CONTROL_DT, assert_poles, closed_loop, gain_of, made, pair, position, presets, robot, run, uneven};
use ballbot_core::control::{CascadePid, CascadePidOptions, LimitOptions, NamedLaw};
use ballbot_core::kinematics::{Omniwheels, TorqueMap};
use ballbot_core::models::LinearModel;
use ballbot_core::{LaneState, ModelKind, Params, State, Wheels};
use nalgebra::{Complex, DMatrix, Vector3};

/// λ of a robot that is the same on all sides.
fn toppling(params: &Params) -> f64 {
    LinearModel::new(params).a[(8, 3)].sqrt()
}

/// No two poles coincide, which would cost half of the digits.
const APART: [(&str, &[f64]); 2] = [("lean_damping", &[0.9]), ("yaw_damping", &[0.7])];

#[test]
fn poles_match_the_design() {
    for (name, params) in presets() {
        let params = Params { ball_viscous_friction: 0.0, wheel_viscous_friction: 0.0, ..params };
        let [x, y, _] = params.body_inertia;
        let params = Params { body_inertia: [x.max(y), x.max(y), params.body_inertia[2]], ..params };
        let controller = made("cascade_pid", &params, &APART);
        let gain = gain_of(controller.as_ref(), &params);
        let rate = toppling(&params);
        // The integrals from differences of the memory: θ_ref is the lean that the law commands.
        let kept = integrals(&params, controller.as_ref());
        let closed = closed_loop(&params, &gain, &kept);
        let plane = [pair(1.5 * rate, 0.9), pair(0.25 * rate, 0.8)].concat();
        let plane = [plane, vec![Complex::from(-0.1 * rate)]].concat();
        let expected = [plane.clone(), plane, pair(4.0, 0.7).to_vec()].concat();
        println!("{name}");
        assert_poles(&closed, &expected, 1e-6 * rate);
    }
}

/// Rows of the derivatives of the two integrals.
fn integrals(params: &Params, controller: &dyn ballbot_core::control::Controller) -> DMatrix<f64> {
    const SMALL: f64 = 1e-5;
    let mut rows = DMatrix::zeros(2, 12);
    for j in [0, 1, 2, 3, 5, 6] {
        let mut x = [0.0; 10];
        x[j] = SMALL;
        let body = ballbot_core::attitude(nalgebra::Vector2::new(x[2], x[3]), x[4]);
        let mut state = State::rolling(params, nalgebra::Vector2::new(x[5], x[6]), 0.0, body, Vector3::zeros());
        state.ball_position += Vector3::new(x[0], x[1], 0.0);
        let mut kept = [0.0; 2];
        let setpoint = ballbot_core::control::Setpoint::default();
        controller.torques_one(&LaneState::from(&state), &(&setpoint).into(), f64::INFINITY, &mut kept);
        (0..2).for_each(|i| rows[(i, j)] = kept[i] / (SMALL * CONTROL_DT));
    }
    rows
}

/// The motors' torques are off by a constant.
#[test]
fn the_integral_removes_a_constant_torque() {
    let params = Params::paper();
    let bias = Omniwheels::new(&params).torques_on_body(&Vector3::new(0.01, 0.02, 0.0), TorqueMap::Consistent);
    let offset = |pole: f64| {
        let mut controller = made("cascade_pid", &params, &[("integral_bandwidth", &[pole])]);
        let mut robot = robot(&params, ModelKind::Spatial, &State::upright(&params));
        let biased = |_: &mut _, torques: &mut Wheels<f64>| *torques = *torques + bias;
        let end = run(&mut robot, controller.as_mut(), 30.0, position(0.0, 0.0), biased).unwrap().end;
        let gain = gain_of(controller.as_ref(), &params);
        let (held, bias) = (gain.columns(0, 2) * end.ball_position.xy(), bias.column());
        (end.ball_position.xy().norm(), (held - bias).norm() / bias.norm())
    };
    let ((with, _), (without, off)) = (offset(0.1), offset(0.0));
    println!("{:.3} mm, without the integral {:.1} mm", with * 1e3, without * 1e3);
    assert!(with < 1e-3, "{with} m");
    assert!(without > 0.01 && off < 1e-3, "{without} m, {off} from the closed form");
}

#[test]
fn loops_that_are_not_stable_are_rejected() {
    let rejected = |params: &Params, control_dt: f64, options: CascadePidOptions| {
        CascadePid::with_options(params, control_dt, &options, &LimitOptions::TRACTION).unwrap_err().to_string()
    };
    let fast = CascadePidOptions { lean_bandwidth: 50.0, ..Default::default() };
    let message = rejected(&Params::paper(), 0.01, fast);
    assert!(message.contains("control_dt = 0.01 s") && message.contains("it must be below 1"), "{message}");
    let slow = rejected(&uneven(), 0.3, CascadePidOptions::default());
    assert!(slow.contains("control_dt = 0.3 s"), "{slow}");
    let negative = CascadePidOptions { position_damping: -0.1, ..Default::default() };
    assert!(rejected(&Params::paper(), 0.01, negative).contains("position_damping = -0.1 is out of range"));
    for (_, params) in presets() {
        CascadePid::with_defaults(&params, 0.02).unwrap();
    }
}
