//! The last stage of the laws: wheels that neither slip nor lift, and the benefit for a regulator.

use crate::support::general::crooked;
use ballbot_core::control::{Controller, LimitOptions, Limited, Lqr, LqrWeights, Sampled, Setpoint, TorqueLimits};
use ballbot_core::kinematics::{Omniwheels, TorqueMap};
use ballbot_core::models::{LoadMap, Scale, SpatialModel, capture_impulse};
use ballbot_core::{Ballbot, LaneState, ModelKind, Params, State, Wheels};
use nalgebra::{Rotation3, Vector2, Vector3, Vector6};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

const SHARE: f64 = 0.9;
const SIM_DT: f64 = 0.001;
const STEPS: usize = 10;

/// The presets, and robots without symmetry, with inclined rollers and without.
fn robots() -> impl Iterator<Item = Params> {
    let others = [0.0, 0.7, -0.4].map(|roller_angle| Params { roller_angle, ..crooked() });
    Params::preset_names().iter().map(|name| Params::preset(name).unwrap()).chain(others)
}

fn apply(params: &Params, state: &State, torques: Wheels<f64>) -> Limited<f64> {
    let limits = TorqueLimits::new(params, 0.01, &LimitOptions::TRACTION).unwrap();
    limits.apply(torques, &LaneState::from(state), f64::INFINITY)
}

/// Deterministic numbers in [-1, 1].
fn wave(k: usize, part: usize) -> f64 {
    (1.0 + k as f64 * 1.7 + part as f64 * 4.1).sin()
}

/// A tilt torque of a size and direction, and a yaw torque, on the wheels.
fn torques(params: &Params, size: f64, azimuth: f64, yaw: f64) -> Wheels<f64> {
    let axis = Vector3::new(size * azimuth.cos(), size * azimuth.sin(), yaw);
    let axis = params.to_balance_frame().inverse_transform_vector(&axis);
    Omniwheels::new(params).torques_on_body(&axis, TorqueMap::Consistent)
}

/// The largest use of the friction limit by any wheel, and the smallest load as a fraction of the equilibrium load.
fn used(params: &Params, state: &State, torques: Wheels<f64>) -> (f64, f64) {
    let model = SpatialModel::new(params, true, true);
    let rate = state.body_angular_velocity;
    let velocity = Vector6::new(state.ball_velocity.x, state.ball_velocity.y, rate.x, rate.y, rate.z, 0.0);
    let contacts = model.contacts(&state.body_quaternion, &velocity, torques);
    let equilibrium = params.equilibrium_wheel_loads();
    (0..3).fold((0.0, f64::INFINITY), |(slip, load): (f64, f64), i| {
        let normal = contacts.wheel_normal_forces[i];
        let limit = SHARE * params.wheel_dynamic_friction * normal;
        (slip.max(contacts.wheel_tractions[i].abs() / limit), load.min(normal / equilibrium[i]))
    })
}

#[test]
fn load_maps_are_the_derivatives_of_the_contact_forces() {
    for params in robots() {
        let smooth = Params { wheel_coulomb_friction: 0.0, wheel_viscous_friction: 0.0, ..params.clone() };
        let (map, model) = (LoadMap::new(&params), SpatialModel::new(&smooth, true, true));
        for k in 0..20 {
            let tau = Vector3::new(wave(k, 0), wave(k, 1), wave(k, 2)) * (0.1 * params.body_mass);
            let tilt = Vector2::new(wave(k, 3), wave(k, 4)) * 1e-7;
            let state = State::tilted_from_equilibrium(&params, tilt, 0.0);
            let contacts = model.contacts(&state.body_quaternion, &Vector6::zeros(), Wheels::of_column(tau));
            for i in 0..3 {
                for (wheel, found) in
                    [(map.loads[i], contacts.wheel_normal_forces[i]), (map.tractions[i], contacts.wheel_tractions[i])]
                {
                    let linear =
                        wheel.at_rest + Vector2::from(wheel.per_tilt).dot(&tilt) + wheel.per_torque.column().dot(&tau);
                    let scale = params.body_mass * params.gravity;
                    assert!((linear - found).abs() < 1e-6 * scale, "{linear} N, the model has {found} N");
                }
            }
        }
    }
}

