//! Motors in batches: lanes, resets, snapshots, threads, and robots that differ.

use super::{TORQUE, everything, models};
use crate::run::{Run, actions};
use ballbot_core::actuator::{Actuator, Ideal, MotorOptions};
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Environment, ResetRequest};
use ballbot_core::lanes::{Memory, Scalar};
use ballbot_core::sensor::Exact;
use ballbot_core::task::Balance;
use ballbot_core::{Ballbot, ModelKind, Params, State, Wheels};
use std::f64::consts::PI;

const SEED: u64 = 40;

/// Short episodes, some of which end in a fall.
fn config(model: ModelKind) -> BalanceConfig {
    BalanceConfig {
        model,
        max_episode_steps: 25,
        max_wheel_torque: Some(TORQUE),
        actuators: everything(),
        task: Balance { fall_tilt: 0.15, ..Balance::default() },
        ..BalanceConfig::default()
    }
}

fn batch(config: &BalanceConfig, n: usize) -> Run {
    Run::new(Batch::new(config, n, Autoreset::SameStep, Some(1), SEED).unwrap())
}

fn start(i: usize, params: &Params) -> State {
    let wave = |k: usize| 0.02 * ((3 * i + k) as f64).sin();
    State::tilted(params, [wave(0), wave(1)].into(), 50.0 * wave(2))
}

/// Robots of a batch against single robots with the scalar arithmetic of the motors; `robots` has the parameters of
/// each.
fn assert_equals_singles(model: ModelKind, robots: &[Params], size: f32) {
    let config = BalanceConfig { params: robots[0].clone(), ..config(model) };
    let (n, motors) = (robots.len(), config.motors().unwrap());
    let mut run = batch(&config, n);
    for (i, params) in robots.iter().enumerate() {
        run.batch.set_params(i, params).unwrap();
    }
    let starts: Vec<_> = robots.iter().enumerate().map(|(i, params)| Some(start(i, params))).collect();
    let request = ResetRequest { starts: Some(&starts), ..Default::default() };
    run.batch.reset_with(&request, &mut run.observations).unwrap();
    let mut singles: Vec<_> = (0..n)
        .map(|i| {
            let mut robot = Ballbot::new(&robots[i], model, config.sim_dt).unwrap();
            robot.reset(&start(i, &robots[i])).unwrap();
            (robot, vec![0.0; motors.memory_len()], false)
        })
        .collect();
    let mut compared = 0;
    for k in 0..24 {
        let actions = actions(0, n, k, size);
        run.step(&actions).unwrap();
        for (i, (robot, memory, over)) in singles.iter_mut().enumerate() {
            let commands = [0, 1, 2].map(|j| f64::from(actions[3 * i + j]));
            for _ in 0..config.substeps().unwrap() {
                let mut memory = Memory::<f64>::new(Scalar, memory);
                let torques = motors.torques(Wheels(commands), robot.state().wheel_speeds, &mut memory);
                robot.step(torques, 1).unwrap();
            }
            *over |= run.outcomes[i].done();
            if !*over {
                assert_eq!(run.batch.state(i).unwrap(), robot.state(), "{model}: robot {i}, step {k}");
                compared += 1;
            }
        }
    }
    assert!(compared > 12 * n, "{model}: only {compared} comparisons");
}

#[test]
fn motors_in_lanes_equal_single_robots() {
    for (model, n) in models() {
        assert_equals_singles(model, &vec![Params::paper(); n], 0.1);
    }
}

#[test]
fn motors_of_robots_that_differ_equal_single_robots() {
    let paper = Params::paper();
    let robots: Vec<_> = (0..11)
        .map(|i| {
            let factor = 1.0 + 0.02 * f64::from(i);
            Params { body_mass: paper.body_mass * factor, wheel_radius: paper.wheel_radius * factor, ..paper.clone() }
        })
        .collect();
    for (model, n) in models() {
        assert_equals_singles(model, &robots[..n], 0.1);
    }
}

#[test]
fn ideal_options_equal_the_ideal_stage_bit_for_bit() {
    for (model, n) in models() {
        let config = BalanceConfig { actuators: MotorOptions::default(), ..config(model) };
        let mut run = batch(&config, n);
        let ideal = Ideal { max_torque: TORQUE };
        let staged = Batch::with_stages(&config, &ideal, &Exact, n, Autoreset::SameStep, Some(1), SEED);
        let mut staged = Run::new(staged.unwrap());
        // The same torques, computed by motors that change nothing.
        let unlimited = MotorOptions { peak_torque: 5.0, ..MotorOptions::default() };
        let mut motors = batch(&BalanceConfig { actuators: unlimited, ..config }, n);
        for k in 0..60 {
            for run in [&mut run, &mut staged, &mut motors] {
                run.step(&actions(0, n, k, 0.3)).unwrap();
            }
            for other in [&staged, &motors] {
                assert!(run.all_bits() == other.all_bits(), "{model}: step {k}");
            }
        }
    }
}

/// Each effect by itself changes the motion.
#[test]
fn every_effect_acts() {
    let all = everything();
    let none = MotorOptions::default();
    let effects = [
        MotorOptions { delay: all.delay, ..none },
        MotorOptions { strength: all.strength, ..none },
        MotorOptions { lag: all.lag, ..none },
        MotorOptions { stall_torque: 0.05, no_load_speed: 10.0, ..none },
        MotorOptions { speed_limit: 0.5, ..none },
        MotorOptions { peak_torque: 0.02, ..none },
    ];
    for (model, n) in models() {
        let mut ideal = batch(&BalanceConfig { actuators: none.clone(), ..config(model) }, n);
        let mut runs = effects.clone().map(|actuators| batch(&BalanceConfig { actuators, ..config(model) }, n));
        for k in 0..12 {
            for run in runs.iter_mut().chain([&mut ideal]) {
                run.step(&actions(0, n, k, 0.2)).unwrap();
            }
        }
        for (run, effect) in runs.iter().zip(&effects) {
            for i in 0..n {
                assert_ne!(
                    run.batch.state(i).unwrap(),
                    ideal.batch.state(i).unwrap(),
                    "{model}, robot {i}: {effect:?}"
                );
            }
        }
    }
}

