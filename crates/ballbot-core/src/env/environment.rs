//! One environment: a robot, a task and a source of random numbers.

use super::balance::{BalanceConfig, Termination};
use super::observation::observe;
use super::reward::{self, RewardTerms, Transition};
use super::{ACTION_LEN, OBSERVATION_LEN};
use crate::error::{Error, Result};
use crate::robot::Ballbot;
use crate::snapshot;
use crate::state::State;
use nalgebra::Vector2;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::{Deserialize, Serialize};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// What a step gave besides the observation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Sum of the reward's terms.
    pub reward: f64,
    /// Why the episode was terminated, if it was.
    pub terminated: Option<Termination>,
    /// Whether the episode reached its last step.
    pub truncated: bool,
    /// Whether the episode is a success if it ends here: upright, and within the bounds of success for the window.
    pub success: bool,
}

impl Outcome {
    /// Whether the episode is over.
    pub fn done(&self) -> bool {
        self.terminated.is_some() || self.truncated
    }
}

/// A balance environment.
///
/// Random numbers come from ChaCha8 (stream 0), seeded by `seed_from_u64`; other streams are left to other uses.
pub struct Environment {
    config: BalanceConfig,
    substeps: usize,
    success_steps: usize,
    robot: Ballbot,
    rng: ChaCha8Rng,
    episode: Episode,
    terms: RewardTerms,
}

/// What an episode remembers.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct Episode {
    steps: usize,
    /// The step at which this episode is truncated.
    limit: usize,
    last_action: [f32; ACTION_LEN],
    /// Consecutive steps, up to now, within the bounds of success.
    good_steps: usize,
    over: bool,
}

/// Everything that the future depends on, encoded by [`Environment::save`].
#[derive(Serialize, Deserialize)]
struct Snapshot {
    robot: Vec<u8>,
    seed: [u8; 32],
    word: u128,
    episode: Episode,
    terms: RewardTerms,
}

impl Environment {
    /// An environment that must be reset before its first step.
    ///
    /// # Errors
    /// What [`BalanceConfig::validate`] and [`Ballbot::new`] find.
    pub fn new(config: &BalanceConfig, seed: u64) -> Result<Self> {
        config.validate()?;
        let robot = Ballbot::new(&config.params, config.model, config.sim_dt)?;
        for start in config.lowest_starts() {
            robot.accepts(&start).map_err(|error| {
                Error::Inconsistent(format!("reset_tilt = {} rad is too much: {error}", config.reset_tilt))
            })?;
        }
        Ok(Self {
            substeps: config.substeps()?,
            success_steps: config.success_steps(),
            robot,
            rng: ChaCha8Rng::seed_from_u64(seed),
            episode: Episode { over: true, ..Episode::default() },
            terms: RewardTerms::default(),
            config: config.clone(),
        })
    }

    /// The task.
    pub fn config(&self) -> &BalanceConfig {
        &self.config
    }

    /// Starts the random numbers anew.
    pub fn seed(&mut self, seed: u64) {
        self.rng = ChaCha8Rng::seed_from_u64(seed);
    }

    /// Begins an episode from a start drawn at random, and writes its first observation.
    ///
    /// # Panics
    /// If `observation` is not of length [`OBSERVATION_LEN`].
    pub fn reset(&mut self, observation: &mut [f32]) {
        let start = self.config.draw_start(&mut self.rng);
        self.begin(&start).expect("the lowest starts were accepted, and this is one above them");
        self.observe(observation);
    }

    /// Begins an episode from a given state, without drawing random numbers.
    ///
    /// # Errors
    /// What [`Ballbot::reset`] finds.
    pub fn reset_to(&mut self, start: &State, observation: &mut [f32]) -> Result<()> {
        self.begin(start)?;
        self.observe(observation);
        Ok(())
    }

    fn begin(&mut self, start: &State) -> Result<()> {
        self.robot.reset(start)?;
        self.episode = Episode { limit: self.config.max_episode_steps, ..Episode::default() };
        self.terms = RewardTerms::default();
        Ok(())
    }

    /// Ends the present episode after `steps` steps instead of the task's number.
    pub(super) fn shorten(&mut self, steps: usize) {
        self.episode.limit = steps.clamp(1, self.config.max_episode_steps);
    }

    /// Whether the episode has ended, or none has begun.
    pub fn over(&self) -> bool {
        self.episode.over
    }

    /// Whether there has been a reset at all.
    pub(super) fn begun(&self) -> bool {
        !self.episode.over || self.episode.steps > 0
    }

