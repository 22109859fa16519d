//! The robots of a batch, and what events have drawn of them.

use super::batch::Batch;
use crate::actuator::MotorOptions;
use crate::error::Result;
use crate::params::Params;
use crate::sensor::SensorOptions;

impl Batch {
    /// Parameters of one robot.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn params(&self, index: usize) -> Result<&Params> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].params(i))
    }

    /// Replaces the parameters of one robot; they outlive resets, and are those that events draw from. If the geometry
    /// (radii, wheel angles, place of the CoM)
    /// is the same, its motion goes on; otherwise the environment must be reset before its next step.
    ///
    /// # Errors
    /// As [`Batch::state`]; those of [`Params::validate`]; [`crate::Error::OutOfRange`] or [`crate::Error::Inconsistent`] if the task,
    /// its actions or its events do not fit the robot. The robot is then left as it was.
    pub fn set_params(&mut self, index: usize, params: &Params) -> Result<()> {
        let (chunk, i) = self.locate(index)?;
        self.chunks[chunk].set_params(i, params)
    }

    /// Parameters that one robot has without events: those it was made with, or of the last [`Batch::set_params`].
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn nominal_params(&self, index: usize) -> Result<&Params> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].nominal_params(i))
    }

    /// Present draws of the events of one environment, in the order of [`Batch::draw_columns`]; NaN where there is none.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn draws(&self, index: usize) -> Result<&[f64]> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].draws(i))
    }

    /// How many draws of the events of one environment made a robot that cannot be, and were repeated, since it was seeded.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn repeated_draws(&self, index: usize) -> Result<u32> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].repeated_draws(i))
    }

    /// How many pushes events and the task have given one robot in its episode.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn push_count(&self, index: usize) -> Result<u32> {
        let (chunk, i) = self.locate(index)?;
        Ok(self.chunks[chunk].push_count(i))
    }

    /// Present options of the motors of one robot: those of the configuration, or what events made of them. Meaningless for
    /// an actuator of one's own.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn actuators(&self, index: usize) -> Result<&MotorOptions> {
        let (chunk, i) = self.locate(index)?;
        Ok(&self.chunks[chunk].drawn_stages(i).unwrap_or(&self.stages).actuators)
    }

    /// Present options of the sensors of one robot: those of the configuration, exact ones without, or what events made of
    /// them. Meaningless for sensors of one's own.
    ///
    /// # Errors
    /// As [`Batch::state`].
    pub fn sensors(&self, index: usize) -> Result<&SensorOptions> {
        let (chunk, i) = self.locate(index)?;
        Ok(&self.chunks[chunk].drawn_stages(i).unwrap_or(&self.stages).sensors)
    }

    /// [`super::Event::label`] of each event, and how many numbers it draws: those of the parameter, or impulse (N·s; m/s
    /// with [`super::Operation::Scale`]), azimuth (rad) and height (m) of a push.
    pub fn draw_columns(&self) -> impl Iterator<Item = (String, usize)> {
        self.plan.iter().flat_map(|plan| &plan.events).map(|event| (event.event.label(), event.width))
    }
}