/// In equilibrium the maps are exact, and so is the limit.
#[test]
fn limited_torques_reach_and_do_not_exceed_the_friction_limit() {
    for params in robots() {
        let params = Params {
            wheel_coulomb_friction: 0.0,
            wheel_viscous_friction: 0.0,
            max_wheel_torque: 1e3,
            ..params.without_losses()
        };
        let state = State::at_equilibrium(&params, 0.7);
        let weight = params.body_mass * params.gravity * params.wheel_radius;
        let (mut limited_ones, mut kept) = (0, 0);
        for k in 0..200 {
            let desired =
                torques(&params, weight * (0.5 + 0.5 * wave(k, 0)), PI * wave(k, 1), 0.2 * weight * wave(k, 2));
            let found = apply(&params, &state, desired);
            let (slip, load) = used(&params, &state, found.torques);
            assert!(slip <= 1.0 + 1e-9 && load >= 0.3 - 1e-9, "{slip} of the limit, {load} of the load");
            if found.torques == desired {
                kept += 1;
                assert_eq!((found.share, found.yaw_share), (1.0, 1.0));
                continue;
            }
            limited_ones += 1;
            // A yaw torque may unload the wheel that limits the tilt torque.
            let relieved = found.share < 1.0 && found.yaw_share == 1.0;
            assert!(slip > 1.0 - 1e-6 || load < 0.3 + 1e-6 || relieved, "{slip} of the limit, {load} of the load");
            // The rest of both parts keeps its direction.
            let wheels = Omniwheels::new(&params);
            let of = |torques: Wheels<f64>| params.to_balance_frame() * (wheels.u.transpose() * torques.column());
            let (before, after) = (of(desired), of(found.torques));
            assert!((after.xy() - before.xy() * found.share).norm() < 1e-9 * before.norm());
            assert!((after.z - before.z * found.yaw_share).abs() < 1e-9 * before.norm());
        }
        assert!(limited_ones > 50 && kept > 10, "{limited_ones} limited, {kept} kept");
    }
}

#[test]
fn tilted_robots_keep_within_two_percent_of_the_limit() {
    let params = Params { max_wheel_torque: 1e3, ..Params::paper() };
    let mut worst = 0.0_f64;
    for degrees in [5.0, 10.0, 15.0, 20.0, 25.0_f64] {
        for k in 0..48 {
            let azimuth = TAU * f64::from(k) / 48.0;
            let tilt = Vector2::new(azimuth.cos(), azimuth.sin()) * degrees.to_radians();
            let state = State::tilted(&params, tilt, 0.0);
            // Back to upright.
            let found = apply(&params, &state, torques(&params, -5.0, azimuth, 0.0));
            assert!(found.share < 0.2);
            let (slip, _) = used(&params, &state, found.torques);
            worst = worst.max(slip);
        }
    }
    assert!(worst < 1.02, "{worst}");
}

#[test]
fn yaw_torque_is_reduced_first() {
    let params = Params::paper();
    let state = State::upright(&params);
    let found = apply(&params, &state, torques(&params, 0.2, 0.4, 5.0));
    assert!(found.share == 1.0 && found.yaw_share > 0.0 && found.yaw_share < 0.1, "{found:?}");
    let found = apply(&params, &state, torques(&params, 1.0, 0.4, 5.0));
    assert!(found.share < 0.5 && found.yaw_share < 1e-6, "{found:?}");
    // The wheels can carry a yaw torque by itself.
    let found = apply(&params, &state, torques(&params, 0.0, 0.0, 5.0));
    assert!(found.share == 1.0 && found.yaw_share > 0.1 && found.yaw_share < 1.0, "{found:?}");
}

#[test]
fn turned_by_a_third_the_torques_move_on_by_a_wheel() {
    let params = Params::paper();
    for k in 0..50 {
        let (tilt, size, azimuth) = (0.3 * (1.0 + wave(k, 0)), 0.5 * (1.0 + wave(k, 1)), PI * wave(k, 2));
        let at = |turn: f64| {
            let direction = azimuth + turn;
            let state = State::tilted(&params, Vector2::new(direction.cos(), direction.sin()) * tilt, 0.0);
            let found = apply(&params, &state, torques(&params, size, direction + 0.3, 0.05 * wave(k, 3)));
            found.torques
        };
        let (here, there) = (at(0.0), at(TAU / 3.0));
        for i in 0..3 {
            assert!((here[i] - there[(i + 1) % 3]).abs() < 1e-9, "{here:?}, {there:?}");
        }
    }
}

#[test]
fn a_heading_changes_nothing() {
    let params = Params::paper();
    let desired = torques(&params, 0.6, 1.0, 0.1);
    let turned = |yaw: f64| {
        let tilt = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw) * Vector3::new(0.1, -0.05, 0.0);
        apply(&params, &State::tilted(&params, tilt.xy(), yaw), desired).torques
    };
    for yaw in [0.5, 2.0, -3.0] {
        assert!((turned(yaw).column() - turned(0.0).column()).norm() < 1e-9);
    }
}

