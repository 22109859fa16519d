//! Observations of the robots of a chunk.

use super::Environments;
use super::ledger::{Ledger, Ledgers};
use super::measure::Measured;
use super::robots::Robots;
use crate::actuator::Actuator;
use crate::batch::events::Randomized;
use crate::sensor::{EpisodeStart, Sensor};
use crate::task::Task;
use ballbot_base::lane_state::LaneState;
use ballbot_base::lanes::Cell;
use rand_chacha::ChaCha8Rng;

impl<R: Robots, T: Task, A: Actuator, S: Sensor> Environments<R, T, A, S> {
    /// Begins the episode of the sensors of robot `i`; `one` is its ledger.
    pub fn begin_readings(&mut self, i: usize) {
        if self.one.sensor.is_empty() {
            return;
        }
        for (number, cell) in self.one.sensor.iter_mut().zip(&self.ledger.sensor) {
            *number = cell.get(i);
        }
        let state = self.robots.lane_state(i);
        let start = episode_start(&self.robots, self.events.as_deref(), i, &state, &self.rngs[i]);
        self.step.sensor.begin(&start, &mut self.one.sensor);
    }

    /// The numbers of the sensors of robot `i`. Before its first episode they are the readings of the robot at rest in
    /// its current state.
    pub fn sensor_numbers(&self, i: usize) -> impl Fn(usize) -> f64 {
        let at_rest = (self.episodes[i] == 0 && !self.ledger.sensor.is_empty()).then(|| {
            let mut one = Ledger::new(self.step.sizes());
            let state = self.robots.lane_state(i);
            let start = episode_start(&self.robots, self.events.as_deref(), i, &state, &self.rngs[i]);
            self.step.sensor.begin(&start, &mut one.sensor);
            self.step.observe(&state, &mut one);
            one.sensor
        });
        move |number| at_rest.as_ref().map_or_else(|| self.ledger.sensor[number].get(i), |numbers| numbers[number])
    }

    /// Writes the states of all robots as the task observes them. Before its first episode a robot is observed at rest.
    pub fn read_measured(&mut self, states: &mut LaneState<R::Cell>) {
        self.robots.read(states);
        if self.episodes.iter().all(|episodes| *episodes > 0) {
            R::Cell::measure(&self.step.sensor, &mut self.ledger.sensor, &mut self.one.sensor, states);
            return;
        }
        let mut memory = self.ledger.sensor.clone();
        for i in 0..self.used {
            let number = self.sensor_numbers(i);
            memory.iter_mut().enumerate().for_each(|(k, cell)| cell.set(i, number(k)));
        }
        R::Cell::measure(&self.step.sensor, &mut memory, &mut self.one.sensor, states);
    }

    /// Gives the sensors of robot `i` its current gravity, within an episode.
    pub fn note_gravity(&mut self, i: usize) {
        let params = self.robots.params(i);
        // On a floor that moves, each step notes it.
        if !params.has_moving_floor() {
            let gravity = params.gravity_vector();
            self.set_gravity(i, gravity.into(), [0.0; 3]);
        }
    }

    /// Gives the sensors of robots on floors that move their gravity, as its mean over the present control step.
    pub fn feel_floors(&mut self) {
        if !self.floors_move || self.ledger.sensor.is_empty() {
            return;
        }
        let (control_dt, sim_dt) = (self.config.control_dt, self.config.sim_dt);
        for i in 0..self.used {
            let params = self.robots.params(i);
            if !params.has_moving_floor() {
                continue;
            }
            let start = self.ledger.episode.steps.get(i) * control_dt;
            let gravity = params.mean_gravity(start, sim_dt, self.substeps);
            let floor_rate = params.floor_rate_at(start + control_dt);
            self.set_gravity(i, gravity.into(), floor_rate.into());
        }
    }

    fn set_gravity(&mut self, i: usize, gravity: [f64; 3], floor_rate: [f64; 3]) {
        // A reading that is repeated starts from the numbers before it.
        for all in [&mut self.ledger.sensor, &mut self.ledger.last_sensor] {
            let one = &mut self.one.sensor;
            one.iter_mut().zip(&*all).for_each(|(one, cell)| *one = cell.get(i));
            self.step.sensor.set_gravity(gravity, floor_rate, one);
            all.iter_mut().zip(&*one).for_each(|(cell, one)| cell.set(i, *one));
        }
    }

    /// Observes robot `i` again; `one` is its ledger.
    pub fn observe(&mut self, i: usize, observation: &mut [f32]) {
        self.observe_silently(i);
        self.write_observation(i, observation);
    }

    /// The same for an observation that is requested later.
    pub fn observe_silently(&mut self, i: usize) {
        let state = self.robots.lane_state(i);
        self.step.observe(&state, &mut self.one);
        R::Cell::put(&mut self.ledger, i, &self.one);
    }

    #[inline]
    pub fn write_observation(&self, i: usize, row: &mut [f32]) {
        let (rows, perceived) = row.split_at_mut(row.len() - self.perceived());
        self.write_rows(i, rows);
        self.write_perceived(i, perceived);
    }

    /// Writes the rows of an observation of the true state.
    pub fn observe_truth(&mut self, i: usize, row: &mut [f32]) {
        R::Cell::take(&self.ledger, i, &mut self.one);
        self.step.observe_state(&self.robots.lane_state(i), &mut self.one);
        row.iter_mut().zip(&self.one.observation).for_each(|(out, value)| *out = *value as f32);
    }

    /// Reseeds the random numbers of the sensors.
    pub fn seed_sensors(&mut self, i: usize) {
        if self.ledger.sensor.is_empty() {
            return;
        }
        R::Cell::take(&self.ledger, i, &mut self.one);
        self.step.sensor.seeded(&mut self.one.sensor);
        // A reading that is repeated starts from these.
        self.step.sensor.seeded(&mut self.one.last_sensor);
        R::Cell::put(&mut self.ledger, i, &self.one);
    }
}

/// Data for the sensors of robot `i` about an episode that begins in `state`.
fn episode_start<'a>(
    robots: &impl Robots,
    events: Option<&'a Randomized>,
    i: usize,
    state: &'a LaneState<f64>,
    rng: &ChaCha8Rng,
) -> EpisodeStart<'a> {
    let options = events.map(|events| &events.stages(i).sensors);
    let params = robots.params(i);
    EpisodeStart {
        gravity: params.gravity_at(0.0).into(),
        floor_rate: params.floor_rate_at(0.0).into(),
        state,
        key: sensor_key(rng),
        options,
    }
}

/// Key of the random numbers of sensors: the first words of the environment's seed, for a separate generator.
fn sensor_key(rng: &ChaCha8Rng) -> [u32; 2] {
    let seed = rng.get_seed();
    [0, 4].map(|first| u32::from_le_bytes([seed[first], seed[first + 1], seed[first + 2], seed[first + 3]]))
}
