//! Batches: each environment equals the single environment with its seed bit for bit, for any number of threads,
//! autoreset mode and neighbors; a rejected step changes nothing.

use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Environment, Outcome, StepBuffers};
use ballbot_core::task::{ACTION_LEN, Balance};
use ballbot_core::{Error, ModelKind};
use nalgebra::Vector3;

const MODES: [Autoreset; 3] = Autoreset::ALL;
/// Length of an observation of the balance task.
const OBSERVATION_LEN: usize = 16;
/// Content of buffers before a step.
const UNTOUCHED: f32 = -777.0;

/// Short episodes, some of which end in a fall.
fn config(model: ModelKind) -> BalanceConfig {
    BalanceConfig {
        model,
        max_episode_steps: 30,
        max_wheel_torque: Some(1.0),
        scale_observations: false,
        task: Balance { fall_tilt: 0.2, ..Balance::default() },
        ..BalanceConfig::default()
    }
}

/// Robots that start upright at rest and therefore stay upright.
fn calm(max_episode_steps: usize) -> BalanceConfig {
    let config = config(ModelKind::Spatial);
    let task = Balance { reset_tilt: 0.0, reset_ball_speed: 0.0, reset_tilt_rate: 0.0, ..config.task };
    BalanceConfig { max_episode_steps, task, ..config }
}

fn batch(config: &BalanceConfig, num_envs: usize, mode: Autoreset, threads: usize) -> Batch {
    let mut batch = Batch::new(config, num_envs, mode, Some(threads), 40).unwrap();
    batch.reset(None, &mut vec![0.0; num_envs * OBSERVATION_LEN]).unwrap();
    batch
}

/// Results of one step.
#[derive(Clone, Debug, PartialEq)]
struct Written {
    observations: Vec<f32>,
    rewards: Vec<f64>,
    terminated: Vec<bool>,
    truncated: Vec<bool>,
    final_observations: Vec<f32>,
    outcomes: Vec<Outcome>,
}

impl Written {
    fn new(n: usize) -> Self {
        Self {
            observations: vec![UNTOUCHED; n * OBSERVATION_LEN],
            rewards: vec![f64::from(UNTOUCHED); n],
            terminated: vec![false; n],
            truncated: vec![false; n],
            final_observations: vec![UNTOUCHED; n * OBSERVATION_LEN],
            outcomes: vec![Outcome::default(); n],
        }
    }

    fn buffers(&mut self) -> StepBuffers<'_> {
        StepBuffers {
            observations: &mut self.observations,
            rewards: &mut self.rewards,
            terminated: &mut self.terminated,
            truncated: &mut self.truncated,
            final_observations: &mut self.final_observations,
            outcomes: &mut self.outcomes,
        }
    }

    fn of(batch: &mut Batch, actions: &[f32]) -> Result<Self, Error> {
        let mut written = Self::new(batch.len());
        batch.step(actions, &mut written.buffers()).map(|()| written)
    }

    fn observation(&self, i: usize) -> &[f32] {
        &self.observations[i * OBSERVATION_LEN..][..OBSERVATION_LEN]
    }

    fn final_observation(&self, i: usize) -> &[f32] {
        &self.final_observations[i * OBSERVATION_LEN..][..OBSERVATION_LEN]
    }
}

/// Actions of step `k`, different for every environment.
fn actions(n: usize, k: usize) -> Vec<f32> {
    (0..n * ACTION_LEN).map(|i| 0.4 * ((i * 7 + k * 3) as f32).sin()).collect()
}

/// A single environment stepped under the contract of `mode`: observation, final observation, outcome of every step.
fn alone(config: &BalanceConfig, seed: u64, mode: Autoreset, steps: &[Vec<f32>]) -> Vec<(Vec<f32>, Vec<f32>, Outcome)> {
    let mut env = Environment::new(config, seed).unwrap();
    let mut seen = vec![0.0; OBSERVATION_LEN];
    env.reset(&mut seen);
    let mut over = false;
    let step = |action: &Vec<f32>| {
        let mut last = vec![UNTOUCHED; OBSERVATION_LEN];
        if over {
            over = false;
            env.reset(&mut seen);
            return (seen.clone(), last, Outcome::default());
        }
        let outcome = env.step(action, &mut seen);
        if outcome.done() {
            last.clone_from(&seen);
            if mode == Autoreset::SameStep {
                env.reset(&mut seen);
            }
        }
        over = outcome.done() && mode == Autoreset::NextStep;
        (seen.clone(), last, outcome)
    };
    steps.iter().map(step).collect()
}

