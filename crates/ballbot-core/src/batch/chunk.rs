//! What a batch steps as one: a single environment of any model, or eight of the contact model in lanes.

use super::autoreset::Autoreset;
use super::buffers::StepBuffers;
use super::events::Stages;
use crate::control::Controller;
use crate::error::Result;
use crate::params::Params;
use crate::sensor::Readings;
use crate::setpoint::Setpoint;
use crate::state::{Contacts, State};
use nalgebra::Vector3;

/// Environments of one task, whichever it is. Indices count within the chunk.
pub trait Chunk: Send + Sync {
    /// Steps all of them; the caller has checked actions and buffers.
    fn step(&mut self, autoreset: Autoreset, actions: &[f32], buffers: StepBuffers<'_>);

    /// Fires the events that are due, before [`Chunk::step_to`].
    fn begin_step(&mut self, autoreset: Autoreset);

    /// A step after [`Chunk::begin_step`] whose motion is not simulated here: `states` has its end for each environment.
    fn step_to(&mut self, autoreset: Autoreset, actions: &[f32], states: &[State], buffers: StepBuffers<'_>);

    /// Writes the actions of a controller, on the true states if it is `privileged`, else on those that the task observes;
    /// `setpoints` has one an environment, or is empty for those of the task.
    fn control(&mut self, controller: &dyn Controller, setpoints: &[Setpoint], privileged: bool, actions: &mut [f32]);

    /// Begins an episode from a given state, or one drawn at random, and writes its first observation.
    ///
    /// # Errors
    /// What [`crate::Ballbot::reset`] finds in the state.
    fn reset(&mut self, i: usize, start: Option<&State>, observation: &mut [f32]) -> Result<()>;

    /// Checks that a reset, after a new seed if there is one, would take a state.
    ///
    /// # Errors
    /// As [`Chunk::reset`].
    fn accepts(&self, i: usize, start: &State, seed: Option<u64>) -> Result<()>;

    /// Writes the last observation.
    fn observation(&self, i: usize, out: &mut [f32]);

    /// Last readings of the height scan and the depth camera, m.
    fn perceived(&self, i: usize) -> [&[f32]; 2];

    /// Level of the tile of the present episode.
    fn level(&self, i: usize) -> usize;

    /// Writes the terms of the last reward.
    fn reward_terms(&self, i: usize, out: &mut [f64]);

    /// Writes the metrics of the present episode so far; before its first step those of the last one, or NaN.
    fn metrics(&self, i: usize, out: &mut [f64]);

    /// Writes the metrics of the present episodes so far, robot after robot; 0 before their first step and where there is none.
    fn running_metrics(&mut self, out: &mut [f64]);

    /// Writes the present command.
    fn command(&self, i: usize, out: &mut [f64]);

    /// Gives a command that holds to the end of the episode, and observes the robot anew.
    ///
    /// # Errors
    /// [`crate::Error::Inconsistent`] before the first episode; what [`crate::task::Task::check_command`] finds.
    fn set_command(&mut self, i: usize, command: &[f64]) -> Result<()>;

    /// What the task asks of a controller.
    fn setpoint(&mut self, i: usize) -> Setpoint;

    /// State of the robot.
    fn state(&self, i: usize) -> State;

    /// Contact forces of the last model step.
    fn contacts(&self, i: usize) -> Contacts;

    /// Last readings of the sensors, if the robot has any; of the robot at rest before its first episode.
    fn readings(&self, i: usize) -> Option<Readings<f64>>;

    /// State that follows from the last readings, if the task observes it.
    fn estimate(&self, i: usize) -> Option<State>;

    /// Writes the rows of an observation of the true state.
    fn privileged_observation(&mut self, i: usize, out: &mut [f32]);

    /// Parameters of the robot.
    fn params(&self, i: usize) -> &Params;

    /// Parameters that the robot has without events.
    fn nominal_params(&self, i: usize) -> &Params;

    /// Present draws of the events; NaN where there is none.
    fn draws(&self, i: usize) -> &[f64];

    /// Options of the stages of the robot, if there are events.
    fn drawn_stages(&self, i: usize) -> Option<&Stages>;

    /// How many draws of the events made a robot that cannot be, and were repeated, since the last seed.
    fn repeated_draws(&self, i: usize) -> u32;

    /// Pushes of the events in the episode.
    fn push_count(&self, i: usize) -> u32;

    /// Replaces the parameters that the robot has without events; see [`super::Batch::set_params`].
    ///
    /// # Errors
    /// As [`super::Batch::set_params`].
    fn set_params(&mut self, i: usize, params: &Params) -> Result<()>;

    /// Gives the robot's body an impulse.
    ///
    /// # Errors
    /// As [`crate::Ballbot::push`].
    fn push(&mut self, i: usize, impulse: &Vector3<f64>, point: Option<&Vector3<f64>>) -> Result<()>;

    /// What pushes have yet to do to the body, as [`super::Outside::pushes`] has it.
    fn pending_push(&self, i: usize) -> [f64; 6];

    /// Starts the random numbers anew with the next episode.
    fn seed(&mut self, i: usize, seed: u64);

    /// Ends the present episode after `steps` steps instead of the configured number.
    fn shorten(&mut self, i: usize, steps: usize);

    /// The first environment whose episode has ended, or has not begun.
    fn first_over(&self) -> Option<usize>;

    /// Whether there has been a reset at all.
    fn begun(&self) -> bool;

    /// Everything that the future of an environment depends on.
    fn save(&self, i: usize) -> Vec<u8>;

    /// Continues from what [`Chunk::save`] gave.
    ///
    /// # Errors
    /// [`Error::Decode`] if the bytes are not that.
    fn load(&mut self, i: usize, bytes: &[u8]) -> Result<()>;
}