/// After any kind of reset, the torques of an episode depend only on its own commands.
#[test]
fn resets_empty_the_memory() {
    for (model, n) in models() {
        for mode in [Autoreset::SameStep, Autoreset::NextStep, Autoreset::Disabled] {
            let task = Balance { fall_tilt: PI, ..Balance::default() };
            let config = BalanceConfig { max_episode_steps: 4, task, ..config(model) };
            let new = || Run::new(Batch::new(&config, n, mode, Some(1), SEED).unwrap());
            // The first episodes have large commands in one batch and none in the other.
            let (mut run, mut calm) = (new(), new());
            for k in 0..if mode == Autoreset::NextStep { 5 } else { 4 } {
                run.step(&actions(0, n, k, 1.0)).unwrap();
                calm.step(&actions(0, n, k, 0.0)).unwrap();
                assert!(k != 3 || run.outcomes.iter().all(|outcome| outcome.truncated), "{model}, {mode:?}");
            }
            for k in 0..4 {
                for run in [&mut run, &mut calm] {
                    if k == 0 && mode == Autoreset::Disabled {
                        run.reset(&vec![true; n]);
                    }
                    run.last.fill(0.0);
                    run.step(&actions(0, n, k, 0.2)).unwrap();
                }
                for i in 0..n {
                    let (found, expected) = (run.batch.state(i).unwrap(), calm.batch.state(i).unwrap());
                    assert_eq!(found, expected, "{model}, {mode:?}: robot {i}, step {k}");
                }
            }
        }
    }
}

#[test]
fn snapshots_carry_the_memory() {
    for (model, n) in models() {
        let config = config(model);
        let (mut run, mut other) = (batch(&config, n), batch(&config, n));
        for k in 0..7 {
            run.step(&actions(0, n, k, 0.2)).unwrap();
            other.step(&actions(0, n, k + 1, 0.2)).unwrap();
        }
        for (i, bytes) in run.snapshots().iter().enumerate() {
            other.batch.load(i, bytes).unwrap();
        }
        run.last.fill(0.0);
        other.last.fill(0.0);
        for k in 7..60 {
            for run in [&mut run, &mut other] {
                run.step(&actions(0, n, k, 0.2)).unwrap();
            }
            assert!(run.all_bits() == other.all_bits(), "{model}: step {k}");
        }
        // Motors with a different number, but the same memory size, reject it.
        let stronger = MotorOptions { strength: [1.0; 3], ..everything() };
        let mut others = batch(&BalanceConfig { actuators: stronger, ..config.clone() }, n);
        let mut ideal = batch(&BalanceConfig { actuators: MotorOptions::default(), ..config.clone() }, n);
        for (from, to) in [(&run, &mut others), (&run, &mut ideal)] {
            let error = to.batch.load(0, &from.batch.save(0).unwrap()).unwrap_err().to_string();
            assert!(error.contains("or options of its task differ"), "{error}");
        }
        let error = run.batch.load(0, &ideal.batch.save(0).unwrap()).unwrap_err().to_string();
        assert!(error.contains("or options of its task differ"), "{error}");
    }
}

#[test]
fn motors_do_not_depend_on_threads() {
    let config = config(ModelKind::Contact);
    let run = |threads: usize| {
        let batch = Batch::new(&config, 1021, Autoreset::SameStep, Some(threads), SEED);
        let mut run = Run::new(batch.unwrap());
        for k in 0..30 {
            run.step(&actions(0, 1021, k, 0.2)).unwrap();
        }
        run.all_bits()
    };
    let expected = run(1);
    for threads in [2, 3] {
        assert!(run(threads) == expected, "{threads} threads");
    }
}

#[test]
fn single_environment_equals_its_place_in_a_batch() {
    for (model, n) in models() {
        let config = BalanceConfig { max_episode_steps: 1000, ..config(model) };
        let mut run = Run::new(Batch::new(&config, n, Autoreset::Disabled, Some(1), SEED).unwrap());
        for i in 0..n {
            let mut single = Environment::new(&config, SEED + i as u64).unwrap();
            let mut observation = vec![0.0; single.observation_len()];
            single.reset(&mut observation);
            assert_eq!(observation, run.observation(i), "{model}: environment {i}");
            let bytes = run.batch.save(i).unwrap();
            single.load(&bytes).unwrap();
            assert_eq!(single.save(), bytes, "{model}: environment {i}");
        }
        let mut singles: Vec<_> = (0..n).map(|i| Environment::new(&config, SEED + i as u64).unwrap()).collect();
        let mut observations = vec![0.0; singles[0].observation_len()];
        singles.iter_mut().for_each(|single| single.reset(&mut observations));
        for k in 0..10 {
            let actions = actions(0, n, k, 0.05);
            run.step(&actions).unwrap();
            for (i, single) in singles.iter_mut().enumerate() {
                let outcome = single.step(&actions[3 * i..][..3], &mut observations);
                assert_eq!(observations, run.observation(i), "{model}: environment {i}, step {k}");
                assert_eq!(outcome, run.outcomes[i], "{model}: environment {i}, step {k}");
                assert_eq!(single.robot().state(), run.batch.state(i).unwrap(), "{model}: environment {i}, step {k}");
            }
        }
    }
}