#[test]
fn batched_environments_equal_single_ones() {
    // The contact model has eight environments per block.
    for (model, n, width) in [(ModelKind::Spatial, 7, 1), (ModelKind::Rigid, 7, 1), (ModelKind::Contact, 19, 8)] {
        let steps: Vec<Vec<f32>> = (0..100).map(|k| actions(n, k)).collect();
        let config = config(model);
        for mode in [Autoreset::NextStep, Autoreset::SameStep] {
            let singles: Vec<_> = (0..n)
                .map(|i| {
                    let own: Vec<_> = steps.iter().map(|a| a[i * ACTION_LEN..][..ACTION_LEN].to_vec()).collect();
                    alone(&config, 40 + i as u64, mode, &own)
                })
                .collect();
            for threads in [1, 2, 3, 5] {
                let mut batch = batch(&config, n, mode, threads);
                assert_eq!(batch.num_threads(), threads.min(n.div_ceil(width)));
                let mut ends = [0, 0];
                for (k, actions) in steps.iter().enumerate() {
                    let written = Written::of(&mut batch, actions).unwrap();
                    for (i, single) in singles.iter().enumerate() {
                        let (seen, last, outcome) = &single[k];
                        let label = format!("{model}, {mode:?}, {threads} threads, step {k}, environment {i}");
                        assert_eq!(written.observation(i), seen, "{label}");
                        assert_eq!(written.final_observation(i), last, "{label}");
                        assert_eq!(written.outcomes[i], *outcome, "{label}");
                        assert_eq!(written.rewards[i], outcome.reward, "{label}");
                        assert_eq!(written.terminated[i], outcome.terminated.is_some(), "{label}");
                        assert_eq!(written.truncated[i], outcome.truncated, "{label}");
                        ends[0] += usize::from(written.terminated[i]);
                        ends[1] += usize::from(written.truncated[i]);
                    }
                }
                assert!(ends[0] > 3 && ends[1] > 3, "too few episodes ended to prove anything: {ends:?}");
            }
        }
    }
}

#[test]
fn next_step_ignores_the_action_of_an_ended_episode() {
    let config = calm(5);
    let run = |last: f32| {
        let mut batch = batch(&config, 3, Autoreset::NextStep, 1);
        for k in 0..5 {
            let written = Written::of(&mut batch, &[0.1; 9]).unwrap();
            assert_eq!(written.truncated, [k == 4; 3]);
        }
        let reset = Written::of(&mut batch, &[last; 9]).unwrap();
        (reset, Written::of(&mut batch, &[0.1; 9]).unwrap())
    };
    let (reset, after) = run(1.0);
    assert_eq!((reset.clone(), after), run(-1.0), "the ignored action matters");
    assert_eq!((reset.rewards, reset.terminated, reset.truncated), (vec![0.0; 3], vec![false; 3], vec![false; 3]));
    assert_eq!(reset.observations[13..16], [0.0; 3], "a new episode has no last action");
}

#[test]
fn final_observations_are_written_of_ended_episodes_only() {
    let mut batch = batch(&calm(6), 4, Autoreset::SameStep, 2);
    batch.stagger();
    for k in 0..6 {
        let written = Written::of(&mut batch, &[0.1; 12]).unwrap();
        for i in 0..4 {
            let ended = k + 1 == 6 * (i + 1) / 4;
            assert_eq!(written.truncated[i], ended, "environment {i}, step {k}");
            if ended {
                assert_eq!(written.final_observation(i)[13..], [0.1; 3]);
                assert_eq!(written.observation(i)[13..], [0.0; 3], "not reset");
                assert!(written.rewards[i] != 0.0);
            } else {
                assert_eq!(written.final_observation(i), [UNTOUCHED; OBSERVATION_LEN]);
            }
        }
    }
}

fn saved(batch: &Batch) -> Vec<Vec<u8>> {
    (0..batch.len()).map(|i| batch.save(i).unwrap()).collect()
}

fn push(batch: &mut Batch, i: usize, impulse: f64) {
    batch.push(i, &Vector3::new(impulse, 0.0, 0.0), None).unwrap();
}

/// Asserts that a step is rejected and moves nothing; returns the message.
#[track_caller]
fn rejected(batch: &mut Batch, actions: &[f32]) -> String {
    let before = saved(batch);
    let error = Written::of(batch, actions).expect_err("accepted");
    assert!(saved(batch) == before, "rejected, but something moved: {error}");
    error.to_string()
}

