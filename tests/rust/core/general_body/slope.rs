//! A tilted floor: the direction of gravity, rest, energy, and controllers, which assume that it is level.

use super::regulator;
use crate::support::general::any_robot_on_rollers;
use crate::support::{any_floor_tilt, any_start, natural_rate, without_losses};
use ballbot_core::control::{Pid, PidGains};
use ballbot_core::kinematics::{Omniwheels, TorqueMap};
use ballbot_core::models::{LinearModel, PlanarModel, SpatialModel, SpatialMotion, WheelInertia, traction_torque};
use ballbot_core::{Ballbot, Error, Model, ModelKind, Params, State, Wheels, mechanical_energy};
use nalgebra::{Rotation3, Vector2, Vector3, Vector6};
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};

fn on_slope(params: &Params, floor_tilt: [f64; 2]) -> Params {
    let params = Params { floor_tilt, ..params.clone() };
    params.validate().expect("no robot is too heavy for a slope");
    params
}

#[test]
fn a_floor_tilted_about_y_goes_down_towards_x() {
    let params = on_slope(&Params::paper(), [0.0, 0.1]);
    let g = params.gravity;
    assert!((params.gravity_vector() - Vector3::new(g * 0.1_f64.sin(), 0.0, -g * 0.1_f64.cos())).norm() < 1e-15 * g);
    // Against gravity, so against the tilt of the floor.
    let lean = params.slope_lean().unwrap();
    assert!(lean.x == 0.0 && lean.y < -0.1, "{lean}");
}

#[test]
fn a_level_floor_leaves_no_trace() {
    let params = Params { floor_tilt: [0.0, -0.0], ..Params::paper() };
    let bits = |v: Vector3<f64>| [v.x, v.y, v.z].map(f64::to_bits);
    assert_eq!(bits(params.gravity_vector()), bits(Vector3::new(0.0, 0.0, -params.gravity)));
    assert_eq!(bits(params.up()), bits(Vector3::z()));
    assert_eq!(params.slope_lean().unwrap(), Vector2::zeros());
    assert_eq!(params.holding_torques(0.3).unwrap(), Wheels::default());
}

#[test]
fn slopes_that_are_too_steep_are_rejected() {
    let error = Params::paper().replace([("floor_tilt", &[0.4, -0.4][..])]).unwrap_err();
    assert!(error.to_string().contains("floor_tilt") && error.to_string().contains("at most 0.5 rad"), "{error}");
    // M r sin θ of M_b l: the paper's robot is held up to 0.867 rad, with a quarter of its height up to 0.19.
    let low = Params { body_com_height: 0.0355, ..on_slope(&Params::paper(), [0.12, -0.16]) };
    let error = low.slope_lean().unwrap_err();
    assert!(matches!(error, Error::Inconsistent(_)), "{error:?}");
    assert!(error.to_string().contains("floor_tilt = [0.12, -0.16]"), "{error}");
    assert_eq!(low.holding_torques(0.0).unwrap_err().to_string(), error.to_string());
}