#[test]
fn where_a_wheel_slips_the_torques_are_capped_and_do_not_drive_it_further() {
    let params = Params { max_wheel_torque: 1.0, ..Params::paper() };
    let mut state = State::tilted(&params, Vector2::new(0.2, 0.1), 0.0);
    let desired = torques(&params, 1.0, 0.4, 0.1);
    let gripping = apply(&params, &state, desired);
    let of_cap = |control_dt: f64| TorqueLimits::new(&params, control_dt, &LimitOptions::CAP).unwrap();
    let capped = of_cap(0.01).apply(desired, &LaneState::from(&state), f64::INFINITY).torques;
    assert!(capped[1] < 0.0);
    for (control_dt, time) in [(0.002, 0.06), (0.01, 0.06), (0.08, 0.08)] {
        let limits = TorqueLimits::new(&params, control_dt, &LimitOptions::TRACTION).unwrap();
        // Of the ball's surface relative to the wheel's: a wheel that its torque drives has the other sign.
        let at = |slip: f64, largest: f64| {
            let slipping = State { wheel_speeds: Wheels([0.0, -slip / params.wheel_radius, 0.0]), ..state.clone() };
            limits.apply(desired, &LaneState::from(&slipping), largest).torques
        };
        for slip in [0.11, 0.3] {
            let (found, reduction) =
                (at(slip, f64::INFINITY), params.wheel_inertia * slip / (params.wheel_radius * time));
            assert!((found[1] - capped[1] - reduction).abs() < 1e-12, "{slip} m/s: {found:?}, capped {capped:?}");
            assert_eq!((found[0], found[2]), (capped[0], capped[2]));
        }
        assert_eq!(at(100.0, f64::INFINITY), Wheels([capped[0], 0.0, capped[2]]));
        assert_eq!(at(-0.3, f64::INFINITY), capped);
        assert!(at(-0.3, 0.05).into_iter().all(|torque| torque.abs() <= 0.05));
    }
    state.wheel_speeds[1] = 0.09 / params.wheel_radius;
    assert_eq!(apply(&params, &state, desired).torques, gripping.torques);
}

#[test]
fn torques_that_are_nan_are_not_hidden() {
    let params = Params::paper();
    for k in 0..3 {
        let mut desired = Wheels([0.1, -0.2, 0.3]);
        desired[k] = f64::NAN;
        for state in [State::upright(&params), State::tilted(&params, Vector2::new(0.3, 0.1), 0.0)] {
            assert!(apply(&params, &state, desired).torques[k].is_nan());
        }
    }
}

#[test]
fn limits_out_of_range_are_rejected() {
    let params = Params::paper();
    for (traction, max_torque, words) in [
        (Some(0.0), None, "traction = 0 is out of range: it must be from 0.01 to 1"),
        (Some(1.1), None, "traction = 1.1"),
        (Some(f64::NAN), None, "traction = NaN"),
        (None, Some(0.0), "max_torque = 0"),
        (
            Some(0.9),
            Some(5.1),
            "max_torque = 5.1 is out of range: it must be above 0 and at most params.max_wheel_torque = 5",
        ),
    ] {
        let error = TorqueLimits::new(&params, 0.01, &LimitOptions { max_torque, traction, ..LimitOptions::CAP })
            .map(|_| ())
            .unwrap_err()
            .to_string();
        assert!(error.contains(words), "{error}");
    }
}

/// A regulator at 100 Hz on `contact`, pushed from the start on for a time, s, with a half sine.
fn recovers(lqr: &mut Sampled<Lqr>, start: &State, impulse: Vector3<f64>, duration: f64, target: Vector2<f64>) -> bool {
    recovers_on(&Params::paper(), lqr, start, impulse, duration, target)
}

fn recovers_on(
    params: &Params,
    lqr: &mut Sampled<Lqr>,
    start: &State,
    impulse: Vector3<f64>,
    duration: f64,
    target: Vector2<f64>,
) -> bool {
    let mut robot = Ballbot::new(params, ModelKind::Contact, SIM_DT).unwrap();
    robot.reset(start).unwrap();
    lqr.reset();
    let pushed = (duration / SIM_DT).round() as usize;
    let setpoint = Setpoint { position: target, ..Setpoint::default() };
    // The slower a robot topples, the later it is back.
    for k in 0..(600.0 * Scale::of(params).time) as usize {
        let torques = lqr.wheel_torques(&robot.state(), &setpoint);
        for j in 0..STEPS {
            let step = k * STEPS + j;
            if step < pushed {
                let phase = PI * (step as f64 + 0.5) / pushed as f64;
                let share = phase.sin() * (FRAC_PI_2 / pushed as f64).sin();
                robot.push(&(impulse * share), None).unwrap();
            }
            if robot.step(torques, 1).is_err() {
                return false;
            }
        }
        if robot.state().tilt() > 1.0 {
            return false;
        }
    }
    robot.state().tilt() < 0.03
}

