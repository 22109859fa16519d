//! Robots on the ground: at rest, balanced, fallen.

use ballbot_core::control::{Controller, Lqr, Setpoint};
use ballbot_core::terrain::{Ground, Terrain};
use ballbot_core::{Ballbot, ModelKind, Params, State};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use std::sync::Arc;

fn on(terrain: &Arc<Terrain>, kind: ModelKind, params: &Params, dt: f64) -> Ballbot {
    let mut robot = Ballbot::new(params, kind, dt).unwrap();
    robot.set_terrain(Some(terrain)).unwrap();
    robot
}

fn distance(a: &State, b: &State) -> f64 {
    a.to_array().iter().zip(b.to_array()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn a_sloped_surface_is_a_tilted_gravity() {
    for (slope, direction) in [(0.1_f64, 0.0_f64), (0.15, 2.2)] {
        let terrain = Arc::new(Terrain::plane(slope, direction).unwrap());
        // Turns the frame of the floor to the inertial one: its x axis goes up the slope.
        let axis = Vector3::new(direction.sin(), -direction.cos(), 0.0);
        let turn = UnitQuaternion::from_scaled_axis(axis * slope);
        let tilted = Params { floor_tilt: [axis.x * slope, axis.y * slope], ..Params::paper() };
        for kind in [ModelKind::Contact, ModelKind::Rigid, ModelKind::Spatial] {
            let mut other = Ballbot::new(&tilted, kind, 1e-3).unwrap();
            let start = State::rolling(
                &tilted,
                Vector2::new(0.2, -0.1),
                0.3,
                UnitQuaternion::from_euler_angles(0.05, -0.1, 0.4),
                Vector3::new(0.1, 0.2, -0.3),
            );
            other.reset(&start).unwrap();
            let mut robot = on(&terrain, kind, &Params::paper(), 1e-3);
            robot.reset(&turned(&turn, &start)).unwrap();
            for k in 0..200 {
                let torques = [0.05, -0.03, 0.02].map(|t: f64| t * f64::from(k % 7 - 3));
                robot.step(torques, 1).unwrap();
                other.step(torques, 1).unwrap();
            }
            let apart = distance(&robot.state(), &turned(&turn, &other.state()));
            let limit = if kind == ModelKind::Rigid { 1e-6 } else { 1e-12 };
            assert!(apart < limit, "{kind}: {apart}");
            // Potential energies differ by the height of the ball's center, r (1 - cos slope), which is in the zero.
            let mass = tilted.ball_mass + tilted.body_mass;
            let raised = mass * tilted.gravity * tilted.ball_radius * (1.0 - slope.cos());
            let more = other.energy() - robot.energy();
            assert!((more - raised).abs() < 1e-5, "{kind}: {more} J, {raised} J");
            let (here, there) = (robot.contacts().floor_force, turn * other.contacts().floor_force);
            assert!(
                (here - there).norm() < if kind == ModelKind::Rigid { 1e-3 } else { 1e-8 },
                "{kind}: {here} {there}"
            );
        }
    }
}

/// Ground that a robot does not touch does not change its motion by a bit, however it leans.
#[test]
fn a_distant_bump_changes_no_bit() {
    let slope = |x: f64, _: f64| 0.2 * x;
    let bump = |x: f64, y: f64| 0.2 * x + 0.1 * (-((x - 4.0).powi(2) + y * y) / 0.08).exp();
    let [plain, bumpy] = [
        Arc::new(Terrain::from_function(slope, [12.0, 4.0], 0.05).unwrap()),
        Arc::new(Terrain::from_function(bump, [12.0, 4.0], 0.05).unwrap()),
    ];
    assert!(bumpy.curvature()[0] > 100.0 * plain.curvature()[0].abs());
    let params = Params { wheel_coulomb_friction: 0.0, ..Params::preset("rezero").unwrap() };
    for seed in 0..20 {
        let angle = f64::from(seed);
        let [mut here, mut there] = [&plain, &bumpy].map(|terrain| on(terrain, ModelKind::Contact, &params, 2e-3));
        for robot in [&mut here, &mut there] {
            let tilt = Vector2::new(0.2 * angle.sin(), 0.4 + 0.1 * angle.cos());
            robot.place_on_ground(-2.0, 0.0, 3.0 * angle.sin(), Some(tilt)).unwrap();
        }
        for k in 0..50 {
            let torques = [0, 1, 2].map(|i| 1.9 * (7.0 * angle + f64::from(k / 5) + 2.0 * f64::from(i)).sin());
            here.step(torques, 1).unwrap();
            there.step(torques, 1).unwrap();
            assert!(!here.bot_on_floor());
            let bits = |robot: &Ballbot| robot.state().to_array().map(f64::to_bits);
            assert!(bits(&here) == bits(&there), "seed {seed}, step {k}");
        }
    }
}

fn turned(turn: &UnitQuaternion<f64>, state: &State) -> State {
    State {
        ball_position: turn * state.ball_position,
        ball_quaternion: turn * state.ball_quaternion,
        ball_velocity: turn * state.ball_velocity,
        ball_angular_velocity: turn * state.ball_angular_velocity,
        body_position: turn * state.body_position,
        body_quaternion: turn * state.body_quaternion,
        body_velocity: turn * state.body_velocity,
        ..state.clone()
    }
}

#[test]
fn a_level_terrain_is_level_ground() {
    let terrain = Arc::new(Terrain::from_function(|_, _| 0.0, [4.0, 4.0], 0.1).unwrap());
    for kind in [ModelKind::Contact, ModelKind::Rigid] {
        let mut level = Ballbot::new(&Params::paper(), kind, 1e-3).unwrap();
        let mut robot = on(&terrain, kind, &Params::paper(), 1e-3);
        let start = State::tilted(&Params::paper(), Vector2::new(0.1, -0.05), 0.3);
        level.reset(&start).unwrap();
        robot.reset(&start).unwrap();
        for _ in 0..300 {
            level.step([0.02, -0.01, 0.0], 1).unwrap();
            robot.step([0.02, -0.01, 0.0], 1).unwrap();
        }
        let apart = distance(&level.state(), &robot.state());
        assert!(apart < 1e-9, "{kind}: {apart}");
    }
}

#[test]
fn a_robot_is_at_rest_on_a_slope_with_its_lean_and_torques() {
    let params = Params::paper();
    for (slope, direction, yaw) in [(0.05_f64, 0.3_f64, 0.0_f64), (0.12, 4.0, 1.1)] {
        let terrain = Arc::new(Terrain::plane(slope, direction).unwrap());
        let axis = Vector3::new(direction.sin(), -direction.cos(), 0.0) * slope;
        let tilted = Params { floor_tilt: [axis.x, axis.y], ..params.clone() };
        for kind in [ModelKind::Contact, ModelKind::Rigid, ModelKind::Spatial] {
            let mut robot = on(&terrain, kind, &params, 1e-3);
            robot.place_on_ground(0.4, -0.3, yaw, None).unwrap();
            let share = (params.ball_mass + params.body_mass) * params.ball_radius
                / (params.body_mass * params.body_com_height);
            let lean = (share * slope.sin()).asin();
            assert!((robot.state().tilt() - lean).abs() < 1e-12);
            // The torques depend on the heading in the frame of the floor.
            let attitude = UnitQuaternion::from_scaled_axis(axis).inverse() * robot.state().body_quaternion;
            let heading = State { body_quaternion: attitude, ..State::upright(&params) }.yaw();
            let torques = tilted.holding_torques(heading).unwrap();
            robot.step(torques, 50).unwrap();
            let state = robot.state();
            let speed = state.ball_velocity.norm() + state.body_angular_velocity.norm();
            assert!(speed < 1e-6, "{kind} on {slope} rad: {speed}");
            let force = robot.contacts().floor_force;
            let weight = (params.ball_mass + params.body_mass) * params.gravity;
            assert!((force - Vector3::z() * weight).norm() < 1e-4 * weight, "{kind}: {force}");
        }
    }
    let steep = Arc::new(Terrain::plane(1.0, 0.0).unwrap());
    let rejected = on(&steep, ModelKind::Contact, &params, 1e-3).place_on_ground(0.0, 0.0, 0.0, None);
    assert!(rejected.unwrap_err().to_string().contains("the slope is 1.000 rad"));
}

fn balanced(robot: &mut Ballbot, seconds: f64) -> State {
    let mut lqr = Lqr::new(robot.params(), 0.005).unwrap();
    let steps = (0.005 / robot.sim_dt()).round() as usize;
    for _ in 0..(seconds / 0.005).round() as usize {
        let torques = lqr.wheel_torques(&robot.state(), &Setpoint::default());
        robot.step(torques, steps).unwrap();
    }
    robot.state()
}

#[test]
fn both_models_balance_alike_on_waves() {
    let parameters = [("slope", 0.08), ("wavelength", 0.8), ("direction", 0.4), ("size_x", 4.0), ("size_y", 4.0)];
    let terrain = Arc::new(Terrain::generate("wave", 0, &parameters).unwrap());
    let [contact, rigid] = [ModelKind::Contact, ModelKind::Rigid].map(|kind| {
        let mut robot = on(&terrain, kind, &Params::paper(), 1e-3);
        robot.place_on_ground(0.15, 0.1, 0.2, None).unwrap();
        balanced(&mut robot, 1.0)
    });
    assert!(contact.tilt() < 0.3);
    let apart = (contact.ball_position - rigid.ball_position).norm();
    assert!(apart < 1e-3, "{apart} m: {} {}", contact.ball_position, rigid.ball_position);
}

#[test]
fn a_fallen_robot_comes_to_rest_on_the_ground() {
    let params = Params::paper();
    for (kind, terrain) in [
        ("slope", Terrain::plane(0.15, 1.0).unwrap()),
        (
            "bowl",
            Terrain::generate("bowl", 0, &[("slope", 0.3), ("radius", 1.0), ("size_x", 4.0), ("size_y", 4.0)]).unwrap(),
        ),
        ("hills", Terrain::generate("noise", 2, &[("slope", 0.2), ("wavelength", 1.5)]).unwrap()),
    ] {
        let terrain = Arc::new(terrain);
        let ground = Ground::new(&terrain, params.ball_radius).unwrap();
        let mut robot = on(&terrain, ModelKind::Contact, &params, 1e-3);
        robot.place_on_ground(0.1, -0.1, 0.4, Some(Vector2::new(0.5, 0.3))).unwrap();
        let mut before = robot.energy();
        let mut touched = false;
        for _ in 0..400 {
            robot.step([0.0; 3], 10).unwrap();
            touched |= robot.bot_on_floor();
            let energy = robot.energy();
            assert!(energy < before + 2e-3, "{kind}: {energy} J after {before} J");
            before = energy;
            // No part is below the ground by more than a fall presses it in, and none flies.
            let state = robot.state();
            let (gap, _) = ground.gap(&state.ball_position, params.ball_radius);
            assert!(gap > -2e-3, "{kind}: ball {gap} m");
            let lowest = lowest(&terrain, &params, &state);
            assert!(lowest > -8e-3, "{kind}: bot {lowest} m at {} s", robot.time());
        }
        assert!(touched, "{kind}");
        let lowest = lowest(&terrain, &params, &robot.state());
        assert!(lowest.abs() < 4e-3, "{kind}: {lowest} m");
    }
}

/// Smallest height of the body's rims and wheels above the ground.
fn lowest(terrain: &Terrain, params: &Params, state: &State) -> f64 {
    let height = |point: Vector3<f64>| {
        let place = state.body_position + state.body_quaternion * point;
        (place.z - terrain.height(place.x, place.y)) * terrain.normal(place.x, place.y).z
    };
    let reach = params.ball_radius + params.wheel_radius;
    let wheels = params.wheel_azimuths.map(|azimuth| {
        let (sin, cos) = params.wheel_zenith.sin_cos();
        height(Vector3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos) * reach) - params.wheel_radius
    });
    let radius = reach * params.wheel_zenith.sin();
    let half = (3.0 * (params.body_inertia[0] / params.body_mass)).sqrt();
    let bottom = 1.05 * params.ball_radius;
    let top = (params.body_com_height + half).max(bottom + params.wheel_radius);
    let rims = (0..72).flat_map(|i| {
        let (sin, cos) = f64::to_radians(5.0 * f64::from(i)).sin_cos();
        [bottom, top].map(|z| Vector3::new(radius * cos, radius * sin, z))
    });
    rims.map(height).chain(wheels).fold(f64::INFINITY, f64::min)
}

#[test]
fn a_snapshot_continues_bit_for_bit_and_fits_only_its_terrain() {
    let make = |seed| Arc::new(Terrain::generate("noise", seed, &[("slope", 0.1)]).unwrap());
    let terrain = make(1);
    for kind in [ModelKind::Contact, ModelKind::Rigid] {
        let mut robot = on(&terrain, kind, &Params::paper(), 1e-3);
        robot.place_on_ground(0.5, 0.5, 0.1, None).unwrap();
        robot.step([0.01, 0.0, -0.01], 100).unwrap();
        let bytes = robot.save();
        robot.step([0.01, 0.0, -0.01], 100).unwrap();
        let mut other = on(&terrain, kind, &Params::paper(), 1e-3);
        other.load(&bytes).unwrap();
        other.step([0.01, 0.0, -0.01], 100).unwrap();
        assert_eq!(robot.state(), other.state());
        let elsewhere = on(&make(2), kind, &Params::paper(), 1e-3).load(&bytes);
        assert!(elsewhere.unwrap_err().to_string().contains("terrains differ"));
    }
}

#[test]
fn a_robot_with_another_ball_is_placed_on_the_ground_of_that_ball() {
    let terrain = Arc::new(Terrain::generate("noise", 0, &[("slope", 0.15)]).unwrap());
    let big = Params { ball_radius: 0.14, ..Params::paper() };
    let mut robot = on(&terrain, ModelKind::Contact, &Params::paper(), 1e-3);
    assert!(!robot.set_params(&big).unwrap());
    let mut other = on(&terrain, ModelKind::Contact, &big, 1e-3);
    for robot in [&mut robot, &mut other] {
        robot.place_on_ground(0.3, 0.2, 0.0, None).unwrap();
        robot.step([0.01, 0.0, 0.0], 20).unwrap();
    }
    assert_eq!(robot.state(), other.state());
    let narrow = Arc::new(Terrain::generate("wave", 0, &[("wavelength", 0.36), ("slope", 0.2)]).unwrap());
    let mut robot = on(&narrow, ModelKind::Contact, &Params::paper(), 1e-3);
    let before = robot.save();
    let message = robot.set_params(&Params { ball_radius: 0.25, ..Params::paper() }).unwrap_err().to_string();
    assert!(message.contains("narrowest valley"), "{message}");
    assert_eq!(robot.save(), before);
}

#[test]
fn a_robot_that_leaves_the_terrain_has_diverged() {
    let terrain = Arc::new(Terrain::from_function(|x, _| 0.1 * x, [1.0, 1.0], 0.05).unwrap());
    let params = Params::paper();
    for kind in [ModelKind::Contact, ModelKind::Rigid] {
        let mut robot = on(&terrain, kind, &params, 1e-3);
        let outside = robot.place_on_ground(0.6, 0.0, 0.0, None).unwrap_err().to_string();
        assert!(outside.contains("x = 0.6 m, y = 0 m is not on the terrain"), "{outside}");
        robot.place_on_ground(-0.45, 0.0, 0.0, None).unwrap();
        let velocity = Vector3::new(-1.0, 0.0, -0.1);
        let start = State { ball_velocity: velocity, body_velocity: velocity, ..robot.state() };
        robot.reset(&start).unwrap();
        let left = (0..500).find_map(|_| robot.step([0.0; 3], 1).err()).expect("it rolls down").to_string();
        assert!(left.contains("the ball left the terrain at x = -0.5"), "{left}");
    }
    let tilted = Params { floor_tilt: [0.1, 0.0], ..params };
    let rejected = Ballbot::new(&tilted, ModelKind::Contact, 1e-3).unwrap().set_terrain(Some(&terrain));
    assert!(rejected.unwrap_err().to_string().contains("floor_tilt"));
}

#[test]
fn models_reject_ground_that_they_do_not_simulate() {
    let (params, slope) = (Params::paper(), Arc::new(Terrain::plane(0.1, 0.0).unwrap()));
    let hills = Arc::new(Terrain::generate("noise", 0, &[]).unwrap());
    let rejected = |kind, terrain, words: &str| {
        let mut robot = Ballbot::new(&params, kind, 1e-3).unwrap();
        let message = robot.set_terrain(Some(terrain)).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
        assert!(robot.terrain().is_none());
    };
    rejected(ModelKind::Planar, &slope, "'planar' simulates only level ground");
    rejected(ModelKind::Spatial, &hills, "'spatial' simulates only planes");
    let mut robot = on(&hills, ModelKind::Contact, &params, 1e-3);
    let below = State::upright(&params);
    let height = hills.height(0.0, 0.0);
    let low = State {
        ball_position: below.ball_position + Vector3::z() * (height - 0.02),
        body_position: below.body_position + Vector3::z() * (height - 0.02),
        ..below
    };
    assert!(robot.reset(&low).unwrap_err().to_string().contains("gap of ball_position above the ground"));
    robot.set_terrain(None).unwrap();
    assert_eq!(robot.state(), Ballbot::new(&params, ModelKind::Contact, 1e-3).unwrap().state());
}
