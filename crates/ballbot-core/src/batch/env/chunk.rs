//! The unit that a batch steps: a single environment of any model, or eight of the contact model in lanes.

use crate::batch::autoreset::Autoreset;
use crate::batch::buffers::StepBuffers;
use crate::batch::drawn_law::Design;
use crate::batch::events::Stages;
use crate::batch::integral::Integral;
use crate::batch::stage::ChunkResults;
use crate::control::Controller;
use crate::sensor::Readings;
use crate::task::RowScaling;
use ballbot_base::error::Result;
use ballbot_base::force::Force;
use ballbot_base::params::Params;
use ballbot_base::payload::{Deflection, PAYLOADS};
use ballbot_base::setpoint::Setpoint;
use ballbot_base::state::{Contacts, State};
use ballbot_base::terrain::Ground;
use ballbot_gradients::{Coordinates, Differentiable, Parameter};
use nalgebra::Vector3;

/// Environments of any one task. Indices count within the chunk.
pub trait Chunk: Send + Sync {
    /// How many environments there are.
    fn len(&self) -> usize;

    /// Torque of an action of 1, N·m.
    fn action_torque(&self) -> f64;

    /// Scaling of the rows of an observation, if they are scaled.
    fn scaling(&self) -> Option<&RowScaling>;

    /// The integral of the position error, if it is observed.
    fn integral(&self) -> Option<&Integral>;

    /// The ground; `None` for level ground.
    fn ground(&self) -> Option<&Ground>;

    /// Steps all of them; the caller has checked actions and buffers.
    fn step(&mut self, autoreset: Autoreset, actions: &[f32], buffers: StepBuffers<'_>) {
        self.advance(autoreset, actions);
        self.finish(autoreset, None, buffers);
    }

    /// The first part of a step: events, motion, and the task's reward, termination and observation.
    fn advance(&mut self, autoreset: Autoreset, actions: &[f32]);

    /// Fires the events that are due, before [`Chunk::advance_to`].
    fn begin_step(&mut self, autoreset: Autoreset);

    /// As [`Chunk::advance`] after [`Chunk::begin_step`], if the motion is not simulated here: `states` holds the final
    /// state of each environment.
    fn advance_to(&mut self, autoreset: Autoreset, actions: &[f32], states: &[State]);

    /// The second part of a step: applies the results of a stage, if there is one, writes all results, and begins
    /// episodes.
    fn finish(&mut self, autoreset: Autoreset, results: Option<ChunkResults<'_>>, buffers: StepBuffers<'_>);

    /// Writes the rows of [`crate::batch::RobotRows::truth`], or as the task observes them.
    fn robot_rows(&mut self, observed: bool, out: &mut [f32]);

    /// Writes the rows of a stage into the newest observation.
    fn put_rows(&mut self, i: usize, values: &[f64]);

    /// Steps since the start of the episode.
    fn steps(&self, i: usize) -> i64;

    /// As [`crate::batch::RobotRows::keys`].
    fn key(&self, i: usize) -> [u32; 3];

    /// Writes the actions of a controller, from the true states if `privileged`, else from the states that the task
    /// observes; `setpoints` has one per environment, or is empty for the task's own.
    fn control(&mut self, controller: &dyn Controller, setpoints: &[Setpoint], privileged: bool, actions: &mut [f32]);

    /// As [`Chunk::control`], with the design of the controller `owner` for each robot; see
    /// [`crate::batch::Batch::control_drawn`].
    fn control_drawn(
        &mut self,
        owner: u64,
        design: &Design,
        setpoints: &[Setpoint],
        privileged: bool,
        actions: &mut [f32],
    ) -> Result<()>;

    /// Begins an episode from a given or random state, and writes its first observation.
    ///
    /// # Errors
    /// The errors of [`crate::Ballbot::reset`].
    fn reset(&mut self, i: usize, start: Option<&State>, observation: &mut [f32]) -> Result<()>;

    /// Checks that a reset, after a new seed if there is one, would accept a state.
    ///
    /// # Errors
    /// As [`Chunk::reset`].
    fn accepts(&self, i: usize, start: &State, seed: Option<u64>) -> Result<()>;

    /// Writes the last observation.
    fn observation(&self, i: usize, out: &mut [f32]);

    /// Last reading of an instrument that the robot has, by its place among them.
    fn perceived(&self, i: usize, place: usize) -> &[f32];

    /// Level of the tile of the current episode.
    fn level(&self, i: usize) -> usize;

    /// Writes the terms of the last reward.
    fn reward_terms(&self, i: usize, out: &mut [f64]);

    /// Writes the metrics of the current episode so far; before its first step, metrics of the last episode, or NaN.
    fn metrics(&self, i: usize, out: &mut [f64]);

