//! Observations of the robots of a batch: by tasks, by sensors, and without sensors.

use super::batch::Batch;
use crate::perception::Perception;
use crate::sensor::Readings;
use ballbot_base::error::{Error, Result};
use ballbot_base::state::State;

impl Batch {
    /// Length of an observation: its rows, [`Batch::history`] times, then the readings of the height scan and the depth
    /// camera.
    pub fn observation_len(&self) -> usize {
        self.description.rows.len() * self.history + self.perception.as_ref().map_or(0, |seen| seen.width())
    }

    /// The instruments that observe the ground.
    pub fn perception(&self) -> Option<&Perception> {
        self.perception.as_deref()
    }

    /// Last readings of the height scan and the depth camera of one robot, m, unscaled; empty for instruments that it
    /// does not have.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn perceived(&self, index: usize) -> Result<[&[f32]; 2]> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].perceived(i))
    }

    /// How many of the last observations are given together.
    pub fn history(&self) -> usize {
        self.history
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
    /// As [`Batch::state`]; [`Error::Length`] unless `out` has [`Batch::privileged_observation_len`] elements.
    pub fn privileged_observation(&mut self, index: usize, out: &mut [f32]) -> Result<()> {
        let (chunk, i) = self.locate(index)?;
        check_len(out.len(), self.privileged_observation_len())?;
        self.chunks[chunk].privileged_observation(i, out);
        Ok(())
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
