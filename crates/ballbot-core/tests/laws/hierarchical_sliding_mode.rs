//! Hierarchical sliding mode.

use super::{CONTROL_DT, assert_poles, closed_loop, gain_of, made, pair, presets, robot};
use ballbot_core::control::{
    Controller, HierarchicalSlidingMode, LimitOptions, Setpoint, SlidingModeOptions, SlidingSurface,
};
use ballbot_core::models::LinearModel;
use ballbot_core::{ModelKind, Params, State};
use nalgebra::{Complex, DMatrix, Vector2};

/// d and c of d ÿ + c θ̈ = K θ, and K, from the masses; wheels turn with the body, too, at k + 1 times its rate.
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
    HierarchicalSlidingMode::new(params, CONTROL_DT).unwrap().surfaces()[0]
}

#[test]
fn poles_on_the_surface_are_the_designed_ones() {
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
fn surfaces_are_those_of_the_closed_form() {
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
fn surfaces_without_a_stable_motion_are_refused() {
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
        // So often that the sampling refuses nothing.
        assert_eq!(made(surface, 1e-4).is_ok(), slowest < 0.0, "{surface:?}: {slowest}");
    }
}

/// Slow enough a decay shows within a sample how S goes, outside of the layer and within.
#[test]
fn the_surface_is_reached() {
    let params = Params::paper();
    let dt = 1e-3;
    let options = SlidingModeOptions { max_lean: 1e3, max_speed: 1e3, ..Default::default() };
    let limits = LimitOptions { max_torque: None, traction: None };
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
            robot.step(&law.wheel_torques(&robot.state(), &Setpoint::default()), 1).unwrap();
            expected -= dt * expected * (rate + options.switching / expected.abs().max(options.layer));
            let found = s(&robot.state());
            let start = y.c2 * tilt;
            assert!((found - expected).abs() < tolerance * start, "{degrees} deg: S = {found}, expected {expected}");
        }
        assert!(expected < 0.1 * y.c2 * tilt);
    }
}
