//! Hierarchical sliding mode.

use super::{
    CONTROL_DT, assert_poles, closed_loop, gain_of, lanes_equal_one_robot, made, pair, position, presets, robot, run,
};
use ballbot_core::control::{
    Controller, HierarchicalSlidingMode, LaneSetpoint, LimitOptions, NamedLaw, Setpoint, SlidingModeOptions,
    SlidingSurface,
};
use ballbot_core::kinematics::{Omniwheels, TorqueMap};
use ballbot_core::models::LinearModel;
use ballbot_core::{LaneState, ModelKind, Params, State, Wheels};
use nalgebra::{Complex, DMatrix, Vector2, Vector3};

/// d and c of d ÿ + c θ̈ = K θ, and K, from the masses; wheels also turn with the body, at k + 1 times its rate.
fn unactuated(params: &Params) -> [f64; 3] {
    let p = params;
    let (k, wheel) = (p.gear_ratio(), 1.5 * p.wheel_zenith.cos().powi(2) * p.wheel_inertia);
    let arm = p.body_mass * p.body_com_height;
    let m11 = p.ball_inertia / p.ball_radius.powi(2) + wheel / p.wheel_radius.powi(2) + p.ball_mass + p.body_mass;
    let m12 = arm - wheel * (k + 1.0) / p.wheel_radius;
    let m22 = p.body_inertia[1] + arm * p.body_com_height + wheel * (k + 1.0).powi(2);
    [m12 + p.ball_radius * m11, m22 + p.ball_radius * m12, arm * p.gravity]
}

fn surface(params: &Params) -> SlidingSurface {
    HierarchicalSlidingMode::with_defaults(params, CONTROL_DT).unwrap().surfaces()[0]
}

#[test]
fn poles_on_the_surface_match_the_design() {
    for (_, params) in presets() {
        let params = Params { ball_viscous_friction: 0.0, wheel_viscous_friction: 0.0, ..params };
        let [x, y, _] = params.body_inertia;
        let params = Params { body_inertia: [x.max(y), x.max(y), params.body_inertia[2]], ..params };
        let controller = made("hierarchical_sliding_mode", &params, &[("yaw_damping", &[0.7])]);
        let gain = gain_of(controller.as_ref(), &params);
        let rate = LinearModel::new(&params).a[(8, 3)].sqrt();
        // S decays by K_S + η/φ within the layer.
        let plane = [pair(0.25 * rate, 0.8).to_vec(), vec![(-0.8 * rate).into(), (-1.3 * rate - 5.0).into()]].concat();
        let expected: Vec<Complex<f64>> = [plane.clone(), plane, pair(4.0, 0.7).to_vec()].concat();
        assert_poles(&closed_loop(&params, &gain, &DMatrix::zeros(0, 10)), &expected, 1e-6 * rate);
    }
}

#[test]
fn surfaces_match_the_closed_form() {
    let params = Params::paper();
    let [d, c, weight] = unactuated(&params);
    assert!((d - 0.82462).abs() < 1e-4 && (c - 0.13902).abs() < 1e-4 && (weight - 3.10365).abs() < 1e-4);
    // Poles −1.2 ± 0.9i and −5.
    let rate = LinearModel::new(&params).a[(8, 3)].sqrt();
    let options = SlidingModeOptions {
        pair_bandwidth: 1.5 / rate,
        pair_damping: 0.8,
        real_pole: 5.0 / rate,
        ..Default::default()
    };
    let law = HierarchicalSlidingMode::with_options(&params, CONTROL_DT, &options, &LimitOptions::TRACTION).unwrap();
    let found = law.surfaces()[0];
    let [p2, p1, p0] = [7.4, 14.25, 11.25];
    let alpha = p1 * d / (weight + p1 * c);
    let c1 = p0 / p1;
    let c2 = (p2 * (d - alpha * c) + alpha * c1 * c) / d;
    for (found, expected, published) in [(found.alpha, alpha, 2.311), (found.c1, c1, 0.789), (found.c2, c2, 4.824)] {
        assert!((found / expected - 1.0).abs() < 1e-9, "{found}, expected {expected}");
        assert!((found - published).abs() < 1e-3, "{found}, expected {published}");
    }
}

