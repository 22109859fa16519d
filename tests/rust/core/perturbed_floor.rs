//! Robots in lanes, each on a separate floor that moves, or on which friction differs from place to place.

use crate::payload::lopsided;
use crate::run::Run;
use ballbot_core::batch::{Autoreset, Event, ResetRequest, When, task_kind};
use ballbot_core::terrain::Terrain;
use ballbot_core::{Ballbot, ModelKind, Params};
use std::sync::Arc;

fn ice() -> Params {
    Params { floor_patch_size: 1e3, floor_patch_friction: [0.0; 2], ..Params::paper() }
}

/// Floors at rest, slippery, in patches, with a gradient, of a ship and of a tram, and payloads that move.
fn floors() -> Vec<Params> {
    let paper = Params::paper();
    let patches = |seed: f64| Params {
        floor_patch_size: 0.03,
        floor_patch_friction: [0.0, 0.2],
        floor_patch_seed: seed,
        ..paper
    };
    vec![
        paper.clone(),
        ice(),
        patches(1.0),
        Params {
            floor_tilt_amplitude: [0.1, 0.05],
            floor_tilt_phases: [0.2, 0.9],
            floor_tilt_period: 3.0,
            ..patches(2.0)
        },
        Params { floor_friction_gradient: [-3.0, 1.0], wheel_preload: 5.0, ..paper },
        Params { floor_acceleration: [1.0, -2.0], floor_acceleration_period: 0.7, ..paper },
        Params { floor_acceleration: [1.0, -2.0], floor_acceleration_rise: 0.3, floor_rolling_friction: 1e-3, ..paper },
        Params { roller_ripple: 2e-4, ..patches(3.0) },
        lopsided(&paper),
        Params { floor_acceleration: [1.0, -2.0], payload_amplitude: [0.02, 0.0, 0.01], ..lopsided(&paper) },
        paper,
    ]
}

fn batch(robots: &[Params], terrain: Option<&Arc<Terrain>>) -> Run {
    let mut config = task_kind("bare").unwrap().config();
    config.set_model(ModelKind::Contact);
    config.set_terrain(terrain.cloned());
    config.set("max_wheel_torque", &[0.5]).unwrap();
    let mut batch = config.batch(robots.len(), Autoreset::SameStep, Some(2), 5).unwrap();
    robots.iter().enumerate().for_each(|(i, params)| batch.set_params(i, params).unwrap());
    Run::new(batch)
}

/// Actions that tip robots over, in sixteenths.
fn action(i: usize, k: usize) -> [f32; 3] {
    [0, 1, 2].map(|wheel| ((i * 7 + wheel * 2 + k / 3) % 5) as f32 * 0.5 - 1.0)
}

fn grounds() -> [Option<Arc<Terrain>>; 2] {
    [None, Some(Arc::new(Terrain::generate("noise", 3, &[("slope", 0.15), ("wavelength", 0.8)]).unwrap()))]
}

#[test]
fn a_robot_in_lanes_equals_a_single_robot_on_its_floor_bit_for_bit() {
    let robots = floors();
    for terrain in grounds() {
        let mut many = batch(&robots, terrain.as_ref());
        let starts: Vec<_> = (0..robots.len()).map(|i| Some(many.batch.state(i).unwrap())).collect();
        let request = ResetRequest { starts: Some(&starts), ..Default::default() };
        many.batch.reset_with(&request, &mut many.observations).unwrap();
        let mut alone: Vec<_> = robots
            .iter()
            .enumerate()
            .map(|(i, params)| {
                let mut robot = Ballbot::new(params, ModelKind::Contact, 0.002).unwrap();
                robot.set_terrain(terrain.as_ref()).unwrap();
                robot.reset(starts[i].as_ref().unwrap()).unwrap();
                robot
            })
            .collect();
        let (mut over, mut compared, mut slid) = (vec![false; robots.len()], 0, 0);
        for k in 0..150 {
            let actions: Vec<_> = (0..robots.len()).flat_map(|i| action(i, k)).collect();
            many.step(&actions).unwrap();
            for (i, robot) in alone.iter_mut().enumerate() {
                over[i] |= many.terminated[i] || many.truncated[i];
                if over[i] {
                    continue;
                }
                robot.step(action(i, k).map(|a| f64::from(a) * 0.5), 5).unwrap();
                assert_eq!(robot.state(), many.batch.state(i).unwrap(), "robot {i} at step {k}");
                assert_eq!(robot.contacts(), many.batch.contacts(i).unwrap(), "robot {i} at step {k}");
                compared += 1;
                slid += u32::from(robot.contacts().floor_slip_velocity.norm() > 0.05);
            }
        }
        println!("{compared} steps, {slid} with slip");
        assert!(compared > 200 && slid > 20, "{compared} steps, {slid} with slip");
    }
}