fn regulators() -> [Sampled<Lqr>; 2] {
    let params = Params::paper();
    let without = LqrWeights { max_lean: 1e3, max_speed: 1e3, ..LqrWeights::default() };
    let lqr = |weights, limits| Lqr::with_weights(&params, SIM_DT * STEPS as f64, weights, limits).unwrap();
    [lqr(&without, &LimitOptions::CAP), lqr(&LqrWeights::default(), &LimitOptions::TRACTION)]
}

fn around(count: u32) -> impl Iterator<Item = Vector2<f64>> {
    (0..count).map(move |k| TAU * f64::from(k) / f64::from(count)).map(|a| Vector2::new(a.cos(), a.sin()))
}

/// From rest at 25 deg in any direction; with only a cap on the torques the regulator falls from 17 deg on.
#[test]
fn the_stage_widens_the_basin_of_a_regulator() {
    let params = Params::paper();
    let [mut capped, mut scaled] = regulators();
    for direction in around(24) {
        let start = |degrees: f64| State::tilted(&params, direction * degrees.to_radians(), 0.0);
        assert!(recovers(&mut scaled, &start(25.0), Vector3::zeros(), 0.0, Vector2::zeros()), "{direction}");
    }
    let falls = around(12).filter(|direction| {
        let start = State::tilted(&params, direction * 17_f64.to_radians(), 0.0);
        !recovers(&mut capped, &start, Vector3::zeros(), 0.0, Vector2::zeros())
    });
    assert!(falls.count() >= 4);
}

/// Pushed at the center of mass for 0.1 s, and at once.
#[test]
fn with_the_stage_a_regulator_withstands_harder_pushes() {
    let upright = State::upright(&Params::paper());
    let [mut capped, mut scaled] = regulators();
    let mut falls = 0;
    for direction in around(12) {
        let push = |size: f64| Vector3::new(direction.x, direction.y, 0.0) * size;
        assert!(recovers(&mut scaled, &upright, push(2.6), 0.1, Vector2::zeros()), "{direction}");
        assert!(recovers(&mut scaled, &upright, push(1.85), SIM_DT, Vector2::zeros()), "{direction}");
        falls += u32::from(!recovers(&mut capped, &upright, push(1.85), 0.1, Vector2::zeros()));
    }
    assert!(falls >= 8, "{falls}");
}

/// At once, by a fraction of the push that the motors could take up: wheels slip. With their full torque the wheels of
/// rezero, which have heavy rotors, kept slipping until it fell, in some directions from 5 % on.
#[test]
fn slipping_wheels_grip_again() {
    for name in Params::preset_names() {
        let params = Params::preset(name).unwrap();
        let mut lqr = Lqr::new(&params, SIM_DT * STEPS as f64).unwrap();
        let upright = State::upright(&params);
        for share in [0.05, 0.2, 0.4, 0.55] {
            for direction in around(12) {
                let push = Vector3::new(direction.x, direction.y, 0.0) * (share * capture_impulse(&params));
                let target = Vector2::zeros();
                assert!(recovers_on(&params, &mut lqr, &upright, push, SIM_DT, target), "{name}, {share}, {direction}");
            }
        }
    }
}

/// What a user requests with a click, and far beyond.
#[test]
fn a_far_setpoint_topples_no_robot() {
    let params = Params::paper();
    let [_, mut scaled] = regulators();
    for (distance, seconds) in [(1.0, 8), (5.0, 15), (1000.0, 20)] {
        for direction in around(8) {
            let mut robot = Ballbot::new(&params, ModelKind::Contact, SIM_DT).unwrap();
            let setpoint = Setpoint { position: direction * distance, ..Setpoint::default() };
            let (mut tilt, mut speed) = (0.0_f64, 0.0_f64);
            for _ in 0..100 * seconds {
                robot.step(scaled.wheel_torques(&robot.state(), &setpoint), STEPS).unwrap();
                let state = robot.state();
                (tilt, speed) = (tilt.max(state.tilt()), speed.max(state.ball_velocity.norm()));
            }
            assert!(tilt < 0.25 && speed < 1.2, "{distance} m: tilt {tilt} rad, {speed} m/s");
            let left = (robot.state().ball_position.xy() - setpoint.position).norm();
            assert!(distance > 5.0 || left < 0.02, "{distance} m: {left} m left");
        }
    }
}
