//! Omniwheel kinematics: torques and rates are power conjugate, whatever the attitude.
//!
//! A wheel rolls on the ball without slip along its drive direction and freely across it, so an encoder rate is the
//! relative rotation of ball and body along u_i = p_i × d_i / cos γ, times the gear ratio, with the angle γ of the rollers. The map of torques is then fixed by
//! virtual work, Σ τ_i ψ̇_i = Σ (virtual torque · virtual rate), and eq. (8) as printed can be checked with it.

use crate::support::{any_attitude, any_robot, vector};
use ballbot_core::kinematics::{Omniwheels, TorqueMap};
use ballbot_core::{Error, Params, Wheels, attitude, rolling_rate};
use nalgebra::{Matrix3, UnitQuaternion, Vector2, Vector3};
use proptest::array::uniform3;
use proptest::prelude::*;
use std::f64::consts::TAU;

/// The paper's robot with its wheels away from 45 deg, where sine and cosine differ.
fn high_wheels() -> (Params, Omniwheels) {
    let params = Params { wheel_zenith: 0.6, ..Params::paper() };
    let wheels = Omniwheels::new(&params);
    (params, wheels)
}

/// Any robot, its wheels and rollers anywhere that is allowed; symmetric wheels in half of the robots.
fn any_wheels() -> impl Strategy<Value = Params> {
    let uneven = || prop_oneof![Just([0.0; 3]), uniform3(-0.15..0.15)];
    let angle = prop_oneof![Just(0.0), -1.2..1.2];
    (any_robot(), 0.2..1.3, uneven(), uneven(), angle).prop_map(|(params, zenith, offsets, turns, angle)| Params {
        roller_angle: angle,
        wheel_zenith: zenith,
        wheel_zenith_offsets: offsets,
        wheel_azimuths: std::array::from_fn(|i| params.wheel_azimuths[i] + turns[i]),
        ..params
    })
}

fn close(found: f64, expected: f64, scale: f64) -> bool {
    (found - expected).abs() <= 1e-11 * scale.max(1.0)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn wheel_torques_do_the_work_of_their_virtual_torques(
        params in any_wheels(),
        torques in vector(5.0),
        q in any_attitude(),
        ball in vector(30.0),
        body in vector(10.0),
    ) {
        let wheels = Omniwheels::new(&params);
        let speeds = wheels.wheel_speeds(&q, &ball, &body);
        let power = torques.dot(&speeds.column());
        let virtual_power = wheels.virtual_torques(Wheels::of_column(torques)).dot(&wheels.virtual_rates(speeds));
        prop_assert!(close(virtual_power, power, torques.norm() * speeds.column().norm() * 10.0), "{virtual_power}, not {power}");
    }

    #[test]
    fn virtual_torques_are_transmitted_with_their_power(
        params in any_wheels(),
        desired in vector(5.0),
        q in any_attitude(),
        ball in vector(30.0),
        body in vector(10.0),
    ) {
        let wheels = Omniwheels::new(&params);
        let torques = wheels.wheel_torques(&desired, TorqueMap::Consistent);
        // The power of the relative rotation of ball and body: about x and y eq. (8) counts torques on the body.
        let relative = q.inverse_transform_vector(&ball) - body;
        let on_ball = Vector3::new(-desired.x, -desired.y, desired.z) * params.gear_ratio();
        let power = torques.dot(wheels.wheel_speeds(&q, &ball, &body));
        let scale = torques.column().norm() * relative.norm() * params.gear_ratio() * 10.0;
        prop_assert!(close(power, on_ball.dot(&relative), scale), "{power}, not {}", on_ball.dot(&relative));
        let back = wheels.virtual_torques(torques);
        prop_assert!((back - desired).norm() <= 1e-11 * torques.column().norm(), "{back}, not {desired}");
    }

    #[test]
    fn wheel_and_ball_surfaces_move_together(
        params in any_wheels(),
        q in any_attitude(),
        ball in vector(30.0),
        body in vector(10.0),
    ) {
        let wheels = Omniwheels::new(&params);
        let speeds = wheels.wheel_speeds(&q, &ball, &body);
        let relative = q.inverse_transform_vector(&ball) - body;
        for i in 0..3 {
            // The axis of the roller is the direction of the rim, rotated about the contact's normal.
            let (zenith, (sin, cos)) = (params.wheel_zeniths()[i], params.wheel_azimuths[i].sin_cos());
            let p = Vector3::new(zenith.sin() * cos, zenith.sin() * sin, zenith.cos());
            let rim = Vector3::new(-sin, cos, 0.0);
            let d = UnitQuaternion::from_scaled_axis(p * params.roller_angle) * rim;
            prop_assert!((wheels.drive_directions[i] - d).norm() < 1e-14, "wheel {i}: drives along {d}");
            // Velocities of the two surfaces at the contact, seen from the body.
            let of_ball = relative.cross(&(p * params.ball_radius)).dot(&d);
            let axle = rim.cross(&p);
            let of_rim = (axle * speeds[i]).cross(&(-p * params.wheel_radius)).dot(&d);
            prop_assert!(close(of_rim, of_ball, 10.0), "wheel {i}: rim {of_rim}, ball {of_ball}");
        }
        let back = wheels.wheel_speeds_of_virtual(&wheels.virtual_rates(speeds));
        let off = (back - speeds).column().norm();
        prop_assert!(off <= 1e-10 * speeds.column().norm().max(1.0), "{back:?}, not {speeds:?}");
    }
}

