//! Sensors in batches: motion, lanes, resets, seeds, snapshots, threads, histories, and what is rejected.

use super::models;
use crate::run::{Run, actions};
use ballbot_core::batch::{
    Autoreset, BalanceConfig, Batch, Environment, Event, History, Observation, ResetRequest, When,
};
use ballbot_core::fields::Fields;
use ballbot_core::options::{OptionTable, PublishedOptions};
use ballbot_core::sensor::{Readings, SensorOptions};
use ballbot_core::task::Balance;
use ballbot_core::{ModelKind, Params};
use std::f64::consts::PI;
use std::path::Path;

const SEED: u64 = 40;
/// Rows of an observation.
const ROWS: usize = 16;

/// Every error at once.
fn everything() -> SensorOptions {
    SensorOptions {
        gyro_noise: 0.001,
        gyro_bias: 0.02,
        gyro_bias_walk: 0.01,
        gyro_range: 5.0,
        accelerometer_noise: 0.01,
        accelerometer_bias: 0.1,
        accelerometer_bias_walk: 0.05,
        accelerometer_range: 30.0,
        imu_position: [0.01, 0.0, 0.2],
        imu_misalignment: 0.02,
        imu_rate: 200.0,
        encoder_ticks: 4096.0,
        encoder_rate: 1e3,
        latency: 0.02,
    }
}

/// Short episodes, some of which end in a fall, observed through sensors with every error.
fn config(model: ModelKind) -> BalanceConfig {
    BalanceConfig {
        model,
        max_episode_steps: 25,
        max_wheel_torque: Some(0.5),
        sensors: Some(everything()),
        observation: Observation::Sensors,
        history: History::Last(3),
        task: Balance { fall_tilt: 0.15, ..Balance::default() },
        ..BalanceConfig::default()
    }
}

/// The same with samples in every second and every third control step, which no estimator accepts.
fn slow(model: ModelKind) -> BalanceConfig {
    let sensors = SensorOptions { imu_rate: 50.0, encoder_rate: 33.0, ..everything() };
    BalanceConfig { sensors: Some(sensors), observation: Observation::GroundTruth, ..config(model) }
}

/// Models, how many robots of each, and configurations: observed through sensors, and with slower sensors.
fn configs() -> impl Iterator<Item = (ModelKind, usize, BalanceConfig)> {
    models().into_iter().flat_map(|(model, n)| [config(model), slow(model)].map(|config| (model, n, config)))
}

fn batch(config: &BalanceConfig, n: usize, mode: Autoreset) -> Run {
    Run::new(Batch::new(config, n, mode, Some(1), SEED).unwrap())
}

fn bits(readings: &Readings<f64>) -> Vec<u64> {
    let (w, s) = (readings.gyro, readings.specific_force);
    let numbers = [w.x, w.y, w.z, s.x, s.y, s.z].into_iter().chain(readings.wheel_angles).chain(readings.wheel_rates);
    numbers.map(f64::to_bits).collect()
}

/// Results of a step of all environments, including readings.
fn shown(run: &Run) -> Vec<Vec<u64>> {
    let mut all = run.all_bits();
    for (i, row) in all.iter_mut().enumerate() {
        row.extend(bits(&run.batch.readings(i).unwrap()));
    }
    all
}

/// Motion, rewards, ends, starts and events are the same as without sensors, to the last bit, in every reset mode.
#[test]
fn sensors_change_nothing_else() {
    let push = Event { when: When::Every([0.05, 0.1]), ..Event::new("push", [0.0, 0.3]) };
    let events = vec![push, Event::new("body_mass", [1.9, 2.3])];
    for (model, n) in models() {
        for mode in [Autoreset::SameStep, Autoreset::NextStep] {
            let config = BalanceConfig { events: events.clone(), ..config(model) };
            let none = BalanceConfig {
                sensors: None,
                observation: Observation::GroundTruth,
                history: History::default(),
                ..config.clone()
            };
            let unseen = BalanceConfig { sensors: Some(everything()), ..none.clone() };
            let mut runs = [&none, &unseen, &config].map(|config| batch(config, n, mode));
            for k in 0..60 {
                runs.iter_mut().for_each(|run| run.step(&actions(0, n, k, 0.2)).unwrap());
                let [plain, unseen, seen] = &runs;
                assert!(plain.all_bits() == unseen.all_bits(), "{model}, {mode:?}: step {k}");
                assert_eq!(plain.outcomes, seen.outcomes, "{model}, {mode:?}: step {k}");
                for i in 0..n {
                    assert_eq!(plain.batch.state(i).unwrap(), seen.batch.state(i).unwrap(), "{model}: step {k}");
                    let draws = |run: &Run| run.batch.draws(i).unwrap().iter().map(|v| v.to_bits()).collect::<Vec<_>>();
                    assert_eq!(draws(plain), draws(seen), "{model}: step {k}");
                    assert_eq!(plain.batch.params(i).unwrap(), seen.batch.params(i).unwrap());
                }
            }
        }
    }
}

