//! Actuators ([`lag`], [`back_emf`]) and a sensor ([`delay`]) of another crate, each defined in one file, between a batch's
//! actions, robots and observations.

mod back_emf;
mod delay;
mod lag;

use crate::own_task::shuttle::Shuttle;
use crate::run::{Run, actions};
use back_emf::BackEmf;
use ballbot_core::actuator::{Actuator, Ideal};
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, EnvConfig, ResetRequest, Under};
use ballbot_core::control::Lqr;
use ballbot_core::lanes::{Memory, Scalar};
use ballbot_core::sensor::{Exact, Sensor};
use ballbot_core::task::{ACTION_LEN, Balance, Task};
use ballbot_core::{Ballbot, ModelKind, State, Wheels};
use delay::Delay;
use lag::Lag;

const SEED: u64 = 40;
const MODELS: [(ModelKind, usize); 3] = [(ModelKind::Contact, 11), (ModelKind::Spatial, 3), (ModelKind::Rigid, 3)];
/// Torque of an action of 1, N·m.
const TORQUE: f64 = 0.5;

/// Short episodes, some of which end in a fall.
fn config(model: ModelKind) -> BalanceConfig {
    BalanceConfig {
        model,
        max_episode_steps: 25,
        max_wheel_torque: Some(TORQUE),
        task: Balance { fall_tilt: 0.15, ..Balance::default() },
        ..BalanceConfig::default()
    }
}

fn batch<T: Task, A: Actuator, S: Sensor>(config: &EnvConfig<T>, actuator: &A, sensor: &S, n: usize) -> Run {
    Run::new(Batch::with_stages(config, actuator, sensor, n, Autoreset::SameStep, Some(1), SEED).unwrap())
}

fn lag() -> Lag {
    Lag { max_torque: TORQUE, share: 0.2 }
}

#[test]
fn ideal_stages_equal_the_plain_batch() {
    for (model, n) in MODELS {
        let config = config(model);
        let mut plain = Run::new(Batch::new(&config, n, Autoreset::SameStep, Some(1), SEED).unwrap());
        let mut ideal = batch(&config, &Ideal { max_torque: TORQUE }, &Exact, n);
        // The same torques, computed in each model step.
        let mut no_loss = batch(&config, &BackEmf { max_torque: TORQUE, loss: 0.0 }, &Exact, n);
        for k in 0..60 {
            for run in [&mut plain, &mut ideal, &mut no_loss] {
                run.step(&actions(0, n, k, 0.3)).unwrap();
            }
            for run in [&ideal, &no_loss] {
                assert!(run.all_bits() == plain.all_bits(), "{model}: step {k}");
            }
        }
    }
}

/// The robots of a batch with an actuator against single robots with the actuator's scalar arithmetic.
fn assert_equals_singles<A: Actuator>(actuator: &A) {
    for (model, n) in MODELS {
        let config = config(model);
        let mut run = batch(&config, actuator, &Exact, n);
        let mut plain = batch(&config, &Ideal { max_torque: TORQUE }, &Exact, n);
        // Starts that are given to every robot exactly.
        let starts: Vec<_> = (0..n).map(|i| Some(start(i, &config))).collect();
        let request = ResetRequest { starts: Some(&starts), ..Default::default() };
        run.batch.reset_with(&request, &mut run.observations).unwrap();
        plain.batch.reset_with(&request, &mut plain.observations).unwrap();
        let mut singles: Vec<_> = (0..n)
            .map(|i| {
                let mut robot = Ballbot::new(&config.params, model, config.sim_dt).unwrap();
                robot.reset(&start(i, &config)).unwrap();
                (robot, vec![0.0; A::MEMORY], false)
            })
            .collect();
        let mut differs = false;
        for k in 0..20 {
            let actions = actions(0, n, k, 0.1);
            run.step(&actions).unwrap();
            plain.step(&actions).unwrap();
            for (i, (robot, memory, over)) in singles.iter_mut().enumerate() {
                let commands = [0, 1, 2].map(|j| f64::from(actions[3 * i + j]));
                for _ in 0..config.substeps().unwrap() {
                    let mut memory = Memory::<f64>::new(Scalar, memory);
                    let torques = actuator.torques(Wheels(commands), robot.state().wheel_speeds, &mut memory);
                    robot.step(torques, 1).unwrap();
                }
                *over |= run.outcomes[i].done();
                if !*over {
                    assert_eq!(run.batch.state(i).unwrap(), robot.state(), "{model}: robot {i}, step {k}");
                    differs |= plain.batch.state(i).unwrap() != robot.state();
                }
            }
        }
        assert!(differs, "{model}: the actuator has no effect");
        assert!(singles.iter().filter(|(_, _, over)| !over).count() * 2 > n, "{model}: most robots fell");
    }
}

