//! The robots of a batch, and the draws of their events.

use super::batch::Batch;
use crate::actuator::MotorOptions;
use crate::sensor::SensorOptions;
use ballbot_base::error::Result;
use ballbot_base::params::Params;

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
    /// As [`Batch::state`]; those of [`Params::validate`]; [`crate::Error::OutOfRange`] or
    /// [`crate::Error::Inconsistent`] if the task, its actions or its events do not fit the robot. The robot is then
    /// unchanged.
    pub fn set_params(&mut self, index: usize, params: &Params) -> Result<()> {
        let (chunk, i) = self.locate(index)?;
        self.chunks[chunk].set_params(i, params)
    }

    /// Parameters of one robot without events: its initial ones, or those of the last [`Batch::set_params`].
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
}