#[test]
fn sensors_in_lanes_equal_single_environments() {
    for (model, n, config) in configs() {
        let config = BalanceConfig { task: Balance { fall_tilt: PI, ..Balance::default() }, ..config };
        let mut run = batch(&config, n, Autoreset::Disabled);
        let mut singles: Vec<_> = (0..n).map(|i| Environment::new(&config, SEED + i as u64).unwrap()).collect();
        let mut row = vec![0.0; 3 * ROWS];
        for (i, single) in singles.iter_mut().enumerate() {
            single.reset(&mut row);
            assert_eq!(row, run.observation(i), "{model}: environment {i}");
        }
        for k in 0..20 {
            // From then on the samples of neighboring robots are due in different steps.
            let again: Vec<_> = (0..n).map(|i| [(1, 7), (2, 8)].contains(&(i % 3, k))).collect();
            run.reset(&again);
            singles.iter_mut().zip(&again).filter(|(_, again)| **again).for_each(|(single, _)| single.reset(&mut row));
            let actions = actions(0, n, k, 0.05);
            run.step(&actions).unwrap();
            for (i, single) in singles.iter_mut().enumerate() {
                single.step(&actions[3 * i..][..3], &mut row);
                assert_eq!(row, run.observation(i), "{model}: environment {i}, step {k}");
                let read = bits(&run.batch.readings(i).unwrap());
                assert_eq!(bits(&single.readings().unwrap()), read, "{model}: environment {i}, step {k}");
            }
        }
    }
}

/// After any kind of reset, readings do not depend on the previous episode, only on the episode number.
#[test]
fn resets_empty_the_memory() {
    for (model, n, config) in configs() {
        for mode in [Autoreset::SameStep, Autoreset::NextStep, Autoreset::Disabled] {
            let task = Balance { fall_tilt: PI, ..Balance::default() };
            let config = BalanceConfig { max_episode_steps: 4, task, ..config.clone() };
            let (mut run, mut calm) = (batch(&config, n, mode), batch(&config, n, mode));
            for k in 0..if mode == Autoreset::NextStep { 5 } else { 4 } {
                run.step(&actions(0, n, k, 1.0)).unwrap();
                calm.step(&actions(0, n, k, 0.0)).unwrap();
            }
            for k in 0..4 {
                for run in [&mut run, &mut calm] {
                    if k == 0 && mode == Autoreset::Disabled {
                        run.reset(&vec![true; n]);
                    }
                    run.step(&actions(0, n, k, 0.2)).unwrap();
                    run.last.fill(0.0);
                }
                assert!(shown(&run) == shown(&calm), "{model}, {mode:?}: step {k}");
            }
        }
    }
}

/// A seed sets the errors of the next episodes; each episode and each environment has its own errors.
#[test]
fn errors_follow_seed_and_episode() {
    let config = BalanceConfig { max_episode_steps: 1000, ..config(ModelKind::Contact) };
    let start = ballbot_core::State::upright(&Params::paper());
    let starts = vec![Some(start); 9];
    let episode = |run: &mut Run, seeds: Option<u64>| {
        let seeds: Vec<_> = (0..9).map(|i| seeds.map(|seed| seed + i)).collect();
        let request = ResetRequest { starts: Some(&starts), seeds: Some(&seeds), ..ResetRequest::default() };
        run.batch.reset_with(&request, &mut run.observations).unwrap();
        (0..5)
            .map(|k| {
                run.step(&actions(0, 9, k, 0.0)).unwrap();
                (0..9).map(|i| bits(&run.batch.readings(i).unwrap())).collect::<Vec<_>>()
            })
            .collect::<Vec<_>>()
    };
    let mut run = batch(&config, 9, Autoreset::SameStep);
    let first = episode(&mut run, Some(3));
    let second = episode(&mut run, None);
    assert!(first != second);
    assert!(first == episode(&mut run, Some(3)));
    assert!(second == episode(&mut run, None));
    let shifted = episode(&mut run, Some(4));
    for step in 0..5 {
        for i in 0..8 {
            assert_eq!(shifted[step][i], first[step][i + 1]);
            assert_ne!(first[step][i], first[step][i + 1]);
        }
    }
    // A seed in the middle of an episode waits for the next one.
    let mut other = batch(&config, 9, Autoreset::SameStep);
    let (a, b) = (episode(&mut run, Some(5)), episode(&mut other, Some(5)));
    assert!(a == b);
    run.batch.seed(&[Some(9); 9]).unwrap();
    for run in [&mut run, &mut other] {
        run.step(&actions(0, 9, 0, 0.0)).unwrap();
    }
    for i in 0..9 {
        assert_eq!(bits(&run.batch.readings(i).unwrap()), bits(&other.batch.readings(i).unwrap()));
    }
}

