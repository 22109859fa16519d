//! The spatial model against an independent derivation (`data/spatial_vectors.json`, from Kane's equations and confirmed
//! by Newton-Euler equations with constraint multipliers) and against its own invariants.

use crate::motion::Motion;
use ballbot_core::models::{LinearModel, PlanarModel, SpatialModel, SpatialMotion, WheelInertia};
use ballbot_core::{Model, Params, State, Wheels, attitude, mechanical_energy, unit_quaternion};
use nalgebra::{Vector2, Vector3, Vector6};
use serde::Deserialize;

#[derive(Deserialize)]
struct Vectors {
    accelerations: Vec<Case>,
    trajectories: Vec<Trajectory>,
}

#[derive(Deserialize)]
struct Case {
    name: String,
    ball_spins_about_vertical: bool,
    absolute_wheel_spin: bool,
    ball_viscous_friction: f64,
    wheel_viscous_friction: f64,
    body_quaternion_wxyz: [f64; 4],
    generalized_velocity: Vec<f64>,
    wheel_torques: [f64; 3],
    generalized_acceleration: Vec<f64>,
    wheel_speeds: [f64; 3],
    energy: f64,
    floor_force: [f64; 3],
    wheel_normal_forces: [f64; 3],
    wheel_tractions: [f64; 3],
}

#[derive(Deserialize)]
struct Trajectory {
    name: String,
    ball_spins_about_vertical: bool,
    absolute_wheel_spin: bool,
    wheel_torques: [f64; 3],
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
}

fn vectors() -> Vectors {
    serde_json::from_str(include_str!("data/spatial_vectors.json")).expect("the vectors are valid JSON")
}

fn assert_close(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    let scale = expected.iter().fold(1e-3_f64, |m, v| m.max(v.abs()));
    assert_eq!(found.len(), expected.len(), "{what}");
    for (f, e) in found.iter().zip(expected) {
        assert!((f - e).abs() <= tolerance * scale, "{what}: {found:?}, expected {expected:?}");
    }
}

#[test]
fn accelerations_loads_and_wheel_speeds_match_the_vectors() {
    let cases = vectors().accelerations;
    assert_eq!(cases.len(), 108);
    for case in cases {
        let params = Params {
            ball_viscous_friction: case.ball_viscous_friction,
            wheel_viscous_friction: case.wheel_viscous_friction,
            ..Params::paper()
        };
        let model = SpatialModel::new(&params, case.absolute_wheel_spin, case.ball_spins_about_vertical);
        let q = unit_quaternion("body_quaternion", case.body_quaternion_wxyz).unwrap();
        let velocity = model.generalized_velocity(&case.generalized_velocity).unwrap();
        let torques = Vector3::from(case.wheel_torques);

        let acceleration = model.accelerations(&q, &velocity, Wheels::of_column(torques));
        let n = model.degrees_of_freedom();
        assert_close(&case.name, &acceleration.as_slice()[..n], &case.generalized_acceleration, 1e-10);
        assert_close(&case.name, model.wheel_speeds(&q, &velocity).as_slice(), &case.wheel_speeds, 1e-10);
        assert_close(&case.name, &[model.energy(&q, &velocity)], &[case.energy], 1e-10);
        let contacts = model.contacts(&q, &velocity, Wheels::of_column(torques));
        assert_close(&case.name, contacts.floor_force.as_slice(), &case.floor_force, 1e-10);
        assert_close(&case.name, contacts.wheel_normal_forces.as_slice(), &case.wheel_normal_forces, 1e-10);
        assert_close(&case.name, contacts.wheel_tractions.as_slice(), &case.wheel_tractions, 1e-10);
    }
}

#[test]
fn motion_matches_the_trajectories_of_the_exact_model() {
    let mut compared = 0;
    for trajectory in vectors().trajectories {
        // `SpatialMotion` is the exact model; the others differ in what they omit.
        if !(trajectory.absolute_wheel_spin && trajectory.ball_spins_about_vertical) {
            continue;
        }
        let column = |row: &[f64], name: &str| row[trajectory.columns.iter().position(|c| c == name).unwrap()];
        let params = Params::paper();
        let start = &trajectory.rows[0];
        let q = unit_quaternion("q", ["qw", "qx", "qy", "qz"].map(|c| column(start, c))).unwrap();
        let rate = Vector3::from(["Ox", "Oy", "Oz"].map(|c| column(start, c)));
        let velocity = Vector2::new(column(start, "vx"), column(start, "vy"));
        let spin = trajectory.columns.iter().position(|c| c == "s").map_or(0.0, |i| start[i]);
        let mut motion = SpatialMotion::new(&params, 1e-4);
        motion.reset(&State::rolling(&params, velocity, spin, q, rate)).unwrap();
        for row in &trajectory.rows {
            while motion.time() < column(row, "t") - 0.5e-4 {
                motion.step(trajectory.wheel_torques);
            }
            let state = motion.state();
            let found = [state.ball_position.x, state.ball_position.y, state.ball_velocity.x, state.ball_velocity.y];
            let expected = ["x", "y", "vx", "vy"].map(|c| column(row, c));
            assert_close(&trajectory.name, &found, &expected, 1e-8);
            assert_close(
                &trajectory.name,
                state.body_angular_velocity.as_slice(),
                &["Ox", "Oy", "Oz"].map(|c| column(row, c)),
                1e-8,
            );
        }
        compared += 1;
    }
    assert!(compared > 0, "no trajectory of the exact model among the vectors");
}