fn start(i: usize, config: &BalanceConfig) -> State {
    let wave = |k: usize| 0.02 * ((3 * i + k) as f64).sin();
    State::tilted(&config.params, [wave(0), wave(1)].into(), 50.0 * wave(2))
}

#[test]
fn lagging_motors_in_lanes_equal_single_robots() {
    assert_equals_singles(&lag());
}

#[test]
fn motors_with_back_emf_in_lanes_equal_single_robots() {
    assert_equals_singles(&BackEmf { max_torque: TORQUE, loss: 2e-3 });
}

#[test]
fn response_of_the_lag_is_its_closed_form() {
    for (model, n) in MODELS {
        let config = BalanceConfig { max_episode_steps: 1000, ..config(model) };
        let mut run = batch(&config, &lag(), &Exact, n);
        let starts = vec![Some(start(1, &config)); n];
        let request = ResetRequest { starts: Some(&starts), ..Default::default() };
        run.batch.reset_with(&request, &mut run.observations).unwrap();
        let mut robot = Ballbot::new(&config.params, model, config.sim_dt).unwrap();
        robot.reset(&start(1, &config)).unwrap();
        let commands = [0.02, -0.01, 0.03];
        let actions: Vec<f32> = commands.repeat(n);
        for k in 0..10 {
            run.step(&actions).unwrap();
            for substep in 0..5 {
                // After m steps the torque is the command times 1 − (1 − share)^m.
                let reached = 1.0 - 0.8_f64.powi(5 * k + substep + 1);
                robot.step(commands.map(|c| f64::from(c) * TORQUE * reached), 1).unwrap();
            }
            for i in 0..n {
                let (found, expected) = (run.batch.state(i).unwrap().to_array(), robot.state().to_array());
                let off = found.iter().zip(expected).map(|(f, e)| (f - e).abs()).fold(0.0, f64::max);
                assert!(off < 1e-9, "{model}: robot {i} is {off:e} off in step {k}");
            }
        }
    }
}

#[test]
fn memory_of_an_actuator_restarts_with_the_episode() {
    for (model, n) in MODELS {
        let config = BalanceConfig { max_episode_steps: 4, ..config(model) };
        let mut run = batch(&config, &lag(), &Exact, n);
        for k in 0..4 {
            run.step(&actions(0, n, k, 1.0)).unwrap();
        }
        // Each was reset by itself. Now all begin from the same start as a new batch.
        let mut fresh = batch(&config, &lag(), &Exact, n);
        for run in [&mut run, &mut fresh] {
            let seeds: Vec<_> = (0..n as u64).map(Some).collect();
            run.batch.seed(&seeds).unwrap();
            run.reset(&vec![true; n]);
            run.last.fill(0.0);
        }
        for k in 0..3 {
            for run in [&mut run, &mut fresh] {
                run.step(&actions(0, n, k, 0.2)).unwrap();
            }
            assert!(run.all_bits() == fresh.all_bits(), "{model}: step {k}");
        }
    }
}

/// The delayed batch against the plain batch: except for the last actions, its rows are the rows of the previous step.
fn assert_delayed<T: Task>(config: &EnvConfig<T>, rows: &[usize], n: usize) {
    let mut plain = batch(config, &Ideal { max_torque: TORQUE }, &Exact, n);
    let mut delayed = batch(config, &Ideal { max_torque: TORQUE }, &Delay, n);
    let pick = |observation: &[f32]| rows.iter().map(|row| observation[*row].to_bits()).collect::<Vec<_>>();
    let model = config.model;
    let mut ends = 0;
    for i in 0..n {
        assert_eq!(delayed.observation(i), plain.observation(i), "{model}: the first reading is delayed");
    }
    for k in 0..60 {
        let before: Vec<_> = (0..n).map(|i| pick(plain.observation(i))).collect();
        for run in [&mut plain, &mut delayed] {
            run.step(&actions(0, n, k, 0.2)).unwrap();
        }
        for (i, before) in before.iter().enumerate() {
            let label = format!("{model}: environment {i}, step {k}");
            // The reward depends on the state itself.
            assert_eq!(delayed.batch.state(i).unwrap(), plain.batch.state(i).unwrap(), "{label}");
            assert_eq!(delayed.outcomes[i], plain.outcomes[i], "{label}");
            if delayed.outcomes[i].done() {
                ends += 1;
                assert_eq!(pick(delayed.final_observation(i)), *before, "{label}");
                assert_eq!(delayed.observation(i), plain.observation(i), "{label}: memory outlives the episode");
            } else {
                assert_eq!(pick(delayed.observation(i)), *before, "{label}");
                assert_ne!(pick(plain.observation(i)), *before, "{label}: nothing moves");
            }
        }
    }
    assert!(ends > n, "{model}: only {ends} episodes ended");
}

