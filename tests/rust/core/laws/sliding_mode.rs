//! Sliding mode of the attitude.

use super::pd_inverse_dynamics::{UNLIMITED, attitude_error, strong, toppling};
use super::{CONTROL_DT, presets, scattered_states, uneven};
use ballbot_core::control::{
    AttitudeSlidingOptions, Controller, InverseDynamicsOptions, LimitOptions, NamedLaw, PdInverseDynamics, Setpoint,
    SlidingMode,
};
use ballbot_core::{Ballbot, ModelKind, Params, State, Wheels};
use nalgebra::Vector2;

/// Published tunings of the robot Kugle about the horizontal axes and the vertical: K, η, ε.
const PUBLISHED: [([f64; 3], [f64; 3]); 2] = [([15.0, 6.0, 0.5], [6.0, 3.0, 0.2]), ([6.0, 5.0, 0.8], [6.0, 6.0, 0.3])];

fn options([surface, switching, layer]: [f64; 3], [a, b, c]: [f64; 3], rate: f64) -> AttitudeSlidingOptions {
    AttitudeSlidingOptions {
        surface: surface / rate,
        switching: switching / (rate * rate),
        layer: layer / rate,
        yaw_surface: a,
        yaw_switching: b,
        yaw_layer: c,
        ..Default::default()
    }
}

/// ω² = K η/ε and 2ζω = K + η/ε, exactly and at any attitude.
#[test]
fn within_the_layer_it_is_computed_torque() {
    let params = strong(&uneven());
    let rate = toppling(&params);
    for ([k, eta, _], [yaw_k, yaw_eta, _]) in PUBLISHED {
        // A layer so wide that no state is beyond it, with the published ratio η/ε.
        let (reaching, yaw_reaching) = (eta / 0.5, yaw_eta / 0.2);
        let wide = options([k, reaching * 1e3, 1e3], [yaw_k, yaw_reaching * 1e3, 1e3], rate);
        let pair = |surface: f64, reaching: f64| {
            let frequency = (surface * reaching).sqrt();
            [frequency, 0.5 * (surface + reaching) / frequency]
        };
        let ([lean, damping], [yaw_bandwidth, yaw_damping]) = (pair(k, reaching), pair(yaw_k, yaw_reaching));
        let equal = InverseDynamicsOptions {
            lean_bandwidth: lean / rate,
            lean_damping: damping,
            yaw_bandwidth,
            yaw_damping,
            ..Default::default()
        };
        let mut sliding = SlidingMode::with_options(&params, CONTROL_DT, &wide, &UNLIMITED).unwrap();
        let mut computed = PdInverseDynamics::with_options(&params, CONTROL_DT, &equal, &UNLIMITED).unwrap();
        for state in scattered_states(&params) {
            let setpoint = Setpoint { yaw: 0.4, acceleration: Vector2::new(0.2, 0.1), ..Setpoint::default() };
            let expected = computed.wheel_torques(&state, &setpoint).column();
            let found = sliding.wheel_torques(&state, &setpoint).column();
            assert!((found - expected).amax() < 1e-9 * (1.0 + expected.amax()), "{found}, expected {expected}");
        }
    }
}

/// S = v̇ + K v decays by e^(−ηt/ε) within the layer and by η t outside.
#[test]
fn the_surface_is_reached() {
    let params = strong(&uneven());
    let rate = toppling(&params);
    let dt = 1e-4;
    let reference = AttitudeSlidingOptions { max_lean: 0.0, ..Default::default() };
    for (tilt, layer) in [(0.02, 0.16), (0.3, 0.16), (0.3, 0.02)] {
        let options = AttitudeSlidingOptions { layer, ..reference };
        let mut law = SlidingMode::with_options(&params, dt, &options, &UNLIMITED).unwrap();
        let start = State::tilted_from_equilibrium(&params, Vector2::new(0.6, -0.8) * tilt, 0.0);
        let mut robot = Ballbot::new(&params, ModelKind::Spatial, dt).unwrap();
        robot.reset(&start).unwrap();
        let s = |state: &State| {
            let [v, first, _] = attitude_error(&params, state, Wheels::default(), &Setpoint::default());
            (first + v * (1.8 * rate)).xy()
        };
        let first = s(&robot.state());
        let (switching, layer) = (0.24 * rate * rate, layer * rate);
        // Along its direction: at the rate η down to the layer, from there exponentially.
        let outside = ((first.norm() - layer) / switching).max(0.0);
        for step in 1..=4000 {
            robot.step(law.wheel_torques(&robot.state(), &Setpoint::default()), 1).unwrap();
            let time = f64::from(step) * dt;
            let length = if time < outside {
                first.norm() - switching * time
            } else {
                first.norm().min(layer) * (-(time - outside) * switching / layer).exp()
            };
            let found = s(&robot.state());
            let off = (found - first.normalize() * length).norm() / first.norm();
            assert!(off < 3e-3, "{tilt} rad, {time} s: {found}, expected a length of {length}");
        }
    }
}

/// The tunings of Kugle, which ran at 200 Hz, on Kugle, and scaled by λ on the other robots.
#[test]
fn published_tunings_are_stable() {
    let kugle = toppling(&Params::preset("kugle").unwrap());
    for (name, params) in presets() {
        for (lean, yaw) in PUBLISHED {
            let tuned = options(lean, yaw, kugle);
            for dt in [0.005, 0.01] {
                let made = SlidingMode::with_options(&params, dt, &tuned, &LimitOptions::TRACTION);
                assert!(made.is_ok(), "{name}, {dt} s: {made:?}");
            }
        }
        SlidingMode::with_defaults(&params, 0.02).unwrap();
    }
    let thin = AttitudeSlidingOptions { layer: 1e-4, ..Default::default() };
    let message = SlidingMode::with_options(&Params::paper(), CONTROL_DT, &thin, &LimitOptions::TRACTION).unwrap_err();
    assert!(message.to_string().contains("it must be below 1"), "{message}");
}