/// A state with every motion at once.
fn lively(params: &Params) -> State {
    State::rolling(
        params,
        Vector2::new(0.3, -0.2),
        0.7,
        attitude(Vector2::new(0.12, -0.2), 0.9),
        Vector3::new(0.4, -0.3, 0.8),
    )
}

#[test]
fn energy_is_conserved_without_friction() {
    let params = Params::paper();
    let mut motion = SpatialMotion::new(&params, 1e-3);
    motion.reset(&lively(&params)).unwrap();
    let before = motion.energy();
    let mut largest = 0.0_f64;
    // The robot topples all the way around: this model has no floor.
    for _ in 0..2000 {
        motion.step([0.0; 3]);
        largest = largest.max((motion.energy() / before - 1.0).abs());
    }
    assert!(largest <= 1e-9, "relative drift {largest:e}");
}

#[test]
fn energy_of_the_model_equals_the_energy_of_its_bodies() {
    let params = Params::paper();
    let mut motion = SpatialMotion::new(&params, 1e-3);
    motion.reset(&lively(&params)).unwrap();
    let wheels = ballbot_core::kinematics::Omniwheels::new(&params);
    for _ in 0..100 {
        motion.step([0.1, -0.05, 0.02]);
        let bodies = mechanical_energy(&params, &wheels, &motion.state());
        assert!((motion.energy() - bodies).abs() < 1e-12, "{} against {bodies}", motion.energy());
    }
}

#[test]
fn work_of_motors_less_friction_is_the_change_of_energy() {
    let params = Params { ball_viscous_friction: 3.0, wheel_viscous_friction: 1e-3, ..Params::paper() };
    let mut motion = SpatialMotion::new(&params, 1e-4);
    motion.reset(&lively(&params)).unwrap();
    let torques = Vector3::new(0.2, -0.1, 0.05);
    let power = |state: &State| {
        let wheel_speeds = state.wheel_speeds.column();
        torques.dot(&wheel_speeds)
            - params.wheel_viscous_friction * wheel_speeds.norm_squared()
            - params.ball_viscous_friction * state.ball_velocity.norm_squared()
    };
    let before = motion.energy();
    let mut work = 0.0;
    for _ in 0..5000 {
        let start = power(&motion.state());
        motion.step(Wheels::of_column(torques));
        work += 0.5e-4 * (start + power(&motion.state()));
    }
    let change = motion.energy() - before;
    assert!(change.abs() > 0.1, "nothing happened: {change}");
    assert!((change - work).abs() < 1e-6 * change.abs(), "change {change}, work {work}");
}

#[test]
fn integration_is_of_fourth_order() {
    let params = Params::paper();
    let end = |dt: f64| {
        let mut motion = SpatialMotion::new(&params, dt);
        motion.reset(&lively(&params)).unwrap();
        for _ in 0..(0.4 / dt).round() as usize {
            motion.step([0.1, -0.05, 0.02]);
        }
        motion.state().ball_position
    };
    let exact = end(1e-4);
    let order = ((end(0.02) - exact).norm() / (end(0.01) - exact).norm()).log2();
    assert!((order - 4.0).abs() <= 0.2, "observed order {order}");
}

#[test]
fn massless_wheels_leave_the_momenta_of_translation_and_rotation() {
    // Without wheel inertia the only constraint is a ball that rolls on the floor: translations along it and turns
    // about the vertical are symmetries, whose momenta count the ball's rolling inertia as mass.
    let params = Params { wheel_inertia: 1e-300, ..Params::paper() };
    let rolling_mass = params.ball_mass + params.ball_inertia / params.ball_radius.powi(2);
    let mut motion = SpatialMotion::new(&params, 1e-3);
    motion.reset(&lively(&params)).unwrap();
    let momenta = |state: &State| {
        let arm = state.body_quaternion * Vector3::z() * params.body_com_height;
        let rate = state.body_quaternion * state.body_angular_velocity;
        let com_velocity = state.body_velocity + rate.cross(&arm);
        let linear = state.ball_velocity * rolling_mass + com_velocity * params.body_mass;
        let inertia = Vector3::from(params.body_inertia).component_mul(&state.body_angular_velocity);
        let spin = state.body_quaternion * inertia
            + (state.ball_position + arm).cross(&com_velocity) * params.body_mass
            + state.ball_position.cross(&state.ball_velocity) * rolling_mass
            + state.ball_angular_velocity * params.ball_inertia;
        Vector3::new(linear.x, linear.y, spin.z)
    };
    let before = momenta(&motion.state());
    for _ in 0..2000 {
        motion.step([0.0; 3]);
    }
    let drift = (momenta(&motion.state()) - before).norm() / before.norm();
    assert!(drift <= 1e-9, "relative drift {drift:e}");
}

