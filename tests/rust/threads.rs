//! Batches with enough work for several threads: results do not depend on the number of threads.

use ballbot_core::ModelKind;
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Outcome, StepBuffers};
use ballbot_core::task::{ACTION_LEN, Balance};

/// Bits of the observations, rewards and last observations of all steps, and their flags and outcomes.
#[derive(PartialEq)]
struct Run {
    numbers: Vec<u64>,
    flags: Vec<bool>,
    outcomes: Vec<Outcome>,
}

fn run(config: &BalanceConfig, n: usize, mode: Autoreset, threads: usize) -> Run {
    let mut batch = Batch::new(config, n, mode, Some(threads), 7).unwrap();
    assert_eq!(batch.num_threads(), threads);
    let mut observations = vec![0.0; n * batch.observation_len()];
    batch.reset(None, &mut observations).unwrap();
    let (mut rewards, mut last) = (vec![0.0; n], observations.clone());
    let (mut terminated, mut truncated) = (vec![false; n], vec![false; n]);
    let mut outcomes = vec![Outcome::default(); n];
    let mut all = Run { numbers: Vec::new(), flags: Vec::new(), outcomes: Vec::new() };
    for k in 0..30 {
        let actions: Vec<f32> = (0..n * ACTION_LEN).map(|i| 0.4 * ((i * 7 + k * 3) as f32).sin()).collect();
        let mut buffers = StepBuffers {
            observations: &mut observations,
            rewards: &mut rewards,
            terminated: &mut terminated,
            truncated: &mut truncated,
            final_observations: &mut last,
            outcomes: &mut outcomes,
        };
        batch.step(&actions, &mut buffers).unwrap();
        all.numbers.extend(observations.iter().chain(&last).map(|v| u64::from(v.to_bits())));
        all.numbers.extend(rewards.iter().map(|v| v.to_bits()));
        all.flags.extend(terminated.iter().chain(&truncated));
        all.outcomes.extend_from_slice(&outcomes);
    }
    all
}

/// With numbers of environments whose steps justify two or more worker threads.
fn assert_independent_of_threads(model: ModelKind, n: usize, threads: &[usize]) {
    // Short episodes, many of which end in a fall.
    let config = BalanceConfig {
        model,
        max_episode_steps: 20,
        max_wheel_torque: Some(1.0),
        task: Balance { reset_tilt: 0.15, fall_tilt: 0.2, ..Balance::default() },
        ..BalanceConfig::default()
    };
    for mode in [Autoreset::NextStep, Autoreset::SameStep] {
        let expected = run(&config, n, mode, threads[0]);
        let falls = expected.outcomes.iter().filter(|outcome| outcome.terminated.is_some()).count();
        let ends = expected.outcomes.iter().filter(|outcome| outcome.truncated).count();
        assert!(falls > n / 10 && ends > n / 10, "{falls} falls and {ends} ends prove little");
        for &threads in &threads[1..] {
            let found = run(&config, n, mode, threads);
            assert!(found == expected, "{model}, {mode:?}: {threads} threads differ from one");
        }
    }
}

#[test]
fn contact_batches_do_not_depend_on_threads() {
    assert_independent_of_threads(ModelKind::Contact, 1024, &[1, 2, 3]);
}

/// The last block is not full.
#[test]
fn contact_batches_with_a_partial_block_do_not_depend_on_threads() {
    assert_independent_of_threads(ModelKind::Contact, 1021, &[1, 2, 3]);
}

#[test]
fn spatial_batches_do_not_depend_on_threads() {
    assert_independent_of_threads(ModelKind::Spatial, 64, &[1, 2, 3]);
}

#[test]
fn rigid_batches_do_not_depend_on_threads() {
    assert_independent_of_threads(ModelKind::Rigid, 32, &[1, 2, 3]);
}
