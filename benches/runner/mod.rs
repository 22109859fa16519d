//! A batch with its buffers, for the benchmarks.

use ballbot_core::ModelKind;
use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Outcome, StepBuffers};
use ballbot_core::task::ACTION_LEN;

pub struct Runner {
    batch: Batch,
    actions: Vec<f32>,
    observations: Vec<f32>,
    final_observations: Vec<f32>,
    rewards: Vec<f64>,
    /// Whether the last step ended each episode.
    pub terminated: Vec<bool>,
    truncated: Vec<bool>,
    outcomes: Vec<Outcome>,
}

/// An environment with actions of 1 N·m.
pub fn config(model: ModelKind) -> BalanceConfig {
    BalanceConfig { model, max_wheel_torque: Some(1.0), scale_observations: false, ..BalanceConfig::default() }
}

impl Runner {
    /// `threads` as for [`Batch::new`].
    pub fn new(model: ModelKind, n: usize, threads: Option<usize>) -> Self {
        Self::of(&config(model), n, threads)
    }

    /// `n` environments of that kind.
    pub fn of(config: &BalanceConfig, n: usize, threads: Option<usize>) -> Self {
        let mut batch = Batch::new(config, n, Autoreset::NextStep, threads, 0).expect("the default task is valid");
        let mut observations = vec![0.0; n * batch.observation_len()];
        batch.reset(None, &mut observations).expect("the buffer fits");
        Self {
            batch,
            // Each robot drifts in its own direction until it falls and is reset.
            actions: (0..n * ACTION_LEN).map(|i| 0.05 * (i as f32).sin()).collect(),
            final_observations: observations.clone(),
            observations,
            rewards: vec![0.0; n],
            terminated: vec![false; n],
            truncated: vec![false; n],
            outcomes: vec![Outcome::default(); n],
        }
    }

    /// One control step of all environments.
    pub fn step(&mut self) {
        let mut buffers = StepBuffers {
            observations: &mut self.observations,
            rewards: &mut self.rewards,
            terminated: &mut self.terminated,
            truncated: &mut self.truncated,
            final_observations: &mut self.final_observations,
            outcomes: &mut self.outcomes,
        };
        self.batch.step(&self.actions, &mut buffers).expect("actions are finite and buffers fit");
    }

    /// Resets all environments.
    #[allow(dead_code, reason = "not every benchmark resets")]
    pub fn reset(&mut self) {
        self.batch.reset(None, &mut self.observations).expect("the buffer fits");
    }
}
