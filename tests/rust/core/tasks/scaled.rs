//! Defaults of tasks that follow from the robot.

use super::{config, run_of};
use ballbot_core::batch::{BalanceConfig, ResetRequest};
use ballbot_core::models::Scale;
use ballbot_core::{Params, State};
use nalgebra::{Vector2, Vector3};

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
        friction_critical_velocity: paper.friction_critical_velocity * size.sqrt(),
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
        assert!((scale.lean_acceleration - 1.0).abs() < 1e-9);
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
    let exact = Scale {
        time: 1.0,
        acceleration: 1.0,
        mass: 1.0,
        torque: 1.0,
        lean: 1.0,
        wheel_speed: 1.0,
        lean_acceleration: 1.0,
    };
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
fn similar_robots_look_alike_to_a_policy() {
    // Equal motions in units of the robot, with a control period to scale.
    let rows = |size: f64| {
        let mut balance = config("balance", &[("scale_observations", &[1.0]), ("scale_by_robot", &[1.0])]);
        balance.set("sim_dt", &[2e-3 * size.sqrt()]).unwrap();
        balance.set("control_dt", &[1e-2 * size.sqrt()]).unwrap();
        let params = similar(size);
        balance.set_params(params.clone());
        let torque = 0.2 * size.powi(4);
        balance.set("max_wheel_torque", &[torque]).unwrap();
        let mut run = run_of(&*balance, 1);
        let mut start = State::tilted(&params, Vector2::new(0.05, -0.03), 0.4);
        start.body_angular_velocity = Vector3::new(0.3, -0.2, 0.1) / size.sqrt();
        let mut rows = vec![0.0; run.batch.observation_len()];
        run.batch
            .reset_with(&ResetRequest { starts: Some(&[Some(start)]), ..ResetRequest::default() }, &mut rows)
            .unwrap();
        for _ in 0..15 {
            run.step(&[0.5, -0.3, 0.1]).unwrap();
            assert!(!run.terminated[0]);
        }
        run.batch.observation(0, &mut rows).unwrap();
        rows
    };
    let paper = rows(1.0);
    assert!(paper.iter().filter(|row| row.abs() > 1e-2).count() >= 12, "{paper:?}");
    for size in [0.3, 4.0] {
        for (i, (found, expected)) in rows(size).iter().zip(&paper).enumerate() {
            assert!(
                (found - expected).abs() < 1e-3 * expected.abs().max(0.1),
                "row {i} at {size}: {found}, {expected}"
            );
        }
    }
}

#[test]
fn the_torque_of_an_action_is_in_proportion_to_what_holds_the_largest_lean_within_the_motors_limit() {
    let rezero = Params::preset("rezero").unwrap();
    let Scale { torque, lean, .. } = Scale::of(&rezero);
    let weak = Params { max_wheel_torque: 0.3, ..Params::paper() };
    for (params, expected) in [(Params::paper(), 0.4), (similar(2.0), 6.4), (rezero, 0.4 * torque * lean), (weak, 0.3)]
    {
        let scaled = BalanceConfig { params, scale_by_robot: true, ..BalanceConfig::default() };
        assert!((scaled.action_torque() / expected - 1.0).abs() < 1e-12, "{}", scaled.action_torque());
        let given = BalanceConfig { max_wheel_torque: Some(0.1), ..scaled };
        assert_eq!(given.action_torque().to_bits(), 0.1_f64.to_bits());
    }
}

#[test]
fn an_option_is_not_unset_by_nan() {
    let error = config("velocity", &[]).set("speed", &[f64::NAN]).unwrap_err().to_string();
    assert!(error.contains("speed = NaN"), "{error}");
}
