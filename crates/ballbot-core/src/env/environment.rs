//! One environment: a robot, a task and a source of random numbers.

use super::OBSERVATION_LEN;
use super::balance::{BalanceConfig, Termination};
use super::judge::{Episode, Judge, Robot, Verdict};
use super::reward::RewardTerms;
use crate::error::{Error, Result};
use crate::lane_state::LaneState;
use crate::lanes::{Scalar, run_one};
use crate::robot::Ballbot;
use crate::snapshot;
use crate::state::State;
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
    /// From the numbers of a [`Verdict`].
    pub(super) fn new(reward: f64, termination: f64, truncated: f64, success: f64) -> Self {
        let terminated = match termination as u8 {
            1 => Some(Termination::Tilt),
            2 => Some(Termination::BotOnFloor),
            3 => Some(Termination::Diverged),
            _ => None,
        };
        Self { reward, terminated, truncated: truncated > 0.0, success: success > 0.0 }
    }

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
    judge: Judge,
    robot: Ballbot,
    rng: ChaCha8Rng,
    episode: Episode<f64>,
    over: bool,
    verdict: Verdict<f64>,
}

/// An environment but for its task.
pub(super) struct Parts {
    /// What [`crate::Model::save`] gives.
    pub model: Vec<u8>,
    pub rng: ChaCha8Rng,
    pub episode: Episode<f64>,
    pub over: bool,
    pub verdict: Verdict<f64>,
}

/// Everything that the future depends on, encoded by [`Environment::save`].
#[derive(Serialize, Deserialize)]
struct Snapshot {
    robot: Vec<u8>,
    seed: [u8; 32],
    word: u128,
    episode: Episode<f64>,
    over: bool,
    verdict: Verdict<f64>,
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
            judge: Judge::new(config),
            robot,
            rng: ChaCha8Rng::seed_from_u64(seed),
            episode: Episode::default(),
            over: true,
            verdict: Verdict::default(),
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
        self.episode = Episode { limit: self.config.max_episode_steps as f64, ..Episode::default() };
        self.over = false;
        self.verdict = Verdict::default();
        Ok(())
    }

    /// Ends the present episode after `steps` steps instead of the task's number.
    pub(super) fn shorten(&mut self, steps: usize) {
        self.episode.limit = steps.clamp(1, self.config.max_episode_steps) as f64;
    }

    /// Whether the episode has ended, or none has begun.
    pub fn over(&self) -> bool {
        self.over
    }

    /// Whether there has been a reset at all.
    pub(super) fn begun(&self) -> bool {
        !self.over || self.episode.steps > 0.0
    }

    /// Applies an action for one control step and writes the observation that follows. Actions beyond ±1 are clipped;
    /// the caller has checked that they are finite and that the episode is not over.
    pub fn step(&mut self, action: &[f32], observation: &mut [f32]) -> Outcome {
        let action = [0, 1, 2].map(|i| f64::from(action[i]).clamp(-1.0, 1.0));
        let torques = action.map(|a| a * self.config.max_wheel_torque);
        // Should an engine panic on a wild state, that state ends like any other that diverged.
        let robot = &mut self.robot;
        let substeps = self.substeps;
        let intact = catch_unwind(AssertUnwindSafe(|| robot.advance(&torques, substeps))).is_ok();
        if !intact {
            self.rebuild_robot();
        }

        let robot = Robot {
            state: LaneState::from(&self.robot.state()),
            healthy: intact && self.robot.healthy(),
            on_floor: self.robot.bot_on_floor(),
        };
        run_one(
            #[inline(always)]
            || self.judge.judge(Scalar, &robot, action, &mut self.episode, &mut self.verdict),
        );
        write_observation(&self.verdict.observation, observation);
        let v = &self.verdict;
        let outcome = Outcome::new(v.reward, v.termination, v.truncated, v.success);
        self.over = outcome.done();
        outcome
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
        let state = LaneState::from(&self.robot.state());
        let sensed = run_one(
            #[inline(always)]
            || self.judge.observe(&state, &self.episode.last_action),
        );
        write_observation(&sensed, observation);
    }

    /// The terms of the last step's reward.
    pub fn reward_terms(&self) -> RewardTerms {
        RewardTerms::from_values(self.verdict.terms)
    }

    /// The robot.
    pub fn robot(&self) -> &Ballbot {
        &self.robot
    }

    /// The robot, to push it or to change its joint dynamics.
    pub fn robot_mut(&mut self) -> &mut Ballbot {
        &mut self.robot
    }

    pub(super) fn parts(&self) -> Parts {
        Parts {
            model: self.robot.save_model(),
            rng: self.rng.clone(),
            episode: self.episode.clone(),
            over: self.over,
            verdict: self.verdict.clone(),
        }
    }

    /// # Panics
    /// If the model is not of this environment's kind.
    pub(super) fn set_parts(&mut self, parts: Parts) {
        self.robot.load_model(&parts.model).expect("parts come from environments of the same task");
        self.rng = parts.rng;
        self.episode = parts.episode;
        self.over = parts.over;
        self.verdict = parts.verdict;
    }

    /// Everything that the future depends on, as bytes for [`Environment::load`].
    pub fn save(&self) -> Vec<u8> {
        let snapshot = Snapshot {
            robot: self.robot.save(),
            seed: self.rng.get_seed(),
            word: self.rng.get_word_pos(),
            episode: self.episode.clone(),
            over: self.over,
            verdict: self.verdict.clone(),
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
        self.over = snapshot.over;
        self.verdict = snapshot.verdict;
        Ok(())
    }
}

/// As float32.
///
/// # Panics
/// If `row` is not of length [`OBSERVATION_LEN`].
pub(super) fn write_observation(observation: &[f64; OBSERVATION_LEN], row: &mut [f32]) {
    assert_eq!(row.len(), OBSERVATION_LEN, "observation buffer");
    for (out, value) in row.iter_mut().zip(observation) {
        *out = *value as f32;
    }
}
