//! One environment: a robot, a task and a source of random numbers.

use super::Autoreset;
use super::buffers::{Outcome, StepBuffers};
use super::config::EnvConfig;
use super::env::Environments;
use super::env::chunk::Chunk;
use super::env::robots::Single;
use super::env::task_step::TaskStep;
use crate::actuator::{Actuator, MotorOptions};
use crate::robot::{Ballbot, check_restored};
use crate::sensor::{Readings, Sensor};
use crate::task::{ACTION_LEN, Balance, Task, TaskDescription};
use ballbot_base::error::{Error, Result};
use ballbot_base::params::Params;
use ballbot_base::state::State;
use std::sync::Arc;

/// The environment of a single robot, with any stages.
trait SingleChunk: Chunk {
    /// The robot.
    fn robot(&self) -> &Ballbot;

    /// The robot, to change it.
    fn robot_mut(&mut self) -> &mut Ballbot;
}

impl<T: Task, A: Actuator, S: Sensor> SingleChunk for Environments<Single, T, A, S> {
    fn robot(&self) -> &Ballbot {
        &self.robots.robot
    }

    fn robot_mut(&mut self) -> &mut Ballbot {
        &mut self.robots.robot
    }
}

/// An environment of task `T` with the actuators and sensors of its configuration.
///
/// Random numbers of starts come from ChaCha8, seeded by `seed_from_u64`; random numbers of events and motors come from
/// Philox4x32-10, whose key is the first two words of that seed.
pub struct Environment<T: Task = Balance> {
    config: Arc<EnvConfig<T>>,
    inner: Box<dyn SingleChunk>,
    terms: Vec<&'static str>,
    /// Rows of the task.
    rows: usize,
    observation: Vec<f32>,
}

impl<T: Task> Environment<T> {
    /// An environment that must be reset before its first step.
    ///
    /// # Errors
    /// The errors of [`EnvConfig::validate`] and [`Ballbot::new`].
    pub fn new(config: &EnvConfig<T>, seed: u64) -> Result<Self> {
        let config = &config.resolved()?;
        config.validate_resolved()?;
        if config.stage.is_some() {
            return Err(Error::Inconsistent("a stage needs a Batch: an Environment does not call it".into()));
        }
        let actuator = config.drive()?;
        let config = Arc::new(config.clone());
        let description = TaskDescription::of::<T>();
        let step = Arc::new(TaskStep::new(&actuator, config.onboard()?, &description, &config)?);
        let robot = Single::new(Ballbot::new(&config.params, config.model, config.sim_dt)?);
        Ok(Self {
            inner: Box::new(Environments::new(&config, &step, actuator, robot, config.plan()?.as_ref(), 1, seed)?),
            rows: description.rows.len(),
            terms: description.terms.iter().map(|term| term.name).collect(),
            observation: vec![0.0; step.observation_len()],
            config,
        })
    }

    /// Its configuration.
    pub fn config(&self) -> &EnvConfig<T> {
        &self.config
    }

    /// Length of an observation.
    pub fn observation_len(&self) -> usize {
        self.observation.len()
    }

    /// Reseeds the random numbers from the next episode on; the current episode keeps its own.
    pub fn seed(&mut self, seed: u64) {
        self.inner.seed(0, seed);
    }

    /// Begins an episode from a random start, and writes its first observation.
    ///
    /// # Panics
    /// If `observation` is not of length [`Environment::observation_len`].
    pub fn reset(&mut self, observation: &mut [f32]) {
        assert_eq!(observation.len(), self.observation_len(), "observation buffer");
        self.inner.reset(0, None, observation).expect("a start that the task draws was accepted when it was made");
    }

    /// Begins an episode from a given state instead of a random start; a command of the task is still sampled.
    ///
    /// # Errors
    /// The errors of [`Ballbot::reset`].
    pub fn reset_to(&mut self, start: &State, observation: &mut [f32]) -> Result<()> {
        self.inner.reset(0, Some(start), observation)
    }

    /// Whether the episode has ended or has not begun.
    pub fn over(&self) -> bool {
        self.inner.first_over().is_some()
    }