#[test]
fn planar_rejects_a_tilted_floor() {
    let paper = Params::paper();
    let params = on_slope(&paper, [0.0, 1e-9]);
    let mut robot = Ballbot::new(&paper, ModelKind::Planar, 1e-3).unwrap();
    for error in [
        PlanarModel::new(&params, WheelInertia::ThreeWheels).map(|_| ()).unwrap_err(),
        Ballbot::new(&params, ModelKind::Planar, 1e-3).map(|_| ()).unwrap_err(),
        robot.set_params(&params).map(|_| ()).unwrap_err(),
    ] {
        assert!(matches!(error, Error::Inconsistent(_)), "{error:?}");
        assert!(error.to_string().contains("floor_tilt = [0.0, 1e-9], but it requires zeros"), "{error}");
    }
    assert_eq!(robot.params(), &paper);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn gravity_turns_against_the_floor(params in any_robot_on_rollers(), tilt in any_floor_tilt(0.5)) {
        let params = on_slope(&params, tilt);
        let floor = Rotation3::from_scaled_axis(Vector3::new(tilt[0], tilt[1], 0.0));
        let expected = floor.inverse() * Vector3::new(0.0, 0.0, -params.gravity);
        prop_assert!((params.gravity_vector() - expected).norm() <= 1e-15 * params.gravity);
        prop_assert!((params.gravity_vector() + params.up() * params.gravity).norm() <= 1e-15 * params.gravity);
    }

    #[test]
    fn a_robot_held_in_its_slope_lean_is_at_rest(
        params in any_robot_on_rollers(), tilt in any_floor_tilt(0.5), yaw in -PI..PI,
    ) {
        let params = on_slope(&params, tilt);
        let (mass, length) = (params.ball_mass + params.body_mass, params.body_com().norm());
        let needed = mass * params.ball_radius * params.slope().sin();
        let Ok(lean) = params.slope_lean() else {
            prop_assert!(needed > params.body_mass * length, "rejected with {needed} kg·m of {}", params.body_mass * length);
            return Ok(());
        };
        let state = State::tilted_from_equilibrium(&params, lean, yaw);
        let model = SpatialModel::new(&params, true, true);
        let torques = params.holding_torques(yaw).unwrap();
        let found = model.accelerations(&state.body_quaternion, &Vector6::zeros(), torques);
        let scale = natural_rate(&params).powi(2);
        prop_assert!(found.rows(2, 4).amax() <= 1e-10 * scale, "turns: {found}");
        prop_assert!(found.rows(0, 2).amax() <= 1e-10 * scale * length, "moves: {found}");

        // The floor holds the weight, and the common center of mass is above its contact.
        let contacts = model.contacts(&state.body_quaternion, &Vector6::zeros(), torques);
        let weight = params.up() * (mass * params.gravity);
        prop_assert!((contacts.floor_force - weight).norm() <= 1e-10 * weight.norm(), "{}", contacts.floor_force);
        let com = state.body_quaternion * params.body_com() * params.body_mass
            + Vector3::z() * (mass * params.ball_radius);
        prop_assert!(com.cross(&params.up()).norm() <= 1e-12 * com.norm(), "{com} is not above the contact");
    }

    #[test]
    fn slope_limits_match_the_worst_heading(
        params in any_robot_on_rollers(), torque in 0.02..1.0_f64, fall_tilt in 0.1..1.5,
        weights in prop_oneof![Just(0.0), 0.0..3.0],
    ) {
        let weight = (params.ball_mass + params.body_mass) * params.gravity;
        let wheel_preload = weights * params.body_mass * params.gravity;
        let params = Params { max_wheel_torque: torque * weight * params.wheel_radius, wheel_preload, ..params };
        let limits = params.slope_limits(fall_tilt).unwrap();
        // Whether a robot on a slope exceeds the limits of its lean, traction and motors in some heading; `None` where
        // no lean holds it.
        let exceeded = |slope: f64| {
            let params = on_slope(&params, [0.0, -slope]);
            let lean = params.slope_lean().ok()?;
            let model = SpatialModel::new(&params, true, true);
            let mut exceeded = [lean.norm() - slope > fall_tilt, false, false];
            for k in 0..360 {
                let yaw = PI * f64::from(k) / 180.0;
                let torques = params.holding_torques(yaw).unwrap();
                let attitude = State::tilted_from_equilibrium(&params, lean, yaw).body_quaternion;
                let contacts = model.contacts(&attitude, &Vector6::zeros(), torques);
                let floor = contacts.floor_force;
                exceeded[1] |= floor.xy().norm() > params.floor_static_friction * floor.z;
                for (load, traction) in contacts.wheel_normal_forces.iter().zip(contacts.wheel_tractions) {
                    exceeded[1] |= traction.abs() > params.wheel_static_friction * load;
                }
                exceeded[2] |= torques.iter().any(|torque| torque.abs() > params.max_wheel_torque);
            }
            Some(exceeded)
        };
        for (i, limit) in [limits.fall, limits.traction, limits.motor].into_iter().enumerate() {
            prop_assert!(limit > 0.0 && limit <= FRAC_PI_2);
            let around = [0.999, 1.001].map(|share| share * limit);
            if around[1] < 0.5 && let [Some(below), Some(above)] = around.map(exceeded) {
                prop_assert!(!below[i] && above[i], "limit {i} of {limits:?}");
            }
        }
    }

    #[test]
    fn energy_is_conserved_on_a_slope_and_equals_the_energy_of_the_bodies(
        params in any_robot_on_rollers(), tilt in any_floor_tilt(0.5), start in any_start(0.5, 1.0),
    ) {
        let params = on_slope(&without_losses(&params), tilt);
        let mut robot = SpatialMotion::new(&params, 5e-4 / natural_rate(&params));
        robot.place(&start.of(&params));
        let wheels = Omniwheels::new(&params);
        let before = robot.energy();
        let scale = params.body_mass * params.gravity * params.body_com().norm() + before.abs();
        for _ in 0..10 {
            robot.advance(Wheels::default(), 200);
            let (now, bodies) = (robot.energy(), mechanical_energy(&params, &wheels, &robot.state()));
            prop_assert!((now - before).abs() <= 1e-9 * scale, "energy {before} becomes {now}");
            prop_assert!((now - bodies).abs() <= 1e-12 * scale, "{now}, but the bodies have {bodies}");
        }
    }

    #[test]
    fn controllers_are_designed_for_a_level_floor(params in any_robot_on_rollers(), tilt in any_floor_tilt(0.5)) {
        let sloped = on_slope(&params, tilt);
        prop_assert_eq!(LinearModel::new(&sloped), LinearModel::new(&params));
        prop_assert_eq!(traction_torque(&sloped).to_bits(), traction_torque(&params).to_bits());
        let gain = |params| regulator(params).regulator().gain.clone();
        prop_assert_eq!(gain(&sloped), gain(&params));
        prop_assert!(Pid::new(&sloped, 0.002, &PidGains::default(), TorqueMap::Consistent).is_ok());
    }
}
