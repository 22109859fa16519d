//! Owned buffers for the results of steps.

use super::batch::Batch;
use super::buffers::{Outcome, StepBuffers};

/// Owned buffers for the results of steps, which a batch writes into repeatedly.
#[derive(Clone, Debug, PartialEq)]
pub struct StepResults {
    /// Observations, one row of [`Batch::observation_len`] per environment; [`Batch::reset`] writes them, too.
    pub observations: Vec<f32>,
    /// Rewards.
    pub rewards: Vec<f64>,
    /// Whether each episode was terminated.
    pub terminated: Vec<bool>,
    /// Whether each episode was truncated.
    pub truncated: Vec<bool>,
    /// As [`StepBuffers::final_observations`].
    pub final_observations: Vec<f32>,
    /// Outcome of each step.
    pub outcomes: Vec<Outcome>,
}

impl StepResults {
    /// Zeros, in the lengths that the batch writes.
    pub fn new(batch: &Batch) -> Self {
        let n = batch.len();
        let rows = vec![0.0; n * batch.observation_len()];
        Self {
            observations: rows.clone(),
            rewards: vec![0.0; n],
            terminated: vec![false; n],
            truncated: vec![false; n],
            final_observations: rows,
            outcomes: vec![Outcome::default(); n],
        }
    }

    /// The buffers for the next step.
    pub fn buffers(&mut self) -> StepBuffers<'_> {
        StepBuffers {
            observations: &mut self.observations,
            rewards: &mut self.rewards,
            terminated: &mut self.terminated,
            truncated: &mut self.truncated,
            final_observations: &mut self.final_observations,
            outcomes: &mut self.outcomes,
        }
    }
}
