//! Environments as bytes.

use super::Environments;
use super::ledger::{Ledger, Ledgers};
use super::robots::{Robots, invalid_snapshot};
use crate::actuator::Actuator;
use crate::batch::events::Saved;
use crate::perception::Reading;
use crate::sensor::Sensor;
use crate::task::Task;
use ballbot_base::error::Result;
use ballbot_base::fields::Fields;
use ballbot_base::params::Params;
use ballbot_base::snapshot;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The complete state of an environment.
#[derive(Serialize, Deserialize)]
struct Snapshot {
    task: String,
    model: String,
    options: Vec<f64>,
    params: Vec<f64>,
    robot: Vec<u8>,
    seed: [u8; 32],
    word: u128,
    episode: u32,
    ledger: Ledger<f64>,
    /// Earlier observations.
    past: Vec<f32>,
    over: bool,
    events: Option<Saved>,
    next_seed: Option<u64>,
    level: u32,
    /// Readings of the instruments by name.
    seen: Vec<(String, Reading)>,
}

impl<R: Robots, T: Task, A: Actuator, S: Sensor> Environments<R, T, A, S> {
    /// As [`super::chunk::Chunk::save`].
    pub fn save_one(&self, i: usize) -> Vec<u8> {
        let mut ledger = Ledger::new(self.step.sizes());
        R::Cell::take(&self.ledger, i, &mut ledger);
        snapshot::encode(&Snapshot {
            task: T::NAME.to_owned(),
            model: self.config.model.name().to_owned(),
            options: self.config.numbers(),
            params: self.robots.params(i).numbers(),
            robot: self.robots.save(i),
            seed: self.rngs[i].get_seed(),
            word: self.rngs[i].get_word_pos(),
            episode: self.episodes[i],
            ledger,
            past: self.past_of(i),
            over: self.over[i],
            events: self.events.as_ref().map(|events| events.save(i)),
            next_seed: self.next_seeds[i],
            level: self.levels[i],
            seen: self.seen(i).map(|(name, reading)| (name.to_owned(), reading.clone())).collect(),
        })
    }

    fn perceived_fits(&self, i: usize, saved: &[(String, Reading)]) -> bool {
        let fits = |((name, reading), (saved_name, saved)): ((&str, &Reading), &(String, Reading))| {
            name == saved_name && reading.fits(saved)
        };
        self.seen(i).count() == saved.len() && self.seen(i).zip(saved).all(fits)
    }

    /// As [`super::chunk::Chunk::load`].
    pub fn load_one(&mut self, i: usize, bytes: &[u8]) -> Result<()> {
        let snapshot: Snapshot = snapshot::decode("snapshot of an environment", bytes)?;
        let model = self.config.model.name();
        if (snapshot.task.as_str(), snapshot.model.as_str()) != (T::NAME, model) {
            return Err(invalid_snapshot(format!(
                "it is of task '{}' with a '{}' robot, this is task '{}' with a '{model}' robot",
                snapshot.task,
                snapshot.model,
                T::NAME
            )));
        }
        if snapshot.options != self.config.numbers() {
            return Err(invalid_snapshot(
                "time steps, torque, scaling, reward, robot of the estimator, sensors, terrain, instruments, history or options of its task \
                 differ"
                    .into(),
            ));
        }
        if !self.one.fits(&snapshot.ledger) || !self.past_fits(&snapshot.past) {
            return Err(invalid_snapshot("its task or stages keep other numbers".into()));
        }
        if !self.perceived_fits(i, &snapshot.seen) {
            return Err(invalid_snapshot("its instruments read other numbers".into()));
        }
        let params =
            Params::from_numbers(&snapshot.params).ok_or_else(|| invalid_snapshot("it lacks parameters".into()))?;
        if snapshot.events.is_some() != self.events.is_some() {
            return Err(invalid_snapshot("one of the two has events, the other has none".into()));
        }
        let (old, motion, over) = (self.robots.params(i).clone(), self.robots.save(i), self.over[i]);
        let changed = params != old;
        if changed {
            self.replace_robot(i, &params)?;
        }
        let mut loaded = self.robots.load(i, &snapshot.robot);
        if let (Ok(()), Some(saved), Some(events)) = (&loaded, &snapshot.events, &mut self.events) {
            let plan = Arc::clone(&events.plan);
            let config = &self.config;
            let accept = |nominal: &Params| {
                nominal.validate()?;
                config.check_events(&plan, nominal)
            };
            loaded = events.load(i, saved, &params, accept, &config.check_changed_robot(&self.actuator));
        }
        if let Err(error) = loaded {
            if changed {
                self.robots.set_params(i, &old)?;
                self.note_com(i);
            }
            self.robots.load(i, &motion)?;
            self.over[i] = over;
            return Err(error);
        }
        self.rngs[i] = ChaCha8Rng::from_seed(snapshot.seed);
        self.rngs[i].set_word_pos(snapshot.word);
        self.episodes[i] = snapshot.episode;
        self.next_seeds[i] = snapshot.next_seed;
        R::Cell::put(&mut self.ledger, i, &snapshot.ledger);
        self.restore_past(i, &snapshot.past);
        self.levels[i] = snapshot.level;
        self.restore_perceiving(i, snapshot.seen.into_iter().map(|(_, reading)| reading));
        self.forget_metrics(i);
        self.inform(i);
        self.reset_controllers(i);
        self.over[i] = snapshot.over;
        self.begun |= !snapshot.over;
        Ok(())
    }
}
