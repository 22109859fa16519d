//! Snapshots taken at any time continue to the last bit.

use super::{any_drive, any_shape, cases, models, robot};
use crate::support::{any_robot, any_start, torques, vector};
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Environment, Outcome, StepBuffers};
use ballbot_core::task::{ACTION_LEN, Balance};
use ballbot_core::{Ballbot, ModelKind, Params};
use nalgebra::Vector3;
use proptest::prelude::*;

/// Robots of any kind in short episodes, some of which end in a fall.
fn task(params: &Params, model: ModelKind) -> BalanceConfig {
    let [slipping, ..] = torques(params, &Vector3::repeat(1.0));
    BalanceConfig {
        params: params.clone(),
        model,
        max_episode_steps: 15,
        max_wheel_torque: Some(slipping),
        task: Balance { fall_tilt: 0.15, ..Balance::default() },
        ..BalanceConfig::default()
    }
}

/// A batch and the results of its steps.
struct Run {
    batch: Batch,
    observations: Vec<f32>,
    rewards: Vec<f64>,
    terminated: Vec<bool>,
    truncated: Vec<bool>,
    last: Vec<f32>,
    outcomes: Vec<Outcome>,
}

impl Run {
    fn new(config: &BalanceConfig, n: usize, seed: u64) -> Self {
        let mut batch = Batch::new(config, n, Autoreset::NextStep, Some(2), seed).expect("any robot can be balanced");
        let mut observations = vec![0.0; n * batch.observation_len()];
        batch.reset(None, &mut observations).expect("the buffer has its length");
        Self {
            batch,
            last: observations.clone(),
            observations,
            rewards: vec![0.0; n],
            terminated: vec![false; n],
            truncated: vec![false; n],
            outcomes: vec![Outcome::default(); n],
        }
    }

    fn step(&mut self, actions: &[f32]) {
        let mut buffers = StepBuffers {
            observations: &mut self.observations,
            rewards: &mut self.rewards,
            terminated: &mut self.terminated,
            truncated: &mut self.truncated,
            final_observations: &mut self.last,
            outcomes: &mut self.outcomes,
        };
        self.batch.step(actions, &mut buffers).expect("actions are finite");
    }

    fn observation(&self, i: usize) -> &[f32] {
        let width = self.batch.observation_len();
        &self.observations[i * width..][..width]
    }
}

/// A single environment under the contract of [`Autoreset::NextStep`].
struct Single {
    environment: Environment,
    observation: Vec<f32>,
}

impl Single {
    fn step(&mut self, action: &[f32]) -> Outcome {
        if self.environment.over() {
            self.environment.reset(&mut self.observation);
            return Outcome::default();
        }
        self.environment.step(action, &mut self.observation)
    }
}

fn any_actions(n: usize, steps: usize) -> impl Strategy<Value = Vec<Vec<f32>>> {
    prop::collection::vec(prop::collection::vec(-1.0_f32..1.0, n * ACTION_LEN), steps)
}

/// Enough for a block of eight and a rest.
const NUM_ENVS: usize = 11;

proptest! {
    #![proptest_config(cases(20))]

    #[test]
    fn loaded_robots_continue_bit_for_bit(
        params in any_shape(),
        start in any_start(0.3, 0.5),
        drive in any_drive(2.0, 6, 10),
        pushed in vector(0.3),
        saved_at in 0..6_usize,
    ) {
        let start = start.of(&params);
        for kind in models(&params) {
            let Some(mut robot) = robot(kind, &params, &start, 1e-3) else { continue };
            let mut other = Ballbot::new(&params, kind, 1e-3).expect("a robot like it");
            let mut saved = false;
            for (k, torques) in drive.torques(&params).iter().enumerate() {
                if k == saved_at {
                    // A pending push is part of the snapshot.
                    robot.push(&(pushed * params.body_mass * params.body_com_height), None).expect("a gentle push");
                    other.load(&robot.save()).expect("of a robot like it");
                    saved = true;
                }
                let result = robot.step(*torques, drive.hold);
                if saved {
                    prop_assert_eq!(result.is_ok(), other.step(*torques, drive.hold).is_ok());
                    prop_assert_eq!(robot.state().to_array(), other.state().to_array(), "{}, saved at {}", kind, saved_at);
                    prop_assert_eq!(robot.contacts(), other.contacts(), "{}, saved at {}", kind, saved_at);
                    prop_assert_eq!(robot.time(), other.time());
                }
            }
            prop_assert!(robot.save() == other.save(), "{kind}: saved at {saved_at}");
        }
    }

    #[test]
    fn batched_environments_equal_single_ones(
        params in any_robot(), seed in any::<u64>(), actions in any_actions(NUM_ENVS, 30),
    ) {
        for model in ModelKind::ALL {
            let config = task(&params, model);
            let mut run = Run::new(&config, NUM_ENVS, seed);
            let mut singles: Vec<Single> = (0..NUM_ENVS as u64).map(|i| {
                let environment = Environment::new(&config, seed.wrapping_add(i)).expect("as the batch's");
                let mut single = Single { observation: vec![0.0; environment.observation_len()], environment };
                single.environment.reset(&mut single.observation);
                single
            }).collect();
            for (k, actions) in actions.iter().enumerate() {
                run.step(actions);
                for (i, single) in singles.iter_mut().enumerate() {
                    let outcome = single.step(&actions[i * ACTION_LEN..][..ACTION_LEN]);
                    prop_assert_eq!(run.observation(i), &single.observation, "{}, step {}, environment {}", model, k, i);
                    prop_assert_eq!(run.outcomes[i], outcome, "{}, step {}, environment {}", model, k, i);
                    prop_assert!(single.observation.iter().all(|v| v.is_finite()), "{model}, step {k}, environment {i}");
                }
            }
        }
    }

    #[test]
    fn loaded_environments_continue_in_another_batch(
        params in any_robot(),
        seed in any::<u64>(),
        actions in any_actions(NUM_ENVS, 30),
        saved_at in 0..30_usize,
    ) {
        for model in ModelKind::ALL {
            let config = task(&params, model);
            let mut run = Run::new(&config, NUM_ENVS, seed);
            // With other seeds and another history.
            let mut other = Run::new(&config, NUM_ENVS, seed ^ 1);
            other.step(&actions[0]);
            for (k, actions) in actions.iter().enumerate() {
                if k == saved_at {
                    for i in 0..NUM_ENVS {
                        let bytes = run.batch.save(i).expect("there is one");
                        other.batch.load(i, &bytes).expect("of the same task");
                    }
                }
                run.step(actions);
                if k >= saved_at {
                    other.step(actions);
                    prop_assert_eq!(&run.observations, &other.observations, "{}, step {}, saved at {}", model, k, saved_at);
                    prop_assert_eq!(&run.rewards, &other.rewards, "{}, step {}, saved at {}", model, k, saved_at);
                    prop_assert_eq!(&run.outcomes, &other.outcomes, "{}, step {}, saved at {}", model, k, saved_at);
                }
            }
        }
    }
}