    /// Applies an action for one control step and writes the observation that follows. Actions beyond ±1 are clipped;
    /// the caller has checked that they are finite and that the episode is not over.
    pub fn step(&mut self, action: &[f32], observation: &mut [f32]) -> Outcome {
        let action = [0, 1, 2].map(|i| action[i].clamp(-1.0, 1.0));
        let torques = action.map(|a| f64::from(a) * self.config.max_wheel_torque);
        // Should an engine panic on a wild state, that state ends like any other that diverged.
        let robot = &mut self.robot;
        let substeps = self.substeps;
        let intact = catch_unwind(AssertUnwindSafe(|| robot.advance(&torques, substeps))).is_ok();
        if !intact {
            self.rebuild_robot();
        }

        self.episode.steps += 1;
        let state = self.robot.state();
        let terminated = if intact { self.termination(&state) } else { Some(Termination::Diverged) };
        let last_action = std::mem::replace(&mut self.episode.last_action, action);
        let outcome = self.judge(&state, terminated, &last_action);
        self.episode.over = outcome.done();
        self.observe_at(&state, observation);
        outcome
    }

    fn judge(&mut self, state: &State, terminated: Option<Termination>, last_action: &[f32; ACTION_LEN]) -> Outcome {
        let setpoint = Vector2::from(self.config.setpoint);
        let near = (state.ball_position.xy() - setpoint).norm() <= self.config.success_radius;
        let good = terminated.is_none() && near && state.tilt() <= self.config.success_tilt;
        self.episode.good_steps = if good { self.episode.good_steps + 1 } else { 0 };
        let truncated = terminated.is_none() && self.episode.steps >= self.episode.limit;
        let diverged = terminated == Some(Termination::Diverged);
        self.terms = if diverged {
            RewardTerms::default()
        } else {
            let transition = Transition {
                state,
                setpoint: &setpoint,
                action: &self.episode.last_action,
                last_action,
                fallen: terminated.is_some(),
            };
            reward::terms(&self.config.reward, self.config.fall_tilt, self.config.success_radius, &transition)
        };
        Outcome {
            reward: self.terms.sum(),
            terminated,
            truncated,
            success: terminated.is_none() && self.episode.good_steps >= self.success_steps,
        }
    }

    fn termination(&self, state: &State) -> Option<Termination> {
        if self.robot.diverged_at(state).is_some() {
            Some(Termination::Diverged)
        } else if state.tilt() > self.config.fall_tilt {
            Some(Termination::Tilt)
        } else if self.robot.bot_on_floor() {
            Some(Termination::BotOnFloor)
        } else {
            None
        }
    }

    fn rebuild_robot(&mut self) {
        let dynamics = self.robot.joint_dynamics();
        let fresh = Ballbot::new(&self.config.params, self.config.model, self.config.sim_dt);
        self.robot = fresh.expect("the same arguments made a robot before");
        self.robot.set_joint_dynamics(dynamics).expect("the same friction was accepted before");
    }

    /// Writes the present observation.
    ///
    /// # Panics
    /// If `observation` is not of length [`OBSERVATION_LEN`].
    pub fn observe(&self, observation: &mut [f32]) {
        self.observe_at(&self.robot.state(), observation);
    }

    fn observe_at(&self, state: &State, observation: &mut [f32]) {
        assert_eq!(observation.len(), OBSERVATION_LEN, "observation buffer");
        observe(state, &self.config.setpoint.into(), &self.episode.last_action, observation);
    }

    /// The terms of the last step's reward.
    pub fn reward_terms(&self) -> RewardTerms {
        self.terms
    }

    /// The robot.
    pub fn robot(&self) -> &Ballbot {
        &self.robot
    }

    /// The robot, to push it or to change its joint dynamics.
    pub fn robot_mut(&mut self) -> &mut Ballbot {
        &mut self.robot
    }

    /// Everything that the future depends on, as bytes for [`Environment::load`].
    pub fn save(&self) -> Vec<u8> {
        let snapshot = Snapshot {
            robot: self.robot.save(),
            seed: self.rng.get_seed(),
            word: self.rng.get_word_pos(),
            episode: self.episode,
            terms: self.terms,
        };
        snapshot::encode(&snapshot)
    }

    /// Continues from bytes of [`Environment::save`] of an environment with the same configuration.
    ///
    /// # Errors
    /// [`Error::Decode`] if the bytes are not that.
    pub fn load(&mut self, bytes: &[u8]) -> Result<()> {
        let snapshot: Snapshot = snapshot::decode("snapshot of an environment", bytes)?;
        self.robot.load(&snapshot.robot)?;
        self.rng = ChaCha8Rng::from_seed(snapshot.seed);
        self.rng.set_word_pos(snapshot.word);
        self.episode = snapshot.episode;
        self.terms = snapshot.terms;
        Ok(())
    }
}