#[test]
fn disabled_autoreset_requires_a_reset_after_the_end() {
    let mut batch = batch(&calm(5), 3, Autoreset::Disabled, 1);
    push(&mut batch, 1, 1e4);
    let written = Written::of(&mut batch, &[0.0; 9]).unwrap();
    assert_eq!(written.terminated, [false, true, false]);
    let message = rejected(&mut batch, &[0.0; 9]);
    assert!(message.contains("environment 1 is over"), "{message}");
    let mut observations = vec![UNTOUCHED; 3 * OBSERVATION_LEN];
    batch.reset(Some(&[false, true, false]), &mut observations).unwrap();
    for k in 0..4 {
        let written = Written::of(&mut batch, &[0.0; 9]).unwrap();
        assert_eq!(written.truncated, [k == 3, false, k == 3]);
        for i in 0..3 {
            let last = if written.truncated[i] { written.observation(i) } else { &[UNTOUCHED; OBSERVATION_LEN] };
            assert_eq!(written.final_observation(i), last, "environment {i}, step {k}");
        }
    }
    assert!(rejected(&mut batch, &[0.0; 9]).contains("environment 0 is over"));
}

#[test]
fn steps_before_the_first_reset_are_rejected() {
    for mode in MODES {
        let mut batch = Batch::new(&calm(2), 2, mode, Some(1), 0).unwrap();
        assert_eq!(batch.autoreset(), mode);
        let message = rejected(&mut batch, &[0.0; 6]);
        assert!(message.contains("reset"), "{mode:?}: {message}");
    }
}

#[test]
fn divergence_does_not_affect_neighbors() {
    for model in ModelKind::ALL {
        for threads in [1, 3] {
            let run = |impulse: f64| {
                let mut batch = batch(&config(model), 5, Autoreset::NextStep, threads);
                let mut written = Vec::new();
                for k in 0..60 {
                    if k == 10 {
                        push(&mut batch, 2, impulse);
                    }
                    written.push(Written::of(&mut batch, &actions(5, k)).unwrap());
                }
                written
            };
            let expected = run(0.0);
            for impulse in [1e3, 1e4] {
                let found = run(impulse);
                assert_eq!(found[10].outcomes[2].terminated, Some("diverged"), "{model}, {impulse} N·s");
                assert_eq!(found[11].outcomes[2], Outcome::default(), "{model}: not reset after {impulse} N·s");
                for (k, (f, e)) in found.iter().zip(&expected).enumerate() {
                    assert!(f.observations.iter().all(|v| v.is_finite()), "{model}, step {k}");
                    for i in [0, 1, 3, 4] {
                        assert_eq!(f.observation(i), e.observation(i), "{model}, step {k}, environment {i}");
                        assert_eq!(f.outcomes[i], e.outcomes[i], "{model}, step {k}, environment {i}");
                    }
                }
            }
        }
    }
}

#[test]
fn actions_that_are_not_finite_are_rejected() {
    for mode in MODES {
        let mut batch = batch(&config(ModelKind::Rigid), 4, mode, 2);
        Written::of(&mut batch, &actions(4, 0)).unwrap();
        for (bad, value) in [(5, f32::NAN), (9, f32::INFINITY), (0, f32::NEG_INFINITY)] {
            let mut actions = actions(4, 1);
            actions[bad] = value;
            let message = rejected(&mut batch, &actions);
            let name = format!("actions[{}, {}] = {value} ", bad / 3, bad % 3);
            assert!(message.starts_with(&name), "{message}, expected {name}");
        }
    }
}

type Change = fn(&mut Written);

#[test]
fn buffers_of_the_wrong_length_are_rejected() {
    let mut batch = batch(&calm(5), 2, Autoreset::SameStep, 1);
    assert!(rejected(&mut batch, &[0.0; 5]).starts_with("actions has 5 values, expected 6"));
    assert!(rejected(&mut batch, &[0.0; 9]).starts_with("actions has 9 values, expected 6"));
    let before = saved(&batch);
    let changes: [(&str, Change); 6] = [
        ("observations has 31 values, expected 32", |w| w.observations.truncate(31)),
        ("final observations has 0 values, expected 32", |w| w.final_observations.clear()),
        ("a step buffer has 1 values, expected 2", |w| w.rewards.truncate(1)),
        ("a step buffer has 3 values, expected 2", |w| w.terminated.push(false)),
        ("a step buffer has 1 values, expected 2", |w| w.truncated.truncate(1)),
        ("a step buffer has 0 values, expected 2", |w| w.outcomes.clear()),
    ];
    for (words, change) in changes {
        let mut written = Written::new(2);
        change(&mut written);
        let error = batch.step(&[0.0; 6], &mut written.buffers()).expect_err(words);
        assert_eq!(error.to_string(), words);
    }
    let error = batch.reset(None, &mut [0.0; 33]).unwrap_err();
    assert_eq!(error.to_string(), "observations has 33 values, expected 32");
    let error = batch.reset(Some(&[true]), &mut [0.0; 32]).unwrap_err();
    assert_eq!(error.to_string(), "reset mask has 1 values, expected 2");
    assert_eq!(batch.seed(&[None]).unwrap_err().to_string(), "seeds has 1 values, expected 2");
    assert!(saved(&batch) == before, "rejected, but something moved");
}

