//! Environments that are stepped as one: a single one, or eight in lanes.

use super::batch::Autoreset;
use super::environment::{Environment, Outcome};
use crate::error::Result;
use crate::state::State;

/// A group's share of what a step reads and writes; see [`super::StepBuffers`].
pub struct GroupBuffers<'a> {
    pub actions: &'a [f32],
    pub observations: &'a mut [f32],
    pub final_observations: &'a mut [f32],
    pub rewards: &'a mut [f32],
    pub terminated: &'a mut [bool],
    pub truncated: &'a mut [bool],
    pub outcomes: &'a mut [Outcome],
}

impl GroupBuffers<'_> {
    /// Writes what came of the step of environment `i` of the group.
    pub fn write(&mut self, i: usize, outcome: Outcome) {
        self.rewards[i] = outcome.reward as f32;
        self.terminated[i] = outcome.terminated.is_some();
        self.truncated[i] = outcome.truncated;
        self.outcomes[i] = outcome;
    }
}

/// Environments of one task. Indices count within the group.
pub trait Group: Send + Sync {
    /// Steps all of them; the caller has checked actions and buffers.
    fn step(&mut self, autoreset: Autoreset, buffers: GroupBuffers<'_>);

    /// Begins an episode from a given state, or one drawn at random, and writes its first observation.
    ///
    /// # Errors
    /// What [`crate::Ballbot::reset`] finds in a given state.
    fn reset(&mut self, i: usize, start: Option<&State>, observation: &mut [f32]) -> Result<()>;

    /// Checks that a reset would take a state.
    ///
    /// # Errors
    /// As [`Group::reset`].
    fn accepts(&self, start: &State) -> Result<()>;

    /// Writes the present observation.
    fn observe(&self, i: usize, observation: &mut [f32]);

    /// Starts the random numbers anew.
    fn seed(&mut self, i: usize, seed: u64);

    /// Ends the present episode after `steps` steps instead of the task's number.
    fn shorten(&mut self, i: usize, steps: usize);

    /// The first environment whose episode has ended, or has not begun.
    fn first_over(&self) -> Option<usize>;

    /// Whether there has been a reset at all.
    fn begun(&self) -> bool;

    /// Shows an environment.
    fn view(&mut self, i: usize) -> &Environment;

    /// Changes an environment.
    fn edit(&mut self, i: usize, change: &mut dyn FnMut(&mut Environment));
}

impl Group for Environment {
    fn step(&mut self, autoreset: Autoreset, mut buffers: GroupBuffers<'_>) {
        if autoreset == Autoreset::NextStep && self.over() {
            Environment::reset(self, buffers.observations);
            buffers.write(0, Outcome::default());
            return;
        }
        let outcome = Environment::step(self, buffers.actions, buffers.observations);
        if autoreset == Autoreset::SameStep && outcome.done() {
            buffers.final_observations.copy_from_slice(buffers.observations);
            Environment::reset(self, buffers.observations);
        }
        buffers.write(0, outcome);
    }

    fn reset(&mut self, _: usize, start: Option<&State>, observation: &mut [f32]) -> Result<()> {
        match start {
            Some(start) => self.reset_to(start, observation),
            None => {
                Environment::reset(self, observation);
                Ok(())
            }
        }
    }

    fn accepts(&self, start: &State) -> Result<()> {
        self.robot().accepts(start)
    }

    fn observe(&self, _: usize, observation: &mut [f32]) {
        Environment::observe(self, observation);
    }

    fn seed(&mut self, _: usize, seed: u64) {
        Environment::seed(self, seed);
    }

    fn shorten(&mut self, _: usize, steps: usize) {
        Environment::shorten(self, steps);
    }

    fn first_over(&self) -> Option<usize> {
        self.over().then_some(0)
    }

    fn begun(&self) -> bool {
        Environment::begun(self)
    }

    fn view(&mut self, _: usize) -> &Environment {
        self
    }

    fn edit(&mut self, _: usize, change: &mut dyn FnMut(&mut Environment)) {
        change(self);
    }
}
