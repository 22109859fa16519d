//! Commands of the tasks of a batch, and the metrics of their episodes.

use super::batch::Batch;
use ballbot_base::error::{Error, Result, check};
use ballbot_base::setpoint::Setpoint;

impl Batch {
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
    /// [`Error::OutOfRange`] for a number beyond its bound.
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
        self.chunks[chunk].set_command(i, command)
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
    /// [`crate::task::TaskDescription::metrics`]; before its first step, metrics of the last episode. NaN where there
    /// is no metric, or the episode is too short for it.
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
}