#[test]
fn mask_selects_the_environments_to_reset() {
    let config = config(ModelKind::Spatial);
    let mut batch = batch(&config, 3, Autoreset::Disabled, 1);
    let written = Written::of(&mut batch, &actions(3, 0)).unwrap();
    let before = saved(&batch);
    let mut observations = vec![UNTOUCHED; 3 * OBSERVATION_LEN];
    batch.reset(Some(&[true, false, true]), &mut observations).unwrap();
    // The others are unchanged, and so are their observations.
    assert_eq!(&observations[OBSERVATION_LEN..2 * OBSERVATION_LEN], written.observation(1));
    assert!(saved(&batch)[1] == before[1], "environment 1 was not to be reset");
    for i in [0, 2] {
        // The second start sampled from the seed.
        let mut env = Environment::new(&config, 40 + i as u64).unwrap();
        let mut expected = [0.0; OBSERVATION_LEN];
        env.reset(&mut expected);
        env.reset(&mut expected);
        assert_eq!(observations[i * OBSERVATION_LEN..][..OBSERVATION_LEN], expected);
    }
    // Seeds likewise.
    batch.seed(&[None, Some(7), None]).unwrap();
    batch.reset(None, &mut observations).unwrap();
    let mut expected = [0.0; OBSERVATION_LEN];
    Environment::new(&config, 7).unwrap().reset(&mut expected);
    assert_eq!(observations[OBSERVATION_LEN..][..OBSERVATION_LEN], expected);
}

#[test]
fn staggered_episodes_end_at_uniform_intervals() {
    for (n, steps) in [(5, 20), (7, 20), (50, 20)] {
        let mut batch = batch(&calm(steps), n, Autoreset::SameStep, 1);
        batch.stagger();
        let mut ended = vec![Vec::new(); n];
        for k in 1..=2 * steps {
            let written = Written::of(&mut batch, &vec![0.0; 3 * n]).unwrap();
            assert!(!written.terminated.contains(&true));
            (0..n).filter(|i| written.truncated[*i]).for_each(|i| ended[i].push(k));
        }
        for (i, ended) in ended.iter().enumerate() {
            let first = (steps * (i + 1) / n).max(1);
            // From the first reset on, episodes have their full length.
            let expected: Vec<_> = (first..=2 * steps).step_by(steps).collect();
            assert_eq!(*ended, expected, "environment {i} of {n}");
        }
    }
}

#[test]
fn invalid_batch_arguments_are_rejected() {
    let message = |n, threads| Batch::new(&calm(5), n, MODES[0], threads, 0).err().expect("accepted").to_string();
    assert!(message(0, None).starts_with("num_envs = 0"));
    assert!(message(2, Some(0)).starts_with("num_threads = 0"));
    let mut config = calm(5);
    config.task.fall_tilt = -1.0;
    let error = Batch::new(&config, 2, MODES[0], None, 0).err().expect("accepted");
    assert!(error.to_string().starts_with("fall_tilt = -1 "), "{error}");
    let batch = Batch::new(&calm(5), 2, MODES[0], Some(8), u64::MAX).unwrap();
    assert_eq!((batch.len(), batch.num_threads(), batch.is_empty()), (2, 2, false));
    let message = batch.state(2).expect_err("accepted").to_string();
    assert_eq!(message, "environment index = 2 is out of range: it must be below num_envs = 2");
    for (mode, name) in MODES.into_iter().zip(["next_step", "same_step", "disabled"]) {
        assert_eq!(name.parse::<Autoreset>().unwrap(), mode);
    }
    assert!(matches!("never".parse::<Autoreset>(), Err(Error::UnknownName { .. })));
}