    /// Applies an action for one control step and writes the observation that follows. Actions beyond ±1 are clipped;
    /// the caller has checked that they are finite and that the episode is not over.
    ///
    /// # Panics
    /// If `action` is not of length 3, or `observation` not of length [`Environment::observation_len`].
    pub fn step(&mut self, action: &[f32], observation: &mut [f32]) -> Outcome {
        assert_eq!(action.len(), ACTION_LEN, "action");
        assert_eq!(observation.len(), self.observation_len(), "observation buffer");
        let mut outcome = [Outcome::default()];
        let buffers = StepBuffers {
            observations: observation,
            rewards: &mut [0.0],
            terminated: &mut [false],
            truncated: &mut [false],
            final_observations: &mut self.observation,
            outcomes: &mut outcome,
        };
        self.inner.step(Autoreset::Disabled, action, buffers);
        outcome[0]
    }

    /// Names and values of the terms of the last step's reward.
    pub fn reward_terms(&self) -> Vec<(&'static str, f64)> {
        let mut values = vec![0.0; self.terms.len()];
        self.inner.reward_terms(0, &mut values);
        self.terms.iter().copied().zip(values).collect()
    }

    /// The robot.
    pub fn robot(&self) -> &Ballbot {
        self.inner.robot()
    }

    /// As [`super::Batch::nominal_params`].
    pub fn nominal_params(&self) -> &Params {
        self.inner.nominal_params(0)
    }

    /// As [`super::Batch::draws`].
    pub fn draws(&self) -> &[f64] {
        self.inner.draws(0)
    }

    /// As [`super::Batch::readings`].
    ///
    /// # Errors
    /// As [`super::Batch::readings`].
    pub fn readings(&self) -> Result<Readings<f64>> {
        self.inner.readings(0).ok_or_else(super::accessors::no_sensors)
    }

    /// As [`super::Batch::estimate`].
    ///
    /// # Errors
    /// As [`super::Batch::estimate`].
    pub fn estimate(&self) -> Result<State> {
        self.inner.estimate(0).ok_or_else(super::accessors::no_estimator)
    }

    /// As [`super::Batch::privileged_observation`].
    ///
    /// # Errors
    /// As [`super::Batch::privileged_observation`].
    pub fn privileged_observation(&mut self, out: &mut [f32]) -> Result<()> {
        super::accessors::check_len(out.len(), self.rows)?;
        self.inner.privileged_observation(0, out);
        Ok(())
    }

    /// As [`super::Batch::actuators`].
    pub fn actuators(&self) -> &MotorOptions {
        self.inner.drawn_stages(0).map_or(&self.config.actuators, |stages| &stages.actuators)
    }

    /// As [`super::Batch::repeated_draws`].
    pub fn repeated_draws(&self) -> u32 {
        self.inner.repeated_draws(0)
    }

    /// As [`super::Batch::push_count`].
    pub fn push_count(&self) -> u32 {
        self.inner.push_count(0)
    }

    /// Replaces the robot's parameters; see [`super::Batch::set_params`].
    ///
    /// # Errors
    /// As [`super::Batch::set_params`].
    pub fn set_params(&mut self, params: &Params) -> Result<()> {
        self.inner.set_params(0, params)
    }

    /// The robot, to push it or to place it. [`Environment::set_params`] changes its parameters.
    pub fn robot_mut(&mut self) -> &mut Ballbot {
        self.inner.robot_mut()
    }

    /// The complete state, as bytes for [`Environment::load`].
    pub fn save(&self) -> Vec<u8> {
        self.inner.save(0)
    }

    /// Continues from bytes of [`Environment::save`], or of [`super::Batch::save`], of an environment with the same
    /// configuration.
    ///
    /// # Errors
    /// As [`super::Batch::load`].
    pub fn load(&mut self, bytes: &[u8]) -> Result<()> {
        let before = self.inner.save(0);
        self.inner.load(0, bytes)?;
        if let Err(error) = check_restored(&self.inner.state(0), &self.inner.contacts(0)) {
            self.inner.load(0, &before)?;
            return Err(error);
        }
        Ok(())
    }
}
