//! Where a step writes its results.

use super::batch::Batch;

/// Result of a step, except the observation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Sum of the reward's terms.
    pub reward: f64,
    /// Why the episode was terminated, if it was.
    pub terminated: Option<&'static str>,
    /// Whether the episode reached its last step.
    pub truncated: bool,
    /// Whether the episode is a success if it ends here.
    pub success: bool,
}

impl Outcome {
    /// Whether the episode is over.
    pub fn done(&self) -> bool {
        self.terminated.is_some() || self.truncated
    }
}

/// Where a step writes its results: one element per environment; observations have one row per environment.
pub struct StepBuffers<'a> {
    /// Observations, n × [`super::Batch::observation_len`].
    pub observations: &'a mut [f32],
    /// Rewards.
    pub rewards: &'a mut [f64],
    /// Whether each episode was terminated.
    pub terminated: &'a mut [bool],
    /// Whether each episode was truncated.
    pub truncated: &'a mut [bool],
    /// Rows of ended episodes get their last observation; other rows are left unchanged.
    pub final_observations: &'a mut [f32],
    /// Outcome of each step.
    pub outcomes: &'a mut [Outcome],
}

impl<'a> StepBuffers<'a> {
    /// The same buffers, reborrowed.
    pub(super) fn reborrow(&mut self) -> StepBuffers<'_> {
        StepBuffers {
            observations: self.observations,
            rewards: self.rewards,
            terminated: self.terminated,
            truncated: self.truncated,
            final_observations: self.final_observations,
            outcomes: self.outcomes,
        }
    }

    /// The first `n` environments (all, if there are fewer) and the rest.
    pub(super) fn split(self, n: usize) -> (Self, Self) {
        let len = self.rewards.len();
        let n = n.min(len);
        let width = self.observations.len().checked_div(len).unwrap_or(0);
        let (observations, more_observations) = self.observations.split_at_mut(n * width);
        let (rewards, more_rewards) = self.rewards.split_at_mut(n);
        let (terminated, more_terminated) = self.terminated.split_at_mut(n);
        let (truncated, more_truncated) = self.truncated.split_at_mut(n);
        let (final_observations, more_final_observations) = self.final_observations.split_at_mut(n * width);
        let (outcomes, more_outcomes) = self.outcomes.split_at_mut(n);
        (
            StepBuffers { observations, rewards, terminated, truncated, final_observations, outcomes },
            StepBuffers {
                observations: more_observations,
                rewards: more_rewards,
                terminated: more_terminated,
                truncated: more_truncated,
                final_observations: more_final_observations,
                outcomes: more_outcomes,
            },
        )
    }

    /// Writes the outcome of environment `i`.
    pub(super) fn write(&mut self, i: usize, outcome: Outcome) {
        self.rewards[i] = outcome.reward;
        self.terminated[i] = outcome.terminated.is_some();
        self.truncated[i] = outcome.truncated;
        self.outcomes[i] = outcome;
    }
}

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
        Self::of(batch.len(), batch.observation_len())
    }

    /// Zeros for `n` environments with observations of `width`.
    pub(super) fn of(n: usize, width: usize) -> Self {
        let rows = vec![0.0; n * width];
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
