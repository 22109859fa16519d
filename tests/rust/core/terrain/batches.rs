//! Environments on terrain.

use crate::run::Run;
use ballbot_core::batch::{Autoreset, task_kind};
use ballbot_core::terrain::{Ground, Terrain};
use ballbot_core::{ModelKind, Params};
use std::sync::Arc;

/// Robots of a task; "bare" ends only by time.
fn run(
    task: &str,
    terrain: Option<&Arc<Terrain>>,
    model: ModelKind,
    n: usize,
    threads: usize,
    options: &[(&str, f64)],
) -> Run {
    let mut config = task_kind(task).unwrap().config();
    config.set_model(model);
    config.set_terrain(terrain.cloned());
    config.set("max_wheel_torque", &[0.3]).unwrap();
    options.iter().for_each(|(name, value)| config.set(name, &[*value]).unwrap());
    Run::new(config.batch(n, Autoreset::SameStep, Some(threads), 5).unwrap())
}

/// Actions that tip some robots over; the actions of the first robots do not depend on the number of robots.
fn step(run: &mut Run, k: usize) {
    let actions: Vec<f32> =
        (0..3 * run.batch.len()).map(|i| ((i / 3 * 7 + i % 3 * 2 + k / 3) % 5) as f32 * 0.4 - 0.8).collect();
    run.step(&actions).unwrap();
}

fn hills() -> Arc<Terrain> {
    Arc::new(Terrain::generate("noise", 3, &[("slope", 0.15), ("wavelength", 0.8)]).unwrap())
}

#[test]
fn a_robot_in_lanes_equals_a_single_robot_bit_for_bit() {
    let terrain = hills();
    let fallen = [("max_episode_steps", 300.0)];
    let mut many = run("bare", Some(&terrain), ModelKind::Contact, 21, 2, &fallen);
    let mut few = run("bare", Some(&terrain), ModelKind::Contact, 5, 1, &fallen);
    for k in 0..700 {
        step(&mut many, k);
        step(&mut few, k);
        for i in 0..5 {
            assert_eq!(many.bits(i), few.bits(i), "environment {i} at step {k}");
        }
    }
    // One robot, by the scalar code.
    let fresh = run("bare", Some(&terrain), ModelKind::Contact, 5, 1, &[]);
    let states: Vec<_> = (0..5).map(|i| fresh.batch.state(i).unwrap()).collect();
    let mut alone = run("bare", Some(&terrain), ModelKind::Contact, 5, 1, &[]);
    let starts: Vec<_> = states.iter().cloned().map(Some).collect();
    let request = ballbot_core::batch::ResetRequest { starts: Some(&starts), ..Default::default() };
    let mut robot = ballbot_core::Ballbot::new(&Params::paper(), ModelKind::Contact, 0.002).unwrap();
    robot.set_terrain(Some(&terrain)).unwrap();
    for (i, state) in states.iter().enumerate() {
        robot.reset(state).unwrap();
        alone.batch.reset_with(&request, &mut alone.observations).unwrap();
        for _ in 0..20 {
            robot.step([0.0; 3], 5).unwrap();
            alone.step(&[0.0; 15]).unwrap();
        }
        assert_eq!(robot.state(), alone.batch.state(i).unwrap(), "robot {i}");
    }
}

#[test]
fn starts_touch_the_ground_and_lean_with_it() {
    let (terrain, params) = (hills(), Params::paper());
    let ground = Ground::new(&terrain, params.ball_radius).unwrap();
    for model in [ModelKind::Contact, ModelKind::Rigid] {
        let still = [("reset_tilt", 0.0), ("reset_ball_speed", 0.3), ("reset_tilt_rate", 0.0)];
        let mut run = run("balance", Some(&terrain), model, 4, 1, &still);
        for i in 0..4 {
            let state = run.batch.state(i).unwrap();
            let (gap, normal) = ground.gap(&state.ball_position, params.ball_radius);
            assert!(gap.abs() < 1e-15);
            assert!(normal.dot(&state.ball_velocity).abs() < 1e-12);
            let lean = state.body_quaternion * nalgebra::Vector3::z();
            assert!(lean.xy().dot(&normal.xy()) < 0.0 && lean.xy().norm() > normal.xy().norm());
        }
        run.step(&[0.0; 12]).unwrap();
        for i in 0..4 {
            let contacts = run.batch.contacts(i).unwrap();
            assert!(contacts.floor_slip_velocity.norm() < 2e-3, "{model}: {}", contacts.floor_slip_velocity);
            assert!(contacts.wheel_slip_speeds.iter().all(|slip| slip.abs() < 2e-3));
        }
    }
}

#[test]
fn an_episode_that_leaves_the_terrain_is_truncated() {
    let small = Arc::new(Terrain::from_function(|x, _| 0.1 * x, [0.6, 0.6], 0.05).unwrap());
    let fast = [("reset_ball_speed", 2.0), ("reset_tilt", 0.0)];
    let mut run = run("bare", Some(&small), ModelKind::Contact, 8, 1, &fast);
    let mut left = 0;
    for _ in 0..200 {
        run.step(&[0.0; 24]).unwrap();
        left += run.truncated.iter().filter(|over| **over).count();
    }
    assert!(left > 0, "no robot rolled off");
    for i in 0..8 {
        assert!(run.batch.state(i).unwrap().ball_position.xy().amax() <= 0.3);
    }
}

#[test]
fn environments_reject_terrain_on_which_robots_cannot_start_or_differ() {
    let message = |terrain: Terrain, change: &dyn Fn(&mut dyn ballbot_core::batch::TaskConfig)| {
        let mut config = task_kind("balance").unwrap().config();
        config.set_terrain(Some(Arc::new(terrain)));
        change(&mut *config);
        config.batch(1, Autoreset::SameStep, Some(1), 0).err().expect("rejected").to_string()
    };
    let plane = |slope| Terrain::plane(slope, 0.3).unwrap();
    let steep = message(plane(0.25), &|_| ());
    assert!(steep.contains("is not below fall_tilt"), "{steep}");
    assert!(message(plane(0.95), &|_| ()).contains("no lean holds"));
    let tilted = Params { floor_tilt: [0.1, 0.0], ..Params::paper() };
    assert!(message(plane(0.1), &|config| config.set_params(tilted.clone())).contains("floor_tilt"));
}

#[test]
fn a_snapshot_of_an_environment_fits_only_its_terrain() {
    let mut first = run("balance", Some(&hills()), ModelKind::Contact, 2, 1, &[]);
    step(&mut first, 0);
    let bytes = [0, 1].map(|i| first.batch.save(i).unwrap());
    let mut same = run("balance", Some(&hills()), ModelKind::Contact, 2, 1, &[]);
    (0..2).for_each(|i| same.batch.load(i, &bytes[i]).unwrap());
    for k in 1..40 {
        step(&mut first, k);
        step(&mut same, k);
        (0..2).for_each(|i| assert_eq!(first.bits(i), same.bits(i)));
    }
    let mut level = run("balance", None, ModelKind::Contact, 2, 1, &[]);
    assert!(level.batch.load(0, &bytes[0]).is_err());
}