    /// Writes the metrics of the current episodes so far, robot by robot; 0 before their first step and where there is
    /// none.
    fn running_metrics(&mut self, out: &mut [f64]);

    /// Writes the current command.
    fn command(&self, i: usize, out: &mut [f64]);

    /// Sets a command until the end of the episode, and observes the robot again.
    ///
    /// # Errors
    /// [`crate::Error::Inconsistent`] before the first episode; errors of [`crate::task::Task::check_command`].
    fn set_command(&mut self, i: usize, command: &[f64]) -> Result<()>;

    /// The task's setpoint for a controller.
    fn setpoint(&mut self, i: usize) -> Setpoint;

    /// State of the robot.
    fn state(&self, i: usize) -> State;

    /// Contact forces of the last model step.
    fn contacts(&self, i: usize) -> Contacts;

    /// A robot, as it moves next, for derivatives.
    ///
    /// # Errors
    /// As [`crate::Ballbot::jacobian`].
    fn differentiated(
        &self,
        i: usize,
        parameters: &[Parameter],
        coordinates: Coordinates,
    ) -> Result<Box<dyn Differentiable>>;

    /// Last readings of the sensors, if the robot has any; before its first episode, readings of the robot at rest.
    fn readings(&self, i: usize) -> Option<Readings<f64>>;

    /// State estimated from the last readings, if the task observes it.
    fn estimate(&self, i: usize) -> Option<State>;

    /// Writes the rows of an observation of the true state.
    fn privileged_observation(&mut self, i: usize, out: &mut [f32]);

    /// Parameters of the robot.
    fn params(&self, i: usize) -> &Params;

    /// Parameters that the robot has without events.
    fn nominal_params(&self, i: usize) -> &Params;

    /// Current draws of the events; NaN where there is none.
    fn draws(&self, i: usize) -> &[f64];

    /// Options of the stages of the robot, if there are events.
    fn drawn_stages(&self, i: usize) -> Option<&Stages>;

    /// How many draws of the events gave an invalid robot and were repeated, since the last seed.
    fn repeated_draws(&self, i: usize) -> u32;

    /// Pushes of the events in the episode.
    fn push_count(&self, i: usize) -> u32;

    /// Replaces the parameters that the robot has without events; see [`crate::batch::Batch::set_params`].
    ///
    /// # Errors
    /// As [`crate::batch::Batch::set_params`].
    fn set_params(&mut self, i: usize, params: &Params) -> Result<()>;

    /// Applies an impulse to the robot's body.
    ///
    /// # Errors
    /// As [`crate::Ballbot::push`].
    fn push(&mut self, i: usize, impulse: &Vector3<f64>, point: Option<&Vector3<f64>>) -> Result<()>;

    /// As [`crate::Ballbot::apply_force`].
    ///
    /// # Errors
    /// As [`crate::Ballbot::apply_force`].
    fn apply_force(&mut self, i: usize, force: &Force) -> Result<()>;

    /// Whether riders lean in the task.
    fn has_riders(&self) -> bool;

    /// As [`crate::Ballbot::move_payload`].
    ///
    /// # Errors
    /// As [`crate::Ballbot::move_payload`].
    fn move_payload(&mut self, i: usize, payload: usize, offset: [f64; 3]) -> Result<()>;

    /// As [`crate::Ballbot::payloads`].
    fn payloads(&self, i: usize) -> [Deflection<f64>; PAYLOADS];

    /// As [`crate::Ballbot::set_payloads`].
    ///
    /// # Errors
    /// As [`crate::Ballbot::set_payloads`].
    fn set_payloads(&mut self, i: usize, deflections: &[Deflection<f64>; PAYLOADS]) -> Result<()>;

    /// As [`crate::Ballbot::has_force`].
    fn has_force(&self, i: usize) -> bool;

    /// As [`crate::batch::Batch::outside_forces`], of robot `i`.
    fn outside_force(&self, i: usize) -> Option<[f64; 2]>;

    /// The pending push on the body, in the form of [`crate::batch::Outside::pushes`].
    fn pending_push(&self, i: usize) -> [f64; 6];

    /// Reseeds the random numbers from the next episode on.
    fn seed(&mut self, i: usize, seed: u64);

    /// Ends the current episode after `steps` steps instead of the configured number.
    fn shorten(&mut self, i: usize, steps: usize);

    /// The first environment whose episode has ended, or has not begun.
    fn first_over(&self) -> Option<usize>;

    /// Whether any reset has happened.
    fn begun(&self) -> bool;

    /// The complete state of an environment.
    fn save(&self, i: usize) -> Vec<u8>;

    /// Continues from bytes of [`Chunk::save`].
    ///
    /// # Errors
    /// [`Error::Decode`] if the bytes are not such a snapshot.
    fn load(&mut self, i: usize, bytes: &[u8]) -> Result<()>;
}
