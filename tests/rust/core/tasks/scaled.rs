//! Defaults of tasks that follow from the robot.

use super::{config, run_of};
use ballbot_core::Params;
use ballbot_core::models::Scale;

/// The paper's robot in another size, of the same materials: lengths times `size`.
fn similar(size: f64) -> Params {
    let paper = Params::paper();
    let inertia = size.powi(5);
    Params {
        ball_mass: paper.ball_mass * size.powi(3),
        ball_inertia: paper.ball_inertia * inertia,
        ball_radius: paper.ball_radius * size,
        body_mass: paper.body_mass * size.powi(3),
        body_inertia: paper.body_inertia.map(|value| value * inertia),
        body_com_height: paper.body_com_height * size,
        wheel_mass: paper.wheel_mass * size.powi(3),
        wheel_inertia: paper.wheel_inertia * inertia,
        wheel_radius: paper.wheel_radius * size,
        max_wheel_torque: paper.max_wheel_torque * size.powi(4),
        ..paper
    }
}

#[test]
fn a_robot_of_another_size_has_the_froude_scale() {
    let close = |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 1e-12, "{found}, {expected}");
    for size in [0.1_f64, 0.5, 1.0, 3.0, 20.0] {
        let scale = Scale::of(&similar(size));
        for (unit, power) in [
            ("m", 1.0),
            ("s", 0.5),
            ("m/s", 0.5),
            ("m/s²", 0.0),
            ("rad/s", -0.5),
            ("1/s", -0.5),
            ("N·m", 4.0),
            ("", 0.0),
        ] {
            close(scale.factor(unit).unwrap(), size.powf(power));
        }
        // The loads of the wheels are from a linear system.
        assert!((scale.factor("rad").unwrap() - 1.0).abs() < 1e-9);
    }
    let moon = Params { gravity: 1.62, ..Params::paper() };
    close(Scale::of(&moon).factor("m").unwrap(), 1.0);
    close(Scale::of(&moon).factor("s").unwrap(), (9.81_f64 / 1.62).sqrt());
    close(Scale::of(&moon).factor("N·m").unwrap(), 1.62 / 9.81);
}

#[test]
fn leans_follow_traction_and_motors() {
    let lean = |params: &Params| Scale::of(params).factor("rad").unwrap();
    let slippery = Params { wheel_dynamic_friction: 0.5, wheel_static_friction: 0.5, ..Params::paper() };
    assert!(lean(&slippery) > 0.3 && lean(&slippery) < 0.8, "{}", lean(&slippery));
    let weak = Params { max_wheel_torque: 0.1, ..Params::paper() };
    let weaker = Params { max_wheel_torque: 0.05, ..Params::paper() };
    assert!((lean(&weak) - 2.0 * lean(&weaker)).abs() < 1e-12);
    assert!((lean(&Params { max_wheel_torque: 1e-4, ..Params::paper() }) - 0.05).abs() < 1e-12);
}

#[test]
fn the_defaults_of_the_paper_are_exact() {
    let exact = Scale { time: 1.0, acceleration: 1.0, torque: 1.0, lean: 1.0 };
    assert_eq!(Scale::of(&Params::paper()), exact);
    assert_eq!(config("velocity", &[]).get("command_seconds").unwrap(), [3.0, 8.0]);
}

#[test]
fn options_follow_the_robot_unless_they_are_set() {
    let mut velocity = config("velocity", &[("settling", &[1.5])]);
    velocity.set_params(similar(4.0));
    let values = |name: &str| velocity.get(name).unwrap();
    let close = |name: &str, expected: &[f64]| {
        let found = values(name);
        assert_eq!(found.len(), expected.len());
        assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-12 * e), "{name}: {found:?}, {expected:?}");
    };
    close("speed", &[1.0]);
    close("command_seconds", &[6.0, 16.0]);
    close("smoothing", &[1.75]);
    close("success_velocity", &[0.04]);
    close("settling", &[1.5]);
    close("yaw_rate", &[0.5]);
    let run = run_of(&*velocity, 8);
    let fastest = (0..8).map(|i| super::command(&run, i)[0].hypot(super::command(&run, i)[1])).fold(0.0, f64::max);
    assert!(fastest > 0.5 && fastest <= 1.0, "{fastest} m/s");
}

#[test]
fn an_option_is_not_unset_by_nan() {
    let error = config("velocity", &[]).set("speed", &[f64::NAN]).unwrap_err().to_string();
    assert!(error.contains("speed = NaN"), "{error}");
}
