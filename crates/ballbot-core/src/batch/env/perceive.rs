//! How the robots of a chunk perceive the ground.

use super::Environments;
use super::robots::Robots;
use crate::actuator::Actuator;
use crate::batch::events::key_of;
use crate::perception::{Channel, Perception, Reading, Seen, View};
use crate::sensor::Sensor;
use crate::task::Task;
use ballbot_base::lanes::Cell;
use std::sync::Arc;

/// Separates the random numbers of instruments from the numbers of events and sensors under the same seed.
const KEY: u32 = 0x5CA9_0001;

fn key(seed: [u8; 32]) -> [u32; 2] {
    let [first, second] = key_of(seed);
    [first ^ KEY, second]
}

/// Instruments with the readings of each robot.
pub struct Sight {
    pub perception: Arc<Perception>,
    pub seen: Vec<Seen>,
}

impl Sight {
    pub fn new(perception: &Arc<Perception>, robots: usize) -> Self {
        Self { perception: Arc::clone(perception), seen: vec![perception.nothing(); robots] }
    }
}

impl<R: Robots, T: Task, A: Actuator, S: Sensor> Environments<R, T, A, S> {
    /// How many numbers the instruments add to an observation.
    pub fn perceived(&self) -> usize {
        self.sight.as_ref().map_or(0, |sight| sight.perception.width())
    }

    /// Begins the episode of the instruments of robot `i`.
    pub fn begin_perceiving(&mut self, i: usize) {
        let Some(sight) = &mut self.sight else { return };
        let view = View::of(&self.robots.lane_state(i), self.robots.params(i).ball_radius);
        let terrain = self.robots.ground().map(|ground| &**ground.terrain());
        let key = key(self.rngs[i].get_seed());
        sight.perception.begin(&mut sight.seen[i], key, self.episodes[i], &view, terrain);
    }

    /// Readings of the instruments of robot `i` by name.
    pub fn seen(&self, i: usize) -> impl Iterator<Item = (&'static str, &Reading)> {
        self.sight.iter().flat_map(move |sight| {
            let names = sight.perception.channels().iter().map(Channel::name);
            names.zip(&sight.seen[i].readings)
        })
    }

    /// Continues from saved readings of robot `i`, under its current random numbers.
    pub fn restore_perceiving(&mut self, i: usize, readings: impl Iterator<Item = Reading>) {
        let Some(sight) = &mut self.sight else { return };
        sight.seen[i].readings.iter_mut().zip(readings).for_each(|(reading, saved)| *reading = saved);
        sight.perception.restore(&mut sight.seen[i], key(self.rngs[i].get_seed()), self.episodes[i]);
    }

    /// Takes the samples and readings that are due after a step of robot `i`.
    pub fn perceive(&mut self, i: usize) {
        let Some(sight) = &mut self.sight else { return };
        let view = || View::of(&self.robots.lane_state(i), self.robots.params(i).ball_radius);
        let terrain = self.robots.ground().map(|ground| &**ground.terrain());
        let step = self.ledger.episode.steps.get(i) as u64;
        sight.perception.step(&mut sight.seen[i], step, &view, terrain);
    }

    /// Writes the readings of robot `i` after the rows of its task.
    #[inline]
    pub fn write_perceived(&self, i: usize, out: &mut [f32]) {
        if let Some(sight) = &self.sight {
            sight.perception.write(&sight.seen[i], out);
        }
    }
}
