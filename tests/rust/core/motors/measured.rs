//! Controllers on measured states: the states that the task observes, and the true states for a teacher.

use super::models;
use crate::run::Run;
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Event, Observation, Under, When};
use ballbot_core::control::{Controller, LimitOptions, Lqr, LqrWeights, Sampled};
use ballbot_core::options::PublishedOptions;
use ballbot_core::sensor::SensorOptions;
use ballbot_core::task::{ACTION_LEN, Balance};
use ballbot_core::{ModelKind, Params, State};
use nalgebra::Vector3;
use std::f64::consts::PI;

const SEED: u64 = 40;

fn sensors() -> SensorOptions {
    SensorOptions {
        gyro_noise: 0.001,
        gyro_bias: 0.02,
        accelerometer_noise: 0.01,
        imu_position: [0.01, 0.0, 0.2],
        imu_misalignment: 0.01,
        encoder_ticks: 4096.0,
        latency: 0.02,
        ..SensorOptions::default()
    }
}

/// Short episodes, some of which end in a fall, of randomized and pushed robots.
fn config(model: ModelKind) -> BalanceConfig {
    let push = Event { when: When::Every([0.05, 0.1]), ..Event::new("push", [0.0, 0.3]) };
    BalanceConfig {
        model,
        max_episode_steps: 25,
        sensors: Some(sensors()),
        observation: Observation::Sensors,
        events: vec![push, Event::new("body_mass", [1.9, 2.3])],
        task: Balance { fall_tilt: 0.15, ..Balance::default() },
        ..BalanceConfig::default()
    }
}

fn lqr(config: &BalanceConfig) -> Sampled<Lqr> {
    // The limit that the batch would set.
    let limits = LimitOptions { max_torque: Some(config.action_torque()), ..LimitOptions::TRACTION };
    Lqr::with_weights(&config.params, config.control_dt, &LqrWeights::default(), &limits).unwrap()
}

/// Actions of a law without memory, on states.
fn on(states: &[State], law: &Sampled<Lqr>, batch: &Batch) -> Vec<u32> {
    let mut law = law.clone();
    let torques = states.iter().flat_map(|state| law.wheel_torques(state, &Default::default()));
    torques.map(|torque| ((torque / batch.max_wheel_torque(0).unwrap()) as f32).to_bits()).collect()
}

fn estimates(batch: &Batch) -> Vec<State> {
    (0..batch.len()).map(|i| batch.estimate(i).unwrap()).collect()
}

fn control(batch: &mut Batch, under: &Under<'_>) -> Vec<u32> {
    let mut actions = vec![0.0; batch.len() * ACTION_LEN];
    batch.control(under, &mut actions).unwrap();
    actions.into_iter().map(f32::to_bits).collect()
}

#[test]
fn controllers_observe_what_the_task_observes() {
    for (model, n) in models() {
        for mode in [Autoreset::SameStep, Autoreset::NextStep] {
            let measured = config(model);
            let truth = BalanceConfig { observation: Observation::GroundTruth, ..measured.clone() };
            let law = lqr(&measured);
            let (seen, teacher) = (Under::new(&law), Under { privileged: true, ..Under::new(&law) });
            let mut run = Run::new(Batch::new(&measured, n, mode, Some(1), SEED).unwrap());
            let mut exact = Run::new(Batch::new(&truth, n, mode, Some(1), SEED).unwrap());
            let (mut actions, mut ends) = (vec![0.0; n * ACTION_LEN], 0);
            for k in 0..60 {
                let label = format!("{model}, {mode:?}: step {k}");
                let states: Vec<_> = run.batch.states().collect();
                let before = run.snapshots();
                let found = control(&mut run.batch, &seen);
                assert_eq!(found, on(&estimates(&run.batch), &law, &run.batch), "{label}");
                assert_ne!(found, on(&states, &law, &run.batch), "{label}");
                assert_eq!(control(&mut run.batch, &teacher), on(&states, &law, &run.batch), "{label}");
                assert!(run.snapshots() == before, "{label}: something moved");
                for under in [&seen, &teacher] {
                    let states: Vec<_> = exact.batch.states().collect();
                    assert_eq!(control(&mut exact.batch, under), on(&states, &law, &exact.batch), "{label}");
                }
                run.step_under(&seen, &mut actions).unwrap();
                assert_eq!(actions.iter().map(|a| a.to_bits()).collect::<Vec<_>>(), found, "{label}");
                exact.step(&actions).unwrap();
                ends += run.outcomes.iter().filter(|outcome| outcome.done()).count();
            }
            assert!(ends > n, "{model}, {mode:?}: {ends} ends prove little");
        }
    }
}

