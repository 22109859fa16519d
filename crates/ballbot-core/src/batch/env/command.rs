//! Commands of the robots of a chunk: sampled by the task, or set by hand.

use super::Environments;
use super::ledger::{Ledger, Ledgers};
use super::robots::Robots;
use crate::actuator::Actuator;
use crate::sensor::Sensor;
use crate::task::{Moment, Task};
use ballbot_base::error::{Error, Result};
use ballbot_base::lanes::Cell;

impl<R: Robots, T: Task, A: Actuator, S: Sensor> Environments<R, T, A, S> {
    /// Samples a command for robot `i`; `one` is its ledger. Returns after how many steps the next command is due.
    pub fn draw_command(&mut self, i: usize) -> f64 {
        let state = self.robots.lane_state(i);
        let params = self.robots.params(i);
        let level = self.one.episode.level as usize;
        let terrain = self.robots.ground().map(|ground| &**ground.terrain());
        let moment = Moment { state: &state, params, control_dt: self.config.control_dt, level, terrain };
        let memory = &mut self.one.task;
        let steps = self.step.task.command(&moment, &mut self.rngs[i], memory);
        self.step.task.commanded(&moment, memory);
        steps
    }

    /// Samples commands where they are due; the observation then shows them.
    pub fn renew_commands(&mut self, i: usize, observation: &mut [f32]) {
        let episode = &self.ledger.episode;
        if episode.steps.get(i) < episode.next_command.get(i) {
            return;
        }
        self.take_before_reading(i);
        let steps = self.draw_command(i);
        self.one.episode.next_command = self.one.episode.steps + steps;
        self.observe(i, observation);
    }

    /// Sets the command of robot `i` until the end of its episode.
    ///
    /// # Errors
    /// As [`super::chunk::Chunk::set_command`].
    pub fn hold_command(&mut self, i: usize, command: &[f64]) -> Result<()> {
        if self.episodes[i] == 0 {
            return Err(Error::Inconsistent(
                "a command before the first reset: an episode begins with a new command".into(),
            ));
        }
        self.step.task.check_command(command)?;
        self.take_before_reading(i);
        let state = self.robots.lane_state(i);
        let level = self.one.episode.level as usize;
        let (params, terrain) = (self.robots.params(i), self.robots.ground().map(|ground| &**ground.terrain()));
        let moment = Moment { state: &state, params, control_dt: self.config.control_dt, level, terrain };
        self.one.task[..command.len()].copy_from_slice(command);
        self.step.task.commanded(&moment, &mut self.one.task);
        self.one.episode.next_command = f64::INFINITY;
        self.observe_silently(i);
        Ok(())
    }

    /// Restores the ledger of robot `i` from before its last reading; the reading is then repeated instead of followed
    /// by another.
    fn take_before_reading(&mut self, i: usize) {
        R::Cell::take(&self.ledger, i, &mut self.one);
        let Ledger { sensor, last_sensor, .. } = &mut self.one;
        sensor.copy_from_slice(last_sensor);
    }
}