#[test]
fn snapshots_carry_the_memory() {
    for (model, n, config) in configs() {
        let (mut run, mut other) = (batch(&config, n, Autoreset::SameStep), batch(&config, n, Autoreset::SameStep));
        for k in 0..7 {
            run.step(&actions(0, n, k, 0.2)).unwrap();
            other.step(&actions(0, n, k + 1, 0.2)).unwrap();
        }
        for (i, bytes) in run.snapshots().iter().enumerate() {
            other.batch.load(i, bytes).unwrap();
        }
        for k in 7..60 {
            for run in [&mut run, &mut other] {
                run.last.fill(0.0);
                run.step(&actions(0, n, k, 0.2)).unwrap();
            }
            assert!(shown(&run) == shown(&other), "{model}: step {k}");
        }
    }
}

#[test]
fn snapshots_with_other_sensors_are_rejected() {
    for (model, n) in models() {
        let config = config(model);
        let mut run = batch(&config, n, Autoreset::SameStep);
        let without = BalanceConfig { sensors: None, ..config.clone() };
        let truth = BalanceConfig { observation: Observation::GroundTruth, ..config.clone() };
        let short = BalanceConfig { history: History::Last(2), ..config.clone() };
        let exact = BalanceConfig { sensors: Some(SensorOptions::default()), ..config.clone() };
        for others in [without, truth, short, exact, slow(model)] {
            let mut others = batch(&others, n, Autoreset::SameStep);
            let (own, foreign) = (run.batch.save(0).unwrap(), others.batch.save(0).unwrap());
            for (bytes, to) in [(&own, &mut others), (&foreign, &mut run)] {
                let error = to.batch.load(0, bytes).unwrap_err().to_string();
                assert!(
                    error.contains("sensors, terrain, instruments, history or options of its task differ"),
                    "{error}"
                );
            }
        }
    }
}

/// An estimator is designed for the robot before events and `set_params`, which a snapshot does not store.
#[test]
fn snapshots_with_the_estimator_of_another_robot_are_rejected() {
    for (model, n) in models() {
        let seen = config(model);
        let truth = BalanceConfig { observation: Observation::GroundTruth, ..seen.clone() };
        for (config, taken) in [(seen, false), (truth, true)] {
            let heavy = Params { body_mass: 1.1 * config.params.body_mass, ..config.params.clone() };
            let mut other = batch(&BalanceConfig { params: heavy, ..config.clone() }, n, Autoreset::SameStep);
            let bytes = batch(&config, n, Autoreset::SameStep).batch.save(0).unwrap();
            let loaded = other.batch.load(0, &bytes);
            assert_eq!(loaded.is_ok(), taken, "{model}: {loaded:?}");
            if let Err(error) = loaded {
                assert!(error.to_string().contains("robot of the estimator"), "{error}");
            }
        }
    }
}

#[test]
fn sensors_do_not_depend_on_threads() {
    let run = |config: &BalanceConfig, threads: usize| {
        let batch = Batch::new(config, 517, Autoreset::SameStep, Some(threads), SEED);
        let mut run = Run::new(batch.unwrap());
        for k in 0..30 {
            run.step(&actions(0, 517, k, 0.2)).unwrap();
        }
        shown(&run)
    };
    for config in [config(ModelKind::Contact), slow(ModelKind::Contact)] {
        let expected = run(&config, 1);
        for threads in [2, 3] {
            assert!(run(&config, threads) == expected, "{threads} threads");
        }
    }
}