#[test]
fn delayed_rows_equal_the_previous_step() {
    for (model, n) in MODELS {
        assert_delayed(&config(model), &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12], n);
    }
}

/// A new command shows at once, and the reading stays the reading of its step.
#[test]
fn delay_is_one_step_under_changing_commands() {
    for (model, n) in MODELS {
        let config = EnvConfig::<Shuttle> {
            model,
            max_episode_steps: 25,
            max_wheel_torque: Some(TORQUE),
            task: Shuttle { interval: 3.0, ..Shuttle::default() },
            ..EnvConfig::default()
        };
        assert_delayed(&config, &[0, 1, 2, 3, 4, 5, 6], n);
        let mut plain = batch(&config, &Ideal { max_torque: TORQUE }, &Exact, n);
        let mut delayed = batch(&config, &Ideal { max_torque: TORQUE }, &Delay, n);
        for k in 0..60 {
            for run in [&mut plain, &mut delayed] {
                run.step(&actions(0, n, k, 0.2)).unwrap();
            }
            for i in 0..n {
                assert_eq!(delayed.observation(i)[7..9], plain.observation(i)[7..9], "{model}: step {k}");
            }
        }
    }
}

/// The state of the previous step, or of the start.
#[test]
fn controllers_use_the_last_readings_of_a_sensor() {
    for (model, n) in MODELS {
        let config = config(model);
        let law = Lqr::new(&config.params, config.control_dt).unwrap();
        let control = |run: &mut Run, privileged: bool| {
            let mut actions = vec![0.0; n * ACTION_LEN];
            run.batch.control(&Under { privileged, ..Under::new(&law) }, &mut actions).unwrap();
            actions
        };
        let mut plain = batch(&config, &Ideal { max_torque: TORQUE }, &Exact, n);
        let mut delayed = batch(&config, &Ideal { max_torque: TORQUE }, &Delay, n);
        let mut before = control(&mut plain, false);
        for k in 0..60 {
            let (now, found) = (control(&mut plain, false), control(&mut delayed, false));
            assert_eq!(control(&mut delayed, true), now, "{model}: step {k}");
            for i in 0..n {
                let begins = k == 0 || plain.outcomes[i].done();
                let expected = if begins { &now } else { &before };
                let part = i * ACTION_LEN..(i + 1) * ACTION_LEN;
                assert_eq!(found[part.clone()], expected[part], "{model}: environment {i}, step {k}");
            }
            before = now;
            for run in [&mut plain, &mut delayed] {
                run.step(&actions(0, n, k, 0.2)).unwrap();
            }
        }
    }
}

#[test]
fn snapshots_carry_the_memory_of_stages() {
    for (model, n) in MODELS {
        let config = config(model);
        let mut run = batch(&config, &lag(), &Delay, n);
        let mut other = batch(&config, &lag(), &Delay, n);
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
        // Stages with other numbers reject it.
        let mut plain = batch(&config, &Ideal { max_torque: TORQUE }, &Exact, n);
        let error = plain.batch.load(0, &run.batch.save(0).unwrap()).unwrap_err().to_string();
        assert!(error.contains("its task or stages keep other numbers"), "{error}");
    }
}

#[test]
fn stages_do_not_depend_on_threads() {
    let config = config(ModelKind::Contact);
    let run = |threads: usize| {
        let batch = Batch::with_stages(&config, &lag(), &Delay, 1021, Autoreset::SameStep, Some(threads), SEED);
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
