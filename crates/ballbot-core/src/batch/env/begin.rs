//! Starts of the episodes of a chunk.

use super::Environments;
use super::ledger::{Ledger, Ledgers};
use super::robots::Robots;
use crate::actuator::Actuator;
use crate::batch::events::key_of;
use crate::batch::levels::Levels;
use crate::sensor::Sensor;
use crate::task::Task;
use ballbot_base::lanes::Cell;
use ballbot_base::state::State;

impl<R: Robots, T: Task, A: Actuator, S: Sensor> Environments<R, T, A, S> {
    /// Places robot `i` in an accepted state and begins an episode.
    pub fn begin(&mut self, i: usize, start: &State, observation: &mut [f32]) {
        self.robots.place(i, start);
        self.one.begin(self.config.max_episode_steps as f64);
        let key = key_of(self.rngs[i].get_seed());
        self.actuator.begin(key, self.episodes[i], &mut self.one.actuator);
        if let Some(events) = self.events.as_ref().filter(|_| self.actuator.is_individual()) {
            self.actuator.equip(&events.stages(i).actuators, self.robots.params(i), &mut self.one.actuator);
        }
        if let Some(tiles) = self.tiles() {
            let [column, level] = tiles.nearest(start.ball_position.x, start.ball_position.y);
            self.one.episode.origin = tiles.center(column, level);
            self.one.episode.level = level as f64;
        }
        self.one.episode.next_command = self.draw_command(i);
        self.over[i] = false;
        self.begun = true;
        self.reset_controllers(i);
        self.begin_readings(i);
        self.begin_perceiving(i);
        // An observation repeated before the first step repeats the first reading.
        let Ledger { sensor, last_sensor, .. } = &mut self.one;
        last_sensor.copy_from_slice(sensor);
        self.observe(i, observation);
    }

    /// Moves a start of robot `i` on level ground to its own ground.
    pub fn on_ground(&self, i: usize, start: State) -> State {
        match self.robots.ground() {
            Some(ground) => ground.adapted(self.robots.params(i), self.robots.wheels(i), &start),
            None => start,
        }
    }

    pub fn begin_at_random(&mut self, i: usize, observation: &mut [f32]) {
        self.renew(i);
        let (params, wheels) = (self.robots.params(i), self.robots.wheels(i));
        let mut start = self.step.task.start(params, wheels, &mut self.rngs[i]);
        if let Some(tiles) = self.tiles() {
            let [column, level] = self.config.levels.draw(&tiles, &mut self.levels[i], &mut self.rngs[i]);
            let [x, y] = tiles.center(column, level);
            for position in [&mut start.ball_position, &mut start.body_position] {
                position.x += x;
                position.y += y;
            }
        }
        let start = self.on_ground(i, start);
        // The extreme starts were accepted, and they bound this start.
        self.begin(i, &start, observation);
    }

    /// Updates the level of the next episode of robot `i` from the end of its last episode.
    pub fn note_level(&mut self, i: usize) {
        if self.config.levels == Levels::Curriculum {
            R::Cell::take(&self.ledger, i, &mut self.one);
            let fell = self.ledger.episode.termination.get(i) > 0.0;
            self.levels[i] = Levels::after(self.levels[i], self.step.task.share(&self.one.task), fell);
        }
    }

    fn tiles(&self) -> Option<ballbot_base::terrain::Tiles> {
        self.robots.ground().and_then(|ground| ground.terrain().tiles().copied())
    }
}