#[test]
fn unit_vectors_match_the_conventions() {
    let (params, wheels) = high_wheels();
    let (sin, cos) = params.wheel_zenith.sin_cos();
    for (i, azimuth) in [0.0, TAU / 3.0, 2.0 * TAU / 3.0].into_iter().enumerate() {
        let (s, c) = f64::sin_cos(azimuth);
        let expected = [
            (wheels.contact_directions[i], Vector3::new(sin * c, sin * s, cos)),
            (wheels.drive_directions[i], Vector3::new(-s, c, 0.0)),
            (wheels.u.row(i).transpose(), Vector3::new(-cos * c, -cos * s, sin)),
        ];
        for (found, vector) in expected {
            assert!((found - vector).norm() < 1e-15, "wheel {i}: {found}, expected {vector}");
        }
    }
}

#[test]
fn three_evenly_spaced_wheels_do_not_couple_the_axes() {
    for zenith in [0.3, 0.7, 1.2] {
        let u = Omniwheels::new(&Params { wheel_zenith: zenith, ..Params::paper() }).u;
        let (sin2, cos2) = (zenith.sin().powi(2), zenith.cos().powi(2));
        let expected = Matrix3::from_diagonal(&Vector3::new(1.5 * cos2, 1.5 * cos2, 3.0 * sin2));
        assert!((u.transpose() * u - expected).norm() < 1e-14, "zenith {zenith}: {}", u.transpose() * u);
    }
}

#[test]
fn consistent_map_is_its_closed_form() {
    let (params, wheels) = high_wheels();
    let (sin, cos) = params.wheel_zenith.sin_cos();
    for virtual_torques in [Vector3::new(0.7, -0.3, 0.2), Vector3::x(), Vector3::y(), Vector3::z()] {
        let found = wheels.wheel_torques(&virtual_torques, TorqueMap::Consistent);
        for (i, azimuth) in params.wheel_azimuths.into_iter().enumerate() {
            let v = virtual_torques;
            let tilting = v.x * azimuth.cos() + v.y * azimuth.sin();
            let expected = (v.z / sin + 2.0 / cos * tilting) / 3.0;
            assert!((found[i] - expected).abs() < 1e-14, "wheel {i}: {}, expected {expected}", found[i]);
        }
    }
}

#[test]
fn printed_map_is_the_inverse_of_the_printed_matrix() {
    let (params, wheels) = high_wheels();
    let (sin, cos) = params.wheel_zenith.sin_cos();
    let (rw, rk, root3) = (params.wheel_radius, params.ball_radius, 3.0_f64.sqrt());
    let (tilt, across, yaw) = (rw / (3.0 * rk * cos), rw / (root3 * rk * cos), rw / (3.0 * rk * sin));
    let printed = Matrix3::new(2.0 * tilt, -tilt, -tilt, 0.0, across, -across, yaw, yaw, yaw);
    let inverse = printed.try_inverse().unwrap();
    for virtual_torques in [Vector3::new(0.7, -0.3, 0.2), Vector3::x(), Vector3::y(), Vector3::z()] {
        let found = wheels.wheel_torques(&virtual_torques, TorqueMap::AsPrinted).column();
        let expected = inverse * virtual_torques;
        assert!((found - expected).norm() < 1e-13, "{found}, expected {expected}");
    }
}