#[test]
fn motion_in_a_plane_matches_the_planar_model_with_three_wheels() {
    let params = Params { ball_viscous_friction: 4.0, ..Params::paper() };
    let planar = PlanarModel::new(&params, WheelInertia::ThreeWheels).unwrap();
    let spatial = SpatialModel::new(&params, false, false);
    for (tilt, tilt_rate, speed, torque) in [(0.3, 0.0, 0.0, 0.0), (-0.5, 1.2, 0.4, 0.3), (1.0, -2.0, -1.0, -0.7)] {
        let expected = planar.accelerations(&Vector2::new(0.0, tilt), &Vector2::new(speed, tilt_rate), torque);
        // Towards +y is a left-handed tilt about x; the virtual torque about x of eq. (8) is the planar torque.
        let q = attitude(Vector2::new(-tilt, 0.0), 0.0);
        let velocity = Vector6::new(0.0, speed, -tilt_rate, 0.0, 0.0, 0.0);
        let torques = spatial
            .wheels()
            .wheel_torques(&Vector3::new(torque, 0.0, 0.0), ballbot_core::kinematics::TorqueMap::Consistent);
        let found = spatial.accelerations(&q, &velocity, torques);
        assert_close("plane", &[found[1], -found[2]], expected.as_slice(), 1e-12);
        assert!(found[0].abs() + found[3].abs() + found[4].abs() < 1e-11, "leaves the plane: {found}");
    }
}

#[test]
fn upright_poles_are_exact() {
    let poles = |a: nalgebra::DMatrix<f64>| {
        let mut real: Vec<f64> = a.complex_eigenvalues().iter().map(|p| p.re).collect();
        real.sort_by(f64::total_cmp);
        real
    };
    // Absolute wheel spin; each direction has its pair.
    let linear = LinearModel::new(&Params::paper());
    let found = poles(nalgebra::DMatrix::from_column_slice(10, 10, linear.a.as_slice()));
    assert!((found[9] - 6.091_744_51).abs() < 1e-6 && (found[8] - 6.091_744_51).abs() < 1e-6, "{found:?}");
    assert!((found[0] + 6.091_744_51).abs() < 1e-6, "{found:?}");
    // The planar readings, without and with the paper's viscous friction.
    let planar = |params: &Params, inertia| {
        let (a, _) = PlanarModel::new(params, inertia).unwrap().linearize();
        poles(nalgebra::DMatrix::from_column_slice(4, 4, a.as_slice()))
    };
    let damped = Params { ball_viscous_friction: 49.849, ..Params::paper() };
    for (found, expected) in [
        (planar(&Params::paper(), WheelInertia::AsPrinted), [-6.107_625_38, 0.0, 0.0, 6.107_625_38]),
        (planar(&Params::paper(), WheelInertia::ThreeWheels), [-6.125_295_53, 0.0, 0.0, 6.125_295_53]),
        (planar(&damped, WheelInertia::AsPrinted), [-14.112_271_69, -5.040_383_19, 0.0, 5.661_582_98]),
    ] {
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() < 1e-6, "{found:?}, expected {expected:?}");
        }
    }
}

#[test]
fn slipping_states_are_rejected_with_their_value() {
    let params = Params::paper();
    let mut motion = SpatialMotion::new(&params, 1e-3);
    let mut state = State::upright(&params);
    state.ball_velocity.x = 0.25;
    let message = motion.reset(&state).unwrap_err().to_string();
    assert!(message.contains("ball_angular_velocity[1] = 0") && message.contains("2.232"), "{message}");
}

#[test]
fn loaded_motion_continues_bit_for_bit() {
    let params = Params::paper();
    let mut motion = SpatialMotion::new(&params, 1e-3);
    motion.reset(&lively(&params)).unwrap();
    motion.step([0.1, 0.0, -0.1]);
    let saved = motion.save();
    let mut other = SpatialMotion::new(&params, 1e-3);
    other.load(&saved).unwrap();
    for _ in 0..50 {
        motion.step([0.0, 0.2, -0.1]);
        other.step([0.0, 0.2, -0.1]);
    }
    assert_eq!(motion.state(), other.state());
    assert!(other.load(&saved[1..]).is_err());
}