/// The cubic of the surface is stable where the constructor accepts it, and only there.
#[test]
fn surfaces_without_a_stable_motion_are_rejected() {
    let params = Params::paper();
    let [d, c, weight] = unactuated(&params);
    let options = SlidingModeOptions::default();
    let made = |surface: SlidingSurface, control_dt: f64| {
        HierarchicalSlidingMode::with_surfaces(&params, control_dt, [surface; 2], &options, &LimitOptions::TRACTION)
    };
    let good = surface(&params);
    for (bad, words) in [
        (SlidingSurface { alpha: -0.1, ..good }, "alpha = -0.1 rad/m"),
        (SlidingSurface { alpha: 0.0, ..good }, "alpha = 0 rad/m"),
        (SlidingSurface { alpha: 6.0, ..good }, "0 < alpha < 5.93"),
        (SlidingSurface { c1: 0.0, ..good }, "c1 = 0 1/s"),
        (SlidingSurface { c1: 5.0, c2: 5.0, ..good }, "c1 = 5 1/s, c2 = 5 1/s: it needs"),
        (SlidingSurface { alpha: f64::NAN, ..good }, "alpha = NaN"),
    ] {
        let message = made(bad, CONTROL_DT).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
    }
    for k in 0..300 {
        let wave = |part: usize| (1.0 + k as f64 * 1.7 + part as f64 * 4.1).sin();
        let surface = SlidingSurface { alpha: 3.0 + 5.0 * wave(0), c1: 2.0 + 3.0 * wave(1), c2: 3.0 + 4.0 * wave(2) };
        let SlidingSurface { alpha, c1, c2 } = surface;
        let cubic = [d - alpha * c, c2 * d - alpha * c1 * c, alpha * weight, alpha * c1 * weight];
        let [p2, p1, p0] = [cubic[1], cubic[2], cubic[3]].map(|p| p / cubic[0]);
        let companion = DMatrix::from_row_slice(3, 3, &[-p2, -p1, -p0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        let slowest = companion.complex_eigenvalues().iter().map(|pole| pole.re).fold(f64::NEG_INFINITY, f64::max);
        // Sampled so often that nothing is rejected.
        assert_eq!(made(surface, 1e-4).is_ok(), slowest < 0.0, "{surface:?}: {slowest}");
    }
}

/// A slow enough decay shows within a sample how S evolves, outside and inside the layer.
#[test]
fn the_surface_is_reached() {
    let params = Params::paper();
    let dt = 1e-3;
    let options = SlidingModeOptions { max_lean: 1e3, max_speed: 1e3, ..Default::default() };
    let limits = LimitOptions { traction: None, ..LimitOptions::CAP };
    for (degrees, tolerance) in [(0.2, 0.01), (6.0, 0.05)] {
        let mut law = HierarchicalSlidingMode::with_options(&params, dt, &options, &limits).unwrap();
        let [_, y] = law.surfaces();
        let rate = 1.3 * LinearModel::new(&params).a[(8, 3)].sqrt();
        let tilt = f64::to_radians(degrees);
        let mut robot = robot(&params, ModelKind::Spatial, &State::tilted(&params, Vector2::new(-tilt, 0.0), 0.0));
        let s = |state: &State| {
            let moving = y.c1 * state.ball_position.y + state.ball_velocity.y;
            y.alpha * moving - y.c2 * state.tilt_components()[0] - state.body_angular_velocity.x
        };
        let mut expected = s(&robot.state());
        for _ in 0..300 {
            robot.step(law.wheel_torques(&robot.state(), &Setpoint::default()), 1).unwrap();
            expected -= dt * expected * (rate + options.switching / expected.abs().max(options.layer));
            let found = s(&robot.state());
            let start = y.c2 * tilt;
            assert!((found - expected).abs() < tolerance * start, "{degrees} deg: S = {found}, expected {expected}");
        }
        assert!(expected < 0.1 * y.c2 * tilt);
    }
}

/// A thin layer, in which the gain of the default would be far below a disturbance.
const ADAPTIVE: [(&str, &[f64]); 5] = [
    ("switching", &[0.25]),
    ("layer", &[0.05]),
    ("adaptation", &[50.0]),
    ("leakage", &[1.0]),
    ("max_switching", &[3.0]),
];

/// Where a robot comes to rest under constant torques about an axis that its law does not model, N·m, and the memory of
/// the law.
fn pushed(options: &[(&str, &[f64])], torque: f64) -> (f64, Vec<f64>) {
    let params = Params::paper();
    let wheels = Omniwheels::new(&params).torques_on_body(&(Vector3::y() * torque), TorqueMap::Consistent);
    let law = made("hierarchical_sliding_mode", &params, options);
    let mut robot = robot(&params, ModelKind::Contact, &State::upright(&params));
    let (setpoint, mut memory) = (LaneSetpoint::from(&Setpoint::default()), vec![0.0; law.memory_len()]);
    for _ in 0..2000 {
        let torques = law.torques_one(&LaneState::from(&robot.state()), &setpoint, f64::INFINITY, &mut memory);
        robot.step(torques + wheels, 10).unwrap();
    }
    assert!(robot.state().tilt() < 1e-3 && robot.state().ball_velocity.norm() < 1e-3);
    (robot.state().ball_position.x, memory)
}

/// At rest S = α c₁ y, and Ṡ = 0 = −K_S S − η − η̂ + d outside the layer, η̂ = (γ/σ)(|S| − φ).
#[test]
fn the_adapted_gain_is_the_closed_form_and_bounded() {
    let params = Params::paper();
    let [d, c, _] = unactuated(&params);
    let linear = LinearModel::new(&params);
    let reaching = 1.3 * linear.a[(8, 3)].sqrt();
    let SlidingSurface { alpha, c1, .. } = surface(&params);
    let surface_of = |torque: f64| {
        let wheels = Omniwheels::new(&params).torques_on_body(&(Vector3::y() * torque), TorqueMap::Consistent);
        ((linear.b * wheels.column())[8] * (1.0 - alpha * c / d)).abs()
    };
    for torque in [0.08, -0.1] {
        let pushing = surface_of(torque);
        let expected = (pushing - 0.25 + 50.0 * 0.05) / (reaching + 50.0);
        assert!(expected > 0.06, "outside of the layer");
        let (place, memory) = pushed(&ADAPTIVE, torque);
        let found = alpha * c1 * place.abs();
        println!("{torque} N·m: S = {found:.4}, expected {expected:.4}, {:.1} mm, {memory:?}", place * 1e3);
        assert!((found / expected - 1.0).abs() < 0.01, "S = {found}, expected {expected}");
        assert!((memory[0] - 50.0 * (expected - 0.05)).abs() < 0.02 * memory[0], "{memory:?}");
        // Without the adaptation the robot is farther off, at (d − η)/K_S.
        let off = pushed(&ADAPTIVE[..2], torque).0;
        println!("without the adaptation {:.1} mm", off * 1e3);
        let fixed = alpha * c1 * off.abs();
        assert!((fixed / ((pushing - 0.25) / reaching) - 1.0).abs() < 0.02 && fixed > 2.5 * found, "S = {fixed}");
    }
    let (_, memory) = pushed(&ADAPTIVE, 0.17);
    assert_eq!(memory, [2.75], "cut to `max_switching`");
    lanes_equal_one_robot("hierarchical_sliding_mode", &ADAPTIVE);
}

/// A fixed gain that leaves the same offset always has the noise in its torques that the adapted gain has only under a
/// disturbance.
#[test]
fn an_adapted_gain_chatters_less_than_the_fixed_gain_that_it_replaces() {
    let params = Params::paper();
    let (place, memory) = pushed(&ADAPTIVE, 0.1);
    let needed = 0.25 + memory[0];
    let fixed: [(&str, &[f64]); 2] = [("switching", &[needed]), ("layer", &[0.05])];
    let same = pushed(&fixed, 0.1).0;
    assert!((same / place - 1.0).abs() < 0.02, "{same} m, {place} m");
    let chatter = |options: &[(&str, &[f64])]| {
        let law = made("hierarchical_sliding_mode", &params, options);
        let mut robot = robot(&params, ModelKind::Contact, &State::upright(&params));
        let (setpoint, mut memory) = (LaneSetpoint::from(&Setpoint::default()), vec![0.0; law.memory_len()]);
        let (mut last, mut sum) = (Wheels::default(), 0.0_f64);
        for k in 0..1000 {
            let mut seen = robot.state();
            let noise = |i: f64| 0.02 * ((1e4 * (0.7 + f64::from(k) * 1.3 + i).sin()).fract());
            seen.body_angular_velocity += Vector3::new(noise(0.1), noise(0.2), 0.0);
            let torques = law.torques_one(&LaneState::from(&seen), &setpoint, f64::INFINITY, &mut memory);
            robot.step(torques, 10).unwrap();
            sum += (torques - last).column().norm_squared();
            last = torques;
        }
        (sum / 1000.0).sqrt()
    };
    let (adapted, fixed) = (chatter(&ADAPTIVE), chatter(&fixed));
    println!("η = {needed:.2} rad/s²: torque from sample to sample {adapted:.4} and {fixed:.4} N·m");
    assert!(adapted < 0.6 * fixed, "{adapted} N·m, fixed {fixed} N·m");
}

#[test]
fn limited_torques_do_not_raise_the_gain() {
    let params = Params::paper();
    let law = made("hierarchical_sliding_mode", &params, &ADAPTIVE);
    let setpoint = LaneSetpoint::from(&Setpoint::default());
    let tilted = LaneState::from(&State::tilted(&params, Vector2::new(0.1, 0.0), 0.0));
    let mut memory = [0.0];
    law.torques_one(&tilted, &setpoint, 1e-3, &mut memory);
    assert_eq!(memory, [0.0]);
    law.torques_one(&tilted, &setpoint, f64::INFINITY, &mut memory);
    let raised = memory[0];
    assert!(raised > 0.0);
    law.torques_one(&LaneState::from(&State::upright(&params)), &setpoint, f64::INFINITY, &mut memory);
    assert!((memory[0] / raised - (-CONTROL_DT).exp()).abs() < 1e-12, "it leaks");
    // The sampled loop must be stable at the largest gain.
    let kind = ballbot_core::control::controller_kind("hierarchical_sliding_mode").unwrap();
    let most: [(&str, &[f64]); 2] = [("adaptation", &[1.0]), ("max_switching", &[100.0])];
    assert!((kind.make)(&params, CONTROL_DT, &kind.limits, &most).is_err());
    // Options that change nothing are rejected.
    let rejected = |options: &[(&str, &[f64])], words: &str| {
        let error = (kind.make)(&params, CONTROL_DT, &kind.limits, options).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    rejected(&most[1..], "max_switching = 100 changes nothing with adaptation = 0");
    rejected(&[("leakage", &[0.5])], "leakage = 0.5 changes nothing with adaptation = 0");
    rejected(&[("adaptation", &[1.0]), ("max_switching", &[1.0])], "max_switching = 1 is out of range");
    let start = State::tilted(&params, Vector2::new(0.4, 0.1), 0.0);
    let mut robot = robot(&params, ModelKind::Contact, &start);
    let mut law = made("hierarchical_sliding_mode", &params, &ADAPTIVE[2..]);
    assert!(run(&mut robot, law.as_mut(), 6.0, position(0.0, 0.0), |_, _| ()).unwrap().end.tilt() < 0.01);
}