#[test]
fn a_robot_on_ice_changes_no_bit_of_its_neighbors() {
    for terrain in grounds() {
        let still = vec![Params::paper(); 8];
        let mut slippery = still.clone();
        slippery[3] = ice();
        slippery[5] = Params { floor_acceleration: [3.0, 0.0], ..ice() };
        let (mut still, mut slippery) = (batch(&still, terrain.as_ref()), batch(&slippery, terrain.as_ref()));
        let mut differ = false;
        for k in 0..150 {
            let actions: Vec<_> = (0..8).flat_map(|i| action(i, k)).collect();
            still.step(&actions).unwrap();
            slippery.step(&actions).unwrap();
            for i in [0, 1, 2, 4, 6, 7] {
                assert_eq!(still.bits(i), slippery.bits(i), "robot {i} at step {k}");
            }
            differ |= still.batch.state(3).unwrap() != slippery.batch.state(3).unwrap();
        }
        assert!(differ);
    }
}

/// Events give each robot its own floor, and a snapshot restores it.
#[test]
fn events_draw_floors_that_snapshots_restore() {
    let events: Vec<_> = [
        Event::new("floor_tilt_amplitude", [0.0, 0.05]),
        Event::new("floor_tilt_period", [4.0, 12.0]),
        Event::new("floor_tilt_phases", [0.0, 6.0]),
        Event::new("floor_acceleration", [-0.5, 0.5]),
        Event::new("floor_patch_size", [0.1, 0.5]),
        Event { range: vec![[0.2, 0.4], [0.6, 1.0]], ..Event::new("floor_patch_friction", [0.0; 2]) },
        Event { when: When::At(0.5), ..Event::new("floor_friction_gradient", [-0.5, 0.5]) },
    ]
    .into();
    for model in [ModelKind::Contact, ModelKind::Rigid] {
        let make = || {
            let mut config = task_kind("balance").unwrap().config();
            config.set_model(model);
            config.set_events(events.clone());
            config.set("max_wheel_torque", &[0.5]).unwrap();
            Run::new(config.batch(10, Autoreset::SameStep, Some(2), 5).unwrap())
        };
        let (mut run, mut other) = (make(), make());
        let step = |run: &mut Run, k| run.step(&(0..10).flat_map(|i| action(i, k)).collect::<Vec<_>>()).unwrap();
        (0..70).for_each(|k| step(&mut run, k));
        let floor = |i: usize| run.batch.params(i).unwrap().floor_acceleration.map(f64::to_bits);
        assert!((0..10).all(|i| (0..i).all(|j| floor(i) != floor(j))), "each robot has its own");
        let saved: Vec<_> = (0..10).map(|i| run.batch.save(i).unwrap()).collect();
        (0..10).for_each(|i| other.batch.load(i, &saved[i]).unwrap());
        for k in 70..140 {
            step(&mut run, k);
            step(&mut other, k);
            for i in 0..10 {
                assert_eq!(
                    run.batch.state(i).unwrap(),
                    other.batch.state(i).unwrap(),
                    "{model}: robot {i} at step {k}"
                );
                assert_eq!(run.observation(i), other.observation(i), "{model}: robot {i} at step {k}");
                assert_eq!(run.batch.params(i).unwrap(), other.batch.params(i).unwrap());
            }
        }
    }
}