#[test]
fn printed_map_is_too_strong_by_the_known_ratios() {
    let strength = |virtual_torques: Vector3<f64>| {
        let wheels = Omniwheels::new(&Params::paper());
        let printed = wheels.wheel_torques(&virtual_torques, TorqueMap::AsPrinted);
        // Their virtual torques when power is conserved.
        wheels.virtual_torques(printed).dot(&virtual_torques)
    };
    // (3/2)(r_k/r_w) cos²α and 3 (r_k/r_w) sin²α with Table II.
    for (axis, expected) in [(Vector3::x(), 1.68), (Vector3::y(), 1.68), (Vector3::z(), 3.36)] {
        let found = strength(axis);
        assert!((found - expected).abs() < 1e-12, "{axis}: {found}, expected {expected}");
    }
}

#[test]
fn encoder_rates_have_the_sign_of_the_drive() {
    let (params, wheels) = high_wheels();
    let (sin, cos) = params.wheel_zenith.sin_cos();
    let at_rest = Vector3::zeros();
    let upright = UnitQuaternion::identity();
    // A ball turning about +z under a still body turns all wheels forward, as does a body turning about −z over a
    // still ball.
    let turning = params.gear_ratio() * sin * 3.0;
    let spun = wheels.wheel_speeds(&upright, &Vector3::new(0.0, 0.0, 3.0), &at_rest);
    let yawed = wheels.wheel_speeds(&upright, &at_rest, &Vector3::new(0.0, 0.0, -3.0));
    for speed in spun.iter().chain(yawed.iter()) {
        assert!((speed - turning).abs() < 1e-12, "{spun:?} {yawed:?}");
    }
    // Wheel 0 drives towards +y: rolling that way turns it forward by v cos α / r_w, the other two back by half.
    let rolling = rolling_rate(&params, &Vector3::new(0.0, 0.4, 0.0));
    let speeds = wheels.wheel_speeds(&upright, &rolling, &at_rest).column();
    let forward = 0.4 * cos / params.wheel_radius;
    let expected = Vector3::new(forward, -0.5 * forward, -0.5 * forward);
    assert!((speeds - expected).norm() < 1e-12, "{speeds}, expected {expected}");
    // The heading rotates this with the robot.
    let turned = wheels.wheel_speeds(
        &attitude(Vector2::zeros(), TAU / 4.0),
        &rolling_rate(&params, &Vector3::new(-0.4, 0.0, 0.0)),
        &at_rest,
    );
    let turned = turned.column();
    assert!((turned - expected).norm() < 1e-12, "{turned}, expected {expected}");
}

#[test]
fn virtual_rates_match_eq_6() {
    let (params, wheels) = high_wheels();
    let (speed, tilt_rate) = (0.3, 0.8);
    // In the yz-plane; the paper's tilt leans towards +y, which is left-handed about x.
    let rolling = rolling_rate(&params, &Vector3::new(0.0, speed, 0.0));
    let speeds = wheels.wheel_speeds(&UnitQuaternion::identity(), &rolling, &Vector3::new(-tilt_rate, 0.0, 0.0));
    let found = wheels.virtual_rates(speeds);
    let expected = speed / params.wheel_radius - params.gear_ratio() * tilt_rate;
    assert!((found - Vector3::new(expected, 0.0, 0.0)).norm() < 1e-12, "{found}, expected {expected} about x");
}

#[test]
fn unknown_torque_maps_are_rejected_with_the_known_names() {
    assert_eq!("consistent".parse::<TorqueMap>().unwrap(), TorqueMap::Consistent);
    assert_eq!("as_printed".parse::<TorqueMap>().unwrap(), TorqueMap::AsPrinted);
    let error = "Consistent".parse::<TorqueMap>().unwrap_err();
    assert!(matches!(&error, Error::UnknownName { name, .. } if name == "Consistent"));
    assert!(error.to_string().contains("consistent, as_printed"), "{error}");
}
