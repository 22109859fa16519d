//! Slopes on which robots can balance, compared with the statics of the bot and against the simulation.

use crate::support::general::{contacts_and_axles, crooked};
use ballbot_core::terrain::Terrain;
use ballbot_core::{Ballbot, ModelKind, Params, State};
use nalgebra::{Matrix6, UnitQuaternion, Vector3, Vector6};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// The presets and robots without symmetry, at several frictions of wheels and floor; motors limit none.
fn robots() -> Vec<Params> {
    let wheels = |params: Params, [fixed, moving]: [f64; 2]| Params {
        wheel_static_friction: fixed,
        wheel_dynamic_friction: moving,
        floor_static_friction: 3.0,
        max_wheel_torque: 1e3,
        ..params
    };
    let uneven = Params {
        body_com_offset: [0.02, 0.01],
        wheel_azimuths: [0.3, 2.0, 4.0],
        wheel_zenith_offsets: [0.1, -0.1, 0.02],
        ..Params::paper()
    };
    let mut robots = Vec::new();
    for name in Params::preset_names() {
        let preset = Params::preset(name).unwrap();
        let published = [preset.wheel_static_friction, preset.wheel_dynamic_friction];
        robots.extend([published, [1.0, 1.0], [0.6, 0.6]].map(|friction| wheels(preset.clone(), friction)));
    }
    robots.extend([wheels(crooked(), [0.6, 0.4]), wheels(uneven.clone(), [1.1, 1.0]), wheels(uneven, [0.5, 0.5])]);
    let smooth = wheels(Params::paper(), [1.1, 1.0]);
    robots.push(Params { floor_static_friction: 0.2, floor_dynamic_friction: 0.1, ..smooth });
    for params in &robots {
        params.validate().unwrap();
    }
    robots
}

/// Margin of the contact nearest to slipping on a plane that rises towards x, relative to the weight: μ N - |f|.
fn margin(params: &Params, slope: f64, yaw: f64) -> f64 {
    let mass = params.ball_mass + params.body_mass;
    let com = params.body_com();
    // The common center of mass is above the contact.
    let lean = (mass * params.ball_radius * slope.sin() / (params.body_mass * com.norm())).asin();
    let turned = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
    let attitude = turned(Vector3::y_axis(), lean)
        * turned(Vector3::z_axis(), yaw)
        * UnitQuaternion::rotation_between(&com, &Vector3::z()).unwrap();
    // Force and moment of loads N p and tractions -f d on the bot about the ball's center, with radius 1, carry its
    // weight.
    let held = attitude.inverse_transform_vector(&Vector3::z());
    let moment = com.cross(&held) / params.ball_radius;
    let mut columns = Matrix6::zeros();
    for (i, (contact, axle)) in contacts_and_axles(params).into_iter().enumerate() {
        let drive = contact.cross(&axle);
        for (k, (force, arm)) in [(contact, Vector3::zeros()), (-drive, contact.cross(&-drive))].into_iter().enumerate()
        {
            columns.fixed_view_mut::<3, 1>(0, i + 3 * k).copy_from(&force);
            columns.fixed_view_mut::<3, 1>(3, i + 3 * k).copy_from(&arm);
        }
    }
    let forces = columns.lu().solve(&Vector6::from_iterator(held.iter().chain(&moment).copied())).unwrap();
    let floor = params.floor_static_friction * slope.cos() - slope.sin();
    (0..3).map(|i| params.wheel_static_friction * forces[i] - forces[i + 3].abs()).fold(floor, f64::min)
}

/// The heading of the smallest margin, and the margin.
fn worst(params: &Params, slope: f64) -> (f64, f64) {
    let least = |center: f64, half: f64| {
        let at = (0..=200).map(|k| center + half * (f64::from(k) / 100.0 - 1.0));
        at.map(|yaw| (yaw, margin(params, slope, yaw))).min_by(|a, b| a.1.total_cmp(&b.1)).unwrap()
    };
    let (yaw, _) = least(0.0, PI);
    least(yaw, PI / 100.0)
}

/// The largest slope for which a condition holds, rad.
fn steepest(holds: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.01, 0.5);
    for _ in 0..20 {
        let middle = 0.5 * (low + high);
        if holds(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

/// Whether a robot put on a plane that rises towards x stays where it is, held by its torques.
fn balances(params: &Params, slope: f64, yaw: f64) -> bool {
    let mut robot = Ballbot::new(params, ModelKind::Contact, 1e-3).unwrap();
    robot.set_terrain(Some(&Arc::new(Terrain::plane(slope, 0.0).unwrap()))).unwrap();
    robot.place_on_ground(0.0, 0.0, yaw, None).unwrap();
    let tilted = Params { floor_tilt: [0.0, -slope], ..params.clone() };
    robot.step(tilted.holding_torques(yaw).unwrap(), 50).unwrap();
    let State { wheel_speeds, ball_velocity, .. } = robot.state();
    let rates = wheel_speeds.into_iter().chain([ball_velocity.norm() / params.ball_radius]);
    rates.fold(0.0_f64, |most, rate| most.max(rate.abs())) < 1e-3
}

#[test]
fn the_traction_on_a_slope_matches_the_leaning_bot_in_its_worst_heading() {
    for params in robots() {
        let limit = params.slope_limits(0.5).unwrap().traction;
        let statics = steepest(|slope| worst(&params, slope).1 >= 0.0);
        assert!((limit / statics - 1.0).abs() < 1e-4, "{limit} rad, statics {statics} rad: {params:?}");
    }
}

/// Joint friction holds a wheel of `asroballet` that slips by less than 0.1 %.
#[test]
fn robots_balance_in_contact_up_to_the_limit_and_no_further() {
    for params in robots() {
        let limit = params.slope_limits(0.5).unwrap().traction;
        let (yaw, _) = worst(&params, limit);
        let found = steepest(|slope| balances(&params, slope, yaw));
        assert!((limit / found - 1.0).abs() < 2e-3, "{limit} rad, in contact {found} rad: {params:?}");
        for k in 0..24 {
            let yaw = TAU * f64::from(k) / 24.0;
            assert!(balances(&params, 0.998 * limit, yaw), "falls short at the heading {yaw}: {params:?}");
        }
    }
}
