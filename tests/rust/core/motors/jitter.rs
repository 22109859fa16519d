//! Random dead times.

use super::{TORQUE, everything, models};
use crate::run::{Run, actions};
use ballbot_core::actuator::{Actuator, MotorOptions, Motors};
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, ResetRequest};
use ballbot_core::lanes::{Memory, Scalar};
use ballbot_core::task::Balance;
use ballbot_core::{ModelKind, Params, State, Wheels};

const SIM_DT: f64 = 0.002;
const SUBSTEPS: usize = 5;

/// The number of the command that acts in each model step, 0 before the first, under commands 1, 2, ... .
fn arrivals(delay: f64, delay_jitter: f64, key: [u32; 2], episode: u32, commands: usize) -> Vec<usize> {
    let options = MotorOptions { delay, delay_jitter, ..MotorOptions::default() };
    let motors = Motors::new(&options, &Params::paper(), 1.0, SIM_DT, SUBSTEPS).unwrap();
    let mut memory = vec![0.0; motors.memory_len()];
    motors.begin(key, episode, &mut memory);
    let mut found = Vec::new();
    for k in 1..=commands {
        for _ in 0..SUBSTEPS {
            let command = k as f64 / 1024.0;
            let commands = Wheels([command, -command, 0.5 * command]);
            let torques = motors.torques(commands, Wheels::default(), &mut Memory::new(Scalar, &mut memory));
            // All three motors get one command.
            assert_eq!(torques, Wheels([torques[0], -torques[0], 0.5 * torques[0]]));
            found.push((torques[0] * 1024.0) as usize);
        }
    }
    found
}

/// Model steps between each command and its arrival; `None` if a newer command came first.
fn latencies(arrivals: &[usize], commands: usize) -> Vec<Option<usize>> {
    (1..=commands).map(|k| arrivals.iter().position(|&now| now == k).map(|at| at - SUBSTEPS * (k - 1))).collect()
}

#[test]
fn each_command_has_a_separate_delay() {
    const COMMANDS: usize = 4000;
    // Two model steps and up to three more: commands come in order.
    let found = arrivals(0.004, 0.006, [7, 8], 1, COMMANDS);
    let mut counts = [0_usize; 4];
    for latency in &latencies(&found, COMMANDS)[..COMMANDS - 1] {
        counts[latency.unwrap() - 2] += 1;
    }
    // 1000 expected in each, with a standard deviation of 27.
    assert!(counts.iter().all(|count| (890..=1110).contains(count)), "{counts:?}");
}

#[test]
fn a_newer_command_is_not_followed_by_an_older_one() {
    const COMMANDS: usize = 1000;
    // Up to twelve model steps, more than two control steps.
    let found = arrivals(0.0, 0.024, [7, 8], 1, COMMANDS);
    assert!(found.is_sorted());
    let waited = latencies(&found, COMMANDS);
    let overtaken = waited.iter().filter(|latency| latency.is_none()).count();
    // A command with a latency of 5 + k is overtaken by the next command with up to k, or by the command after that.
    assert!((180..300).contains(&overtaken), "{overtaken}");
    assert!(waited.iter().flatten().all(|&latency| latency <= 12) && waited.contains(&Some(12)));
}

#[test]
fn dead_times_depend_only_on_key_and_episode() {
    let of = |key: [u32; 2], episode: u32| arrivals(0.004, 0.006, key, episode, 100);
    let first = of([7, 8], 1);
    assert_eq!(first, of([7, 8], 1));
    for (key, episode) in [([7, 8], 2), ([8, 8], 1), ([7, 9], 1)] {
        assert_ne!(first, of(key, episode));
    }
}

/// Batches, resets, snapshots and threads.
#[test]
fn random_dead_times_match_the_environment() {
    let actuators = MotorOptions { delay_jitter: 0.014, ..everything() };
    for (model, n) in models() {
        let config = BalanceConfig {
            model,
            max_episode_steps: 12,
            max_wheel_torque: Some(TORQUE),
            actuators: actuators.clone(),
            task: Balance { fall_tilt: std::f64::consts::PI, ..Balance::default() },
            ..BalanceConfig::default()
        };
        let new = |n: usize, threads: usize, seed: u64| {
            Run::new(Batch::new(&config, n, Autoreset::SameStep, Some(threads), seed).unwrap())
        };
        let (mut all, mut last, mut restored) = (new(n, 2, 3), new(1, 1, 3 + n as u64 - 1), new(n, 1, 90));
        for k in 0..40 {
            if k == 17 {
                for (i, bytes) in all.snapshots().iter().enumerate() {
                    restored.batch.load(i, bytes).unwrap();
                }
                restored.last.copy_from_slice(&all.last);
            }
            all.step(&actions(0, n, k, 0.2)).unwrap();
            last.step(&actions(n - 1, 1, k, 0.2)).unwrap();
            restored.step(&actions(0, n, k, 0.2)).unwrap();
            assert!(all.bits(n - 1) == last.bits(0), "{model}, step {k}");
            if k >= 17 {
                restored.last.copy_from_slice(&all.last);
                assert!(all.all_bits() == restored.all_bits(), "{model}, step {k}");
            }
        }
    }
}

#[test]
fn seeds_have_separate_dead_times() {
    let actuators = MotorOptions { delay_jitter: 0.014, ..MotorOptions::default() };
    let config = BalanceConfig { model: ModelKind::Contact, actuators, ..BalanceConfig::default() };
    let mut seeds = [1, 2].map(|seed| Run::new(Batch::new(&config, 1, Autoreset::Disabled, Some(1), seed).unwrap()));
    let start = [Some(State::upright(&config.params))];
    for run in &mut seeds {
        let request = ResetRequest { starts: Some(&start), ..Default::default() };
        run.batch.reset_with(&request, &mut run.observations).unwrap();
        (0..20).for_each(|k| run.step(&actions(0, 1, k, 0.3)).unwrap());
    }
    assert_ne!(seeds[0].batch.state(0).unwrap(), seeds[1].batch.state(0).unwrap());
}