/// The chosen observations, oldest first; the first observation of an episode replaces earlier ones.
#[test]
fn history_has_the_observations_of_its_ages() {
    let histories = [History::Last(4), History::Ages(vec![0, 1, 2, 4, 8]), History::Ages(vec![0, 3])];
    for ((model, n), history) in models().into_iter().flat_map(|of| histories.clone().map(|history| (of, history))) {
        for mode in [Autoreset::SameStep, Autoreset::NextStep] {
            let ages = history.ages();
            let len = ages.last().unwrap() + 1;
            let seen = |past: &[Vec<f32>]| -> Vec<f32> {
                ages.iter().rev().flat_map(|age| past[len - 1 - age].clone()).collect()
            };
            let long = BalanceConfig { history: history.clone(), ..config(model) };
            let short = BalanceConfig { history: History::default(), ..long.clone() };
            let (mut run, mut one) = (batch(&long, n, mode), batch(&short, n, mode));
            let mut past: Vec<Vec<Vec<f32>>> = (0..n).map(|i| vec![one.observation(i).to_vec(); len]).collect();
            // Robots whose observations continue from a snapshot, in chunks whose rings are elsewhere.
            let mut other = batch(&long, n, mode);
            other.step(&actions(0, n, 0, 0.2)).unwrap();
            for k in 0..60 {
                let over: Vec<_> = one.outcomes.iter().map(|outcome| outcome.done()).collect();
                for run in [&mut run, &mut one] {
                    run.step(&actions(0, n, k, 0.2)).unwrap();
                }
                if k > 30 {
                    other.step(&actions(0, n, k, 0.2)).unwrap();
                }
                for (i, past) in past.iter_mut().enumerate() {
                    past.remove(0);
                    let done = one.outcomes[i].done();
                    if mode == Autoreset::SameStep && done {
                        past.push(one.final_observation(i).to_vec());
                        assert_eq!(run.final_observation(i), seen(past), "{model}: robot {i}, step {k}");
                    }
                    let begins = if mode == Autoreset::SameStep { done } else { over[i] };
                    past.push(one.observation(i).to_vec());
                    if begins {
                        *past = vec![one.observation(i).to_vec(); len];
                    }
                    assert_eq!(run.observation(i), seen(past), "{model}, {mode:?}: robot {i}, step {k}");
                    if k == 30 {
                        other.batch.load(i, &run.batch.save(i).unwrap()).unwrap();
                        assert_eq!(other.batch.save(i).unwrap(), run.batch.save(i).unwrap());
                    } else if k > 30 {
                        assert_eq!(other.observation(i), run.observation(i), "{model}, {mode:?}: robot {i}, step {k}");
                    }
                }
            }
        }
    }
}

#[test]
fn sensors_by_name_match_the_files_of_the_robots() {
    assert_eq!(SensorOptions::preset_names(), ["exact", "kugle"]);
    assert_eq!(SensorOptions::preset("exact").unwrap(), SensorOptions::default());
    let kugle = SensorOptions::preset("kugle").unwrap();
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../crates/ballbot-base/robots/kugle.toml");
    assert_eq!(SensorOptions::from_toml_file(&file).unwrap(), kugle);
    // Deviations at the 200 Hz at which they were measured.
    assert!((kugle.gyro_noise.powi(2) * 200.0 / 7.7e-6 - 1.0).abs() < 1e-3);
    assert!((kugle.accelerometer_noise.powi(2) * 200.0 / 1.4e-4 - 1.0).abs() < 1e-3);
    assert!((kugle.encoder_ticks - 4.0 * 4096.0 * 13.0 / 3.0).abs() < 1e-6);
    for (text, part) in [
        ("latency = 0.01", "there is no table [sensors]"),
        ("sensors = 3", "sensors = 3 is not a table"),
        ("[sensors]\nnoise = 1", "unknown option of sensors 'noise'"),
        ("[sensors]\nlatency = -1", "sensors.latency = -1"),
    ] {
        let error = SensorOptions::from_toml(text).unwrap_err().to_string();
        assert!(error.contains(part), "'{part}' is not in: {error}");
    }
    let error = SensorOptions::preset("paper").unwrap_err().to_string();
    assert!(error.contains("unknown sensors 'paper': expected one of exact, kugle"), "{error}");
}

