//! A batch with the buffers of its steps, and all results of an environment's step as bits.

// Every test uses some of these.
#![allow(dead_code)]

use ballbot_core::Result;
use ballbot_core::batch::{Batch, Outcome, StepBuffers, Under};
use ballbot_core::task::ACTION_LEN;

pub struct Run {
    pub batch: Batch,
    pub observations: Vec<f32>,
    pub rewards: Vec<f64>,
    pub terminated: Vec<bool>,
    pub truncated: Vec<bool>,
    pub last: Vec<f32>,
    pub outcomes: Vec<Outcome>,
}

impl Run {
    /// All environments reset.
    pub fn new(mut batch: Batch) -> Self {
        let n = batch.len();
        let mut observations = vec![0.0; n * batch.observation_len()];
        batch.reset(None, &mut observations).unwrap();
        Self {
            batch,
            last: vec![0.0; observations.len()],
            observations,
            rewards: vec![0.0; n],
            terminated: vec![false; n],
            truncated: vec![false; n],
            outcomes: vec![Outcome::default(); n],
        }
    }

    pub fn step(&mut self, actions: &[f32]) -> Result<()> {
        let (batch, mut buffers) = self.split();
        batch.step(actions, &mut buffers)
    }

    /// As [`Batch::step_under`]; `actions` gets the actions.
    pub fn step_under(&mut self, under: &Under<'_>, actions: &mut [f32]) -> Result<()> {
        let (batch, mut buffers) = self.split();
        batch.step_under(under, actions, &mut buffers)
    }

    fn split(&mut self) -> (&mut Batch, StepBuffers<'_>) {
        let buffers = StepBuffers {
            observations: &mut self.observations,
            rewards: &mut self.rewards,
            terminated: &mut self.terminated,
            truncated: &mut self.truncated,
            final_observations: &mut self.last,
            outcomes: &mut self.outcomes,
        };
        (&mut self.batch, buffers)
    }

    /// Resets some environments.
    pub fn reset(&mut self, mask: &[bool]) {
        self.batch.reset(Some(mask), &mut self.observations).unwrap();
    }

    pub fn observation(&self, i: usize) -> &[f32] {
        let width = self.batch.observation_len();
        &self.observations[i * width..][..width]
    }

    pub fn final_observation(&self, i: usize) -> &[f32] {
        let width = self.batch.observation_len();
        &self.last[i * width..][..width]
    }

    /// State, contacts, observation, reward with its terms, and outcome of environment `i` after a step.
    pub fn bits(&self, i: usize) -> Vec<u64> {
        let contacts = self.batch.contacts(i).unwrap();
        let mut terms = vec![0.0; self.batch.task().terms.len()];
        self.batch.reward_terms(i, &mut terms).unwrap();
        let outcome = self.outcomes[i];
        let numbers = self.batch.state(i).unwrap().to_array().into_iter();
        let numbers = numbers.chain(contacts.wheel_normal_forces).chain(contacts.wheel_tractions).chain(terms);
        let numbers = numbers.chain([outcome.reward, self.rewards[i]]).map(f64::to_bits);
        let rows = self.observation(i).iter().chain(self.final_observation(i)).map(|v| u64::from(v.to_bits()));
        let reason = outcome.terminated.map_or(0, |reason| reason.len() as u64);
        let flags = [self.terminated[i], self.truncated[i], outcome.truncated, outcome.success].map(u64::from);
        numbers.chain(rows).chain([reason]).chain(flags).collect()
    }

    pub fn all_bits(&self) -> Vec<Vec<u64>> {
        (0..self.batch.len()).map(|i| self.bits(i)).collect()
    }

    /// Snapshots of all environments.
    pub fn snapshots(&self) -> Vec<Vec<u8>> {
        (0..self.batch.len()).map(|i| self.batch.save(i).unwrap()).collect()
    }
}

/// Actions of step `k` for the environments from `first` on, up to `size`.
pub fn actions(first: usize, n: usize, k: usize, size: f32) -> Vec<f32> {
    (first * ACTION_LEN..(first + n) * ACTION_LEN).map(|i| size * ((i * 7 + k * 3) as f32).sin()).collect()
}
