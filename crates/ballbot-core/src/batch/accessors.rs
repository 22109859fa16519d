//! What can be read and set of each robot of a batch.

use super::batch::Batch;
use super::history::History;
use crate::actuator::MotorOptions;
use crate::perception::{Channel, Perception, instrument_kind};
use crate::sensor::Readings;
use crate::sensor::SensorOptions;
use ballbot_base::error::{Error, Result, check};
use ballbot_base::kinematics::Omniwheels;
use ballbot_base::params::Params;
use ballbot_base::payload::{Deflection, PAYLOADS};
use ballbot_base::setpoint::Setpoint;
use ballbot_base::state::State;
use ballbot_base::terrain::{Ground, Terrain};
use std::sync::Arc;

impl Batch {
    /// Parameters of one robot.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn params(&self, index: usize) -> Result<&Params> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].params(i))
    }

    /// Replaces the parameters of one robot; they persist over resets, and events start from them. If the geometry
    /// (radii, wheel angles, CoM position) is unchanged, its motion continues; otherwise the environment must be reset
    /// before its next step.
    ///
    /// # Errors
    /// As [`Batch::state`]; the errors of [`Params::validate`]; [`crate::Error::OutOfRange`] or
    /// [`crate::Error::Inconsistent`] if the task, its actions or its events do not fit the robot. The robot is then
    /// unchanged.
    pub fn set_params(&mut self, index: usize, params: &Params) -> Result<()> {
        let (chunk, i) = self.locate(index)?;
        self.chunks[chunk].set_params(i, params)
    }

    /// Parameters of one robot without events: its initial parameters, or the parameters of the last
    /// [`Batch::set_params`].
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn nominal_params(&self, index: usize) -> Result<&Params> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].nominal_params(i))
    }

    /// Current draws of the events of one environment, in the order of [`Batch::draw_columns`]; NaN where there is
    /// none.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn draws(&self, index: usize) -> Result<&[f64]> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].draws(i))
    }

    /// How many draws of the events of one environment gave an invalid robot and were repeated, since it was seeded.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn repeated_draws(&self, index: usize) -> Result<u32> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].repeated_draws(i))
    }

    /// How many pushes events and the task have applied to one robot in its episode.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn push_count(&self, index: usize) -> Result<u32> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].push_count(i))
    }

    /// Current options of the motors of one robot: from the configuration, as changed by events. Meaningless for a
    /// custom actuator.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn actuators(&self, index: usize) -> Result<&MotorOptions> {
        let (chunk, i) = self.locate(index)?;
        Ok(&self.chunks[chunk].drawn_stages(i).unwrap_or(&self.stages).actuators)
    }

    /// Current options of the sensors of one robot: from the configuration (exact sensors by default), as changed by
    /// events. Meaningless for custom sensors.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn sensors(&self, index: usize) -> Result<&SensorOptions> {
        let (chunk, i) = self.locate(index)?;
        Ok(&self.chunks[chunk].drawn_stages(i).unwrap_or(&self.stages).sensors)
    }

    /// [`super::Event::label`] of each event, and how many numbers it samples: the numbers of the parameter, or impulse
    /// (N·s; m/s with [`super::Operation::Scale`]), azimuth (rad) and height (m) of a push.
    pub fn draw_columns(&self) -> impl Iterator<Item = (String, usize)> {
        self.plan.iter().flat_map(|plan| &plan.events).map(|event| (event.event.label(), event.width))
    }

    /// As [`crate::Ballbot::move_payload`] of environment `index`. In a task whose riders lean, it is replaced in the next step.
    ///
    /// # Errors
    /// As [`Batch::state`] and [`crate::Ballbot::move_payload`].
    pub fn move_payload(&mut self, index: usize, payload: usize, offset: [f64; 3]) -> Result<()> {
        let (chunk, i) = self.locate(index)?;
        self.chunks[chunk].move_payload(i, payload, offset)
    }

    /// As [`crate::Ballbot::payloads`] of environment `index`.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn payloads(&self, index: usize) -> Result<[Deflection<f64>; PAYLOADS]> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].payloads(i))
    }

    /// As [`crate::Ballbot::set_payloads`] of environment `index`.
    ///
    /// # Errors
    /// As [`Batch::state`] and [`Params::validate_deflections`]; the payloads then stay as they are.
    pub fn set_payloads(&mut self, index: usize, deflections: &[Deflection<f64>; PAYLOADS]) -> Result<()> {
        let (chunk, i) = self.locate(index)?;
        self.chunks[chunk].set_payloads(i, deflections)
    }

    /// The terrain; `None` for level ground.
    pub fn terrain(&self) -> Option<&Arc<Terrain>> {
        self.chunks[0].ground().map(Ground::terrain)
    }

    /// Level of the tile that the current episode of environment `index` began on; 0 for terrains without tiles.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn level(&self, index: usize) -> Result<usize> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].level(i))
    }

    /// Moves a state on level ground of the robot of environment `index` to the same place on its ground, as starts are
    /// moved: the ball touches the ground and rolls with the same horizontal velocity, and the static lean there is
    /// added to the tilt. On level ground the state is unchanged.
    ///
    /// # Errors
    /// [`crate::Error::Inconsistent`] if there is no such environment, [`crate::Error::OutOfRange`] for an invalid
    /// state.
    pub fn on_ground(&self, index: usize, start: &State) -> Result<State> {
        let params = self.params(index)?;
        start.validate()?;
        let (chunk, _) = self.locate(index)?;
        Ok(match self.chunks[chunk].ground() {
            Some(ground) => ground.adapted(params, &Omniwheels::new(params), start),
            None => start.clone(),
        })
    }

    /// The current command of one environment, in the order of [`crate::task::TaskDescription::command`].
    ///
    /// # Errors
    /// As [`Batch::state`]; [`Error::Length`] unless `out` has one element per part of the command.
    pub fn command(&self, index: usize, out: &mut [f64]) -> Result<()> {
        let (chunk, i) = self.locate(index)?;
        self.expect_len("command", out.len(), self.description.command.len())?;
        self.chunks[chunk].command(i, out);
        Ok(())
    }

    /// Sets the command of one environment until the end of its episode; the next observation shows it.
    ///
    /// # Errors
    /// As [`Batch::command`]; [`Error::Inconsistent`] for a task without commands, and before the first reset;
    /// [`Error::OutOfRange`] for a number beyond its bound; errors of a [`super::BatchStage`], after which all
    /// environments must be reset.
    pub fn set_command(&mut self, index: usize, command: &[f64]) -> Result<()> {
        let (chunk, i) = self.locate(index)?;
        let parts = self.description.command;
        if parts.is_empty() {
            return Err(Error::Inconsistent(format!("the task {} has no command", self.description.name)));
        }
        self.expect_len("command", command.len(), parts.len())?;
        for (part, value) in parts.iter().zip(command) {
            let bound = f64::from(part.bound);
            check(part.name, *value, format_args!("within ±{bound} {}", part.unit), |v| v.abs() <= bound)?;
        }
        self.chunks[chunk].set_command(i, command)?;
        self.renew_staged(index)
    }

    /// The current setpoint of the task for a controller of one robot; it follows the command, if there is one.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn setpoint(&mut self, index: usize) -> Result<Setpoint> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].setpoint(i))
    }

    /// Metrics of the current episode of one environment so far, in the order of
    /// [`crate::task::TaskDescription::metrics`]; before its first step, metrics of the last episode. NaN where a
    /// metric does not exist, or the episode is too short for it.
    ///
    /// # Errors
    /// As [`Batch::state`]; [`Error::Length`] unless `out` has one element per metric.
    pub fn metrics(&self, index: usize, out: &mut [f64]) -> Result<()> {
        let (chunk, i) = self.locate(index)?;
        self.expect_len("metrics", out.len(), self.description.metrics.len())?;
        self.chunks[chunk].metrics(i, out);
        Ok(())
    }

    /// Metrics of the current episodes of all environments so far, one row per environment; 0 before the first step of an
    /// episode and where [`Batch::metrics`] has NaN. Allocates nothing.
    ///
    /// # Errors
    /// [`Error::Length`] unless `out` has one element per metric and environment.
    pub fn running_metrics(&mut self, out: &mut [f64]) -> Result<()> {
        let len = self.description.metrics.len();
        self.expect_len("metrics", out.len(), self.len() * len)?;
        if len > 0 {
            for (chunk, rows) in self.chunks.iter_mut().zip(out.chunks_mut(self.width * len)) {
                chunk.running_metrics(rows);
            }
        }
        Ok(())
    }

    /// Length of an observation: its rows at each age of [`Batch::history`], then the readings of the instruments.
    pub fn observation_len(&self) -> usize {
        self.description.rows.len() * self.history.count() + self.perception.as_ref().map_or(0, |seen| seen.width())
    }

    /// The instruments that observe the ground.
    pub fn perception(&self) -> Option<&Perception> {
        self.perception.as_deref()
    }

    /// The instrument of a name.
    ///
    /// # Errors
    /// [`Error::UnknownName`] if there is no such instrument; [`Error::Inconsistent`] if the robots do not have it.
    pub fn instrument(&self, name: &str) -> Result<&Channel> {
        Ok(&self.channels()[self.channel(name)?])
    }

    /// Last reading of an instrument of one robot, unscaled.
    ///
    /// # Errors
    /// As [`Batch::state`] and [`Batch::instrument`].
    pub fn perceived(&self, index: usize, name: &str) -> Result<&[f32]> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].perceived(i, self.channel(name)?))
    }

    fn channels(&self) -> &[Channel] {
        self.perception().map_or(&[], Perception::channels)
    }

    fn channel(&self, name: &str) -> Result<usize> {
        let missing = || Error::Inconsistent(format!("the robots have no {name}: make the environments with {name}"));
        let found = self.channels().iter().position(|channel| channel.name() == name);
        found.ok_or_else(|| instrument_kind(name).err().unwrap_or_else(missing))
    }

    /// Which of the last observations are given together.
    pub fn history(&self) -> &History {
        &self.history
    }

    /// Last observation of one environment; zeros before its first reset.
    ///
    /// # Errors
    /// As [`Batch::state`]; [`Error::Length`] unless `out` has [`Batch::observation_len`] elements.
    pub fn observation(&self, index: usize, out: &mut [f32]) -> Result<()> {
        let (chunk, i) = self.locate(index)?;
        self.expect_len("observation", out.len(), self.observation_len())?;
        self.chunks[chunk].observation(i, out);
        Ok(())
    }

    /// Last readings of the sensors of one robot; before its first reset, readings of the robot at rest.
    ///
    /// # Errors
    /// As [`Batch::state`]; [`Error::Inconsistent`] for robots without sensors ([`super::EnvConfig::sensors`]).
    pub fn readings(&self, index: usize) -> Result<Readings<f64>> {
        let (chunk, i) = self.locate(index)?;
        self.chunks[chunk].readings(i).ok_or_else(no_sensors)
    }

    /// State of one robot estimated from the last readings of its sensors, as the task observes it. It includes the
    /// spin of the ball; the attitude of the ball assumes that it rolls; wheel angles count from the start of the
    /// episode. Before the first reset it is the state of the robot at rest.
    ///
    /// # Errors
    /// As [`Batch::state`]; [`Error::Inconsistent`] if the task observes the true state ([`super::EnvConfig::observation`]).
    pub fn estimate(&self, index: usize) -> Result<State> {
        let (chunk, i) = self.locate(index)?;
        self.chunks[chunk].estimate(i).ok_or_else(no_estimator)
    }

    /// Length of a privileged observation.
    pub fn privileged_observation_len(&self) -> usize {
        self.task().rows.len()
    }

    /// The rows of the observation of one environment, computed from the true state, with the same scaling.
    ///
    /// # Errors
    /// As [`Batch::state`]; [`Error::Length`] unless `out` has [`Batch::privileged_observation_len`] elements; errors of a
    /// [`super::BatchStage`].
    pub fn privileged_observation(&mut self, index: usize, out: &mut [f32]) -> Result<()> {
        let (chunk, i) = self.locate(index)?;
        check_len(out.len(), self.privileged_observation_len())?;
        self.chunks[chunk].privileged_observation(i, out);
        self.observe_staged(out, Some(index))
    }
}

/// The error for reading robots without sensors.
pub(super) fn no_sensors() -> Error {
    Error::Inconsistent("the robots have no sensors: make the environments with sensors, exact ones for example".into())
}

/// The error for requesting an estimate where there is none.
pub(super) fn no_estimator() -> Error {
    Error::Inconsistent("the robots have no estimator: make the environments with observation = sensors".into())
}

/// Checks the length of a privileged observation.
pub(super) fn check_len(found: usize, expected: usize) -> Result<()> {
    if found == expected {
        return Ok(());
    }
    Err(Error::Length { name: "privileged observation".into(), found, expected })
}
