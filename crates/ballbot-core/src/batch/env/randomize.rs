//! How events change the robots of a chunk.

use super::Environments;
use super::robots::Robots;
use crate::actuator::Actuator;
use crate::batch::autoreset::Autoreset;
use crate::batch::events::{Source, key_of};
use crate::sensor::Sensor;
use crate::task::Task;
use ballbot_base::lanes::Cell;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

impl<R: Robots, T: Task, A: Actuator, S: Sensor> Environments<R, T, A, S> {
    /// Applies the events of a new episode to robot `i`; it must then be placed.
    pub fn renew(&mut self, i: usize) {
        if let Some(seed) = self.next_seeds[i].take() {
            self.rngs[i] = ChaCha8Rng::seed_from_u64(seed);
            self.episodes[i] = 0;
            self.levels[i] = 0;
            if let Some(events) = &mut self.events {
                events.seed(i);
            }
            self.seed_sensors(i);
        }
        self.episodes[i] = self.episodes[i].wrapping_add(1);
        if let Some(events) = &mut self.events {
            let source = Source { key: key_of(self.rngs[i].get_seed()), episode: self.episodes[i] };
            events.begin(&mut self.robots, i, source, &self.config.check_changed_robot(&self.actuator));
            self.note_com(i);
        }
    }

    /// Whether each robot has separate motors.
    pub fn has_own_motors(&self) -> bool {
        self.actuator.is_individual() && self.events.is_some()
    }

    /// Updates the stages of robot `i` from its parameters, within an episode.
    pub fn inform(&mut self, i: usize) {
        self.equip(i);
        self.note_gravity(i);
    }

    /// Gives robot `i` its current motors.
    fn equip(&mut self, i: usize) {
        let Some(events) = self.events.as_ref().filter(|_| self.actuator.is_individual()) else { return };
        let (all, one) = (&mut self.ledger.actuator, &mut self.one.actuator);
        one.iter_mut().zip(&*all).for_each(|(one, cell)| *one = cell.get(i));
        self.actuator.equip(&events.stages(i).actuators, self.robots.params(i), one);
        all.iter_mut().zip(&*one).for_each(|(cell, one)| cell.set(i, *one));
    }

    /// Fires the events that are due.
    pub fn fire_events(&mut self, autoreset: Autoreset) {
        for i in 0..self.used {
            let Some(events) = self.events.as_mut().filter(|events| events.plan.timed) else { return };
            let step = self.ledger.episode.steps.get(i);
            if events.due(i, step) && !(autoreset == Autoreset::NextStep && self.over[i]) {
                let source = Source { key: key_of(self.rngs[i].get_seed()), episode: self.episodes[i] };
                // The shape does not change, so the CoM stays where it is.
                if events.fire(&mut self.robots, i, source, step, &self.config.check_changed_robot(&self.actuator)) {
                    self.inform(i);
                }
            }
        }
    }
}