/// As `Batch::estimate`, which then returns the robots at rest.
#[test]
fn controllers_before_the_first_reset_assume_robots_at_rest() {
    for (model, n) in models() {
        let config = config(model);
        let law = lqr(&config);
        let mut batch = Batch::new(&config, n, Autoreset::Disabled, Some(1), SEED).unwrap();
        let expected = on(&estimates(&batch), &law, &batch);
        assert_eq!(control(&mut batch, &Under::new(&law)), expected, "{model}");
        // Next to others that have begun.
        let mut observations = vec![0.0; n * batch.observation_len()];
        batch.reset(Some(&(0..n).map(|i| i % 2 == 0).collect::<Vec<_>>()), &mut observations).unwrap();
        let expected = on(&estimates(&batch), &law, &batch);
        assert_eq!(control(&mut batch, &Under::new(&law)), expected, "{model}");
    }
}

#[test]
fn loops_on_estimates_depend_neither_on_threads_nor_on_the_size_of_the_batch() {
    for model in [ModelKind::Contact, ModelKind::Spatial] {
        let config = config(model);
        let law = lqr(&config);
        let run = |n: usize, threads: usize, privileged: bool| {
            let mut run = Run::new(Batch::new(&config, n, Autoreset::SameStep, Some(threads), SEED).unwrap());
            let mut actions = vec![0.0; n * ACTION_LEN];
            for _ in 0..40 {
                run.step_under(&Under { privileged, ..Under::new(&law) }, &mut actions).unwrap();
            }
            run.all_bits()
        };
        let expected = run(37, 1, false);
        assert!(run(37, 2, false) == expected, "{model}: threads");
        assert!(run(1, 1, false)[..] == expected[..1], "{model}: one robot");
        assert!(run(11, 1, false)[..] == expected[..11], "{model}: eleven robots");
        assert!(run(37, 1, true) != expected, "{model}: a teacher has the same");
    }
}

#[test]
fn loops_on_estimates_continue_from_snapshots() {
    for (model, n) in models() {
        let config = config(model);
        let law = lqr(&config);
        let new = || Run::new(Batch::new(&config, n, Autoreset::SameStep, Some(1), SEED).unwrap());
        let (mut run, mut other) = (new(), new());
        let mut actions = vec![0.0; n * ACTION_LEN];
        (0..13).for_each(|_| run.step_under(&Under::new(&law), &mut actions).unwrap());
        for (i, snapshot) in run.snapshots().iter().enumerate() {
            other.batch.load(i, snapshot).unwrap();
        }
        for k in 0..40 {
            run.step_under(&Under::new(&law), &mut actions).unwrap();
            other.step_under(&Under::new(&law), &mut actions).unwrap();
            let states = |run: &Run| run.batch.states().map(|state| state.to_array()).collect::<Vec<_>>();
            assert_eq!(states(&run), states(&other), "{model}: step {k}");
        }
    }
}

#[test]
fn diverged_robots_do_not_affect_loops_on_estimates() {
    let config = BalanceConfig { task: Balance { fall_tilt: PI, ..Balance::default() }, ..config(ModelKind::Contact) };
    let law = lqr(&config);
    let run = |impulse: f64| {
        let mut run = Run::new(Batch::new(&config, 11, Autoreset::NextStep, Some(1), SEED).unwrap());
        let (mut actions, mut steps) = (vec![0.0; 33], Vec::new());
        for k in 0..20 {
            if k == 5 {
                run.batch.push(2, &Vector3::new(impulse, 0.0, 0.0), None).unwrap();
            }
            run.step_under(&Under::new(&law), &mut actions).unwrap();
            assert!(actions.iter().all(|a| a.is_finite()), "step {k}");
            control(&mut run.batch, &Under::new(&law));
            steps.push((run.all_bits(), run.outcomes[2].terminated));
        }
        steps
    };
    let (calm, found) = (run(0.0), run(1e4));
    assert_eq!(found[5].1, Some("diverged"));
    for (k, (found, calm)) in found.iter().zip(&calm).enumerate() {
        for i in (0..11).filter(|i| *i != 2) {
            assert!(found.0[i] == calm.0[i], "robot {i}, step {k}");
        }
    }
}

/// Twenty seconds each, at most 1 deg of tilt after the start and within 0.1 m.
#[test]
fn lqr_balances_on_the_estimates_of_published_sensors() {
    let sensors = Some(SensorOptions::preset("kugle").unwrap());
    for params in [Params::paper(), Params::preset("kugle").unwrap()] {
        let config = BalanceConfig {
            params,
            sensors: sensors.clone(),
            observation: Observation::Sensors,
            max_episode_steps: 5000,
            ..BalanceConfig::default()
        };
        let law = lqr(&config);
        let mut run = Run::new(Batch::new(&config, 16, Autoreset::Disabled, Some(1), SEED).unwrap());
        let mut actions = vec![0.0; 16 * ACTION_LEN];
        for k in 0..2000 {
            run.step_under(&Under::new(&law), &mut actions).unwrap();
            for state in run.batch.states().filter(|_| k >= 500) {
                let away = state.ball_position.xy().norm();
                assert!(state.tilt() < PI / 180.0 && away < 0.1, "tilt {}, {away} m away", state.tilt());
            }
        }
    }
}