fn assert_rejected(config: &BalanceConfig, parts: &[&str]) {
    let batch = Batch::new(config, 2, Autoreset::SameStep, Some(1), 0).err();
    let single = Environment::new(config, 0).err();
    for error in [batch, single] {
        let error = error.unwrap_or_else(|| panic!("{:?} was taken", config.sensors)).to_string();
        for part in parts {
            assert!(error.contains(part), "'{part}' is not in: {error}");
        }
    }
}

#[test]
fn every_bad_number_is_named() {
    let rejected = |sensors: SensorOptions, parts: &[&str]| {
        assert_rejected(&BalanceConfig { sensors: Some(sensors), ..BalanceConfig::default() }, parts);
    };
    for (index, field) in SensorOptions::FIELDS.iter().enumerate() {
        for bad in [-1e4, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e10] {
            let mut options = everything();
            *options.values_mut(index).last_mut().unwrap() = bad;
            rejected(options, &[&format!("sensors.{}", field.name), "out of range"]);
        }
    }
    let none = SensorOptions::default();
    rejected(SensorOptions { encoder_ticks: 0.5, ..none }, &["sensors.encoder_ticks = 0.5", "at least 1"]);
    rejected(SensorOptions { gyro_range: 1e-9, ..none }, &["sensors.gyro_range", "at least 0.000001"]);
    for latency in [0.005, 0.0101] {
        let parts = ["sensors.latency", "whole number", &format!("latency = {latency} s"), "control_dt = 0.01 s"];
        rejected(SensorOptions { latency, ..none.clone() }, &parts);
    }
    rejected(SensorOptions { latency: 1.01, ..none }, &["= 101", "at most 100"]);
    for name in ["imu_rate", "encoder_rate"] {
        let rate = |rate: f64| {
            let mut sensors = none.clone();
            sensors.set(name, &[rate]).unwrap();
            sensors
        };
        rejected(rate(1e-4), &[&format!("sensors.{name} = 0.0001 "), "0 (every control step) or at least 0.001 Hz"]);
        rejected(rate(2e6), &[&format!("sensors.{name} = 2000000 "), "Hz"]);
        let seen = |rate_of: f64| {
            let observation = Observation::Sensors;
            BalanceConfig { sensors: Some(rate(rate_of)), observation, ..BalanceConfig::default() }
        };
        assert_rejected(&seen(50.0), &[&format!("sensors.{name} = 50 "), "at least the control rate, 100 Hz"]);
        for taken in [100.0, 150.0, 1e6] {
            batch(&seen(taken), 1, Autoreset::SameStep);
        }
    }
    for count in [0, 1001] {
        let config = BalanceConfig { history: History::Last(count), ..BalanceConfig::default() };
        assert_rejected(&config, &[&format!("history = {count}"), ">= 1 and <= 1000"]);
    }
    for (ages, reason) in [
        (vec![], "the first age must be 0"),
        (vec![1, 2], "the first age must be 0"),
        (vec![0, 4, 4], "ages must ascend, but 4 follows 4"),
        (vec![0, 4, 2], "ages must ascend, but 2 follows 4"),
        (vec![0, 1001], "the age 1001 must be at most 1000 control steps"),
    ] {
        let config = BalanceConfig { history: History::Ages(ages.clone()), ..BalanceConfig::default() };
        assert_rejected(&config, &[&format!("history = {ages:?}"), reason]);
    }
    assert_eq!(History::of_ages(&[0.0, 1.0, 2.0]).unwrap(), History::Last(3));
    batch(&BalanceConfig { history: History::Ages(vec![0, 1000]), ..BalanceConfig::default() }, 1, Autoreset::SameStep);
    let error = SensorOptions::from_fields([("gyro", &[1.0][..])]).unwrap_err().to_string();
    assert!(error.contains("unknown option of sensors 'gyro': expected one of gyro_noise"), "{error}");
    let error = SensorOptions::from_fields([("imu_position", &[1.0][..])]).unwrap_err().to_string();
    assert!(error.contains("sensors.imu_position has 1 values, expected 3"), "{error}");
    let slow = BalanceConfig { control_dt: 2.0, observation: Observation::Sensors, ..BalanceConfig::default() };
    assert_rejected(&slow, &["control_dt = 2 is out of range", "<= 1 s"]);
    let mut run = batch(&BalanceConfig::default(), 1, Autoreset::SameStep);
    let error = run.batch.readings(0).unwrap_err().to_string();
    assert!(error.contains("the robots have no sensors"), "{error}");
    assert!(run.batch.privileged_observation(0, &mut [0.0; 3]).is_err());
}
