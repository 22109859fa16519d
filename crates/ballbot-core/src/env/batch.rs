//! Many environments in step.

use super::environment::{Environment, Outcome};
use super::{ACTION_LEN, BalanceConfig, OBSERVATION_LEN};
use crate::error::{Error, Result};
use crate::state::State;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::str::FromStr;

/// What happens to an environment whose episode has ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Autoreset {
    /// It is reset by the next step, which ignores its action and gives a reward of zero.
    #[default]
    NextStep,
    /// It is reset within the same step; the last observation of the episode is kept apart.
    SameStep,
    /// It must be reset by the caller before it is stepped again.
    Disabled,
}

impl FromStr for Autoreset {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        match name {
            "next_step" => Ok(Self::NextStep),
            "same_step" => Ok(Self::SameStep),
            "disabled" => Ok(Self::Disabled),
            _ => Err(Error::unknown("autoreset mode", name, &["next_step", "same_step", "disabled"])),
        }
    }
}

/// What [`Batch::reset_with`] does; each slice has one element an environment.
#[derive(Clone, Copy, Debug, Default)]
pub struct ResetRequest<'a> {
    /// Which environments to reset; all without one.
    pub mask: Option<&'a [bool]>,
    /// Seeds to start the random numbers from; `None` leaves them as they are.
    pub seeds: Option<&'a [Option<u64>]>,
    /// States to begin with; `None` draws one.
    pub starts: Option<&'a [Option<State>]>,
}

/// Where a step writes its results: one element an environment, observations one row an environment.
pub struct StepBuffers<'a> {
    /// Observations, n × [`OBSERVATION_LEN`].
    pub observations: &'a mut [f32],
    /// Rewards.
    pub rewards: &'a mut [f32],
    /// Whether each episode was terminated.
    pub terminated: &'a mut [bool],
    /// Whether each episode was truncated.
    pub truncated: &'a mut [bool],
    /// With [`Autoreset::SameStep`], rows of ended episodes get their last observation; other rows are left alone.
    pub final_observations: &'a mut [f32],
    /// What each step gave in full.
    pub outcomes: &'a mut [Outcome],
}

/// Environments of one task that are stepped together, on as many threads as asked.
///
/// Environment i is seeded with `seed + i`. Results do not depend on the number of threads.
pub struct Batch {
    environments: Vec<Environment>,
    autoreset: Autoreset,
    workers: Workers,
}

/// A thread pool made when it is first needed. A forked child has none of its parent's threads, so a pool serves only
/// the process that made it.
struct Workers {
    threads: usize,
    pool: Option<(u32, ThreadPool)>,
}

impl Workers {
    fn pool(&mut self) -> Result<&ThreadPool> {
        let process = std::process::id();
        if self.pool.as_ref().is_some_and(|(owner, _)| *owner != process) {
            // Its threads died with the fork: dropping it could wait for them.
            std::mem::forget(self.pool.take());
        }
        if self.pool.is_none() {
            let pool = ThreadPoolBuilder::new()
                .num_threads(self.threads)
                .thread_name(|i| format!("ballbot-{i}"))
                .build()
                .map_err(|e| Error::Inconsistent(format!("cannot start {} threads: {e}", self.threads)))?;
            self.pool = Some((process, pool));
        }
        Ok(&self.pool.as_ref().expect("just made").1)
    }
}

/// One environment with its share of the buffers.
struct Lane<'a> {
    environment: &'a mut Environment,
    action: &'a [f32],
    observation: &'a mut [f32],
    final_observation: &'a mut [f32],
    outcome: &'a mut Outcome,
}

impl Lane<'_> {
    fn step(self, autoreset: Autoreset) {
        if autoreset == Autoreset::NextStep && self.environment.over() {
            self.environment.reset(self.observation);
            *self.outcome = Outcome::default();
            return;
        }
        *self.outcome = self.environment.step(self.action, self.observation);
        if autoreset == Autoreset::SameStep && self.outcome.done() {
            self.final_observation.copy_from_slice(self.observation);
            self.environment.reset(self.observation);
        }
    }
}

impl Batch {
    /// `num_envs` environments on `num_threads` threads (as many as there are cores if `None`, never more than there are
    /// environments).
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for zero environments or threads; what [`Environment::new`] finds.
    pub fn new(
        config: &BalanceConfig,
        num_envs: usize,
        autoreset: Autoreset,
        num_threads: Option<usize>,
        seed: u64,
    ) -> Result<Self> {
        if num_envs == 0 {
            return Err(Error::Inconsistent("num_envs = 0, it must be at least 1".into()));
        }
        if num_threads == Some(0) {
            return Err(Error::Inconsistent("num_threads = 0, it must be at least 1".into()));
        }
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let environments =
            (0..num_envs).map(|i| Environment::new(config, seed.wrapping_add(i as u64))).collect::<Result<Vec<_>>>()?;
        let threads = num_threads.unwrap_or(cores).min(num_envs);
        Ok(Self { environments, autoreset, workers: Workers { threads, pool: None } })
    }

    /// Number of environments.
    pub fn len(&self) -> usize {
        self.environments.len()
    }

    /// Whether there are none, which cannot be.
    pub fn is_empty(&self) -> bool {
        self.environments.is_empty()
    }

    /// Number of threads that step them.
    pub fn num_threads(&self) -> usize {
        self.workers.threads
    }

    /// What happens when an episode ends.
    pub fn autoreset(&self) -> Autoreset {
        self.autoreset
    }

    /// The environments.
    pub fn environments(&self) -> &[Environment] {
        &self.environments
    }

    /// One environment, to push its robot or to change its joint dynamics.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if there is no such environment.
    pub fn environment_mut(&mut self, index: usize) -> Result<&mut Environment> {
        let len = self.len();
        self.environments.get_mut(index).ok_or_else(|| Error::OutOfRange {
            name: "environment index".into(),
            value: index as f64,
            limit: format!("below num_envs = {len}"),
        })
    }

    /// Seeds the environments, one number each; `None` leaves one as it is.
    ///
    /// # Errors
    /// [`Error::Length`] unless there is one entry for each environment.
    pub fn seed(&mut self, seeds: &[Option<u64>]) -> Result<()> {
        self.expect_len("seeds", seeds.len(), self.len())?;
        for (environment, seed) in self.environments.iter_mut().zip(seeds) {
            if let Some(seed) = seed {
                environment.seed(*seed);
            }
        }
        Ok(())
    }

    /// Resets the environments whose `mask` is set (all without one) and writes the observations of all.
    ///
    /// # Errors
    /// [`Error::Length`] for buffers of the wrong length.
    pub fn reset(&mut self, mask: Option<&[bool]>, observations: &mut [f32]) -> Result<()> {
        self.reset_with(&ResetRequest { mask, ..ResetRequest::default() }, observations)
    }

    /// Seeds environments, resets them from given states or from ones drawn at random, and writes the observations of
    /// all. An environment that starts from a given state draws no random numbers.
    ///
    /// # Errors
    /// [`Error::Length`] for anything of the wrong length, [`Error::Inconsistent`] for the start of an environment that
    /// the mask leaves alone, and what [`crate::Ballbot::reset`] finds in a start. Nothing has changed then.
    pub fn reset_with(&mut self, request: &ResetRequest<'_>, observations: &mut [f32]) -> Result<()> {
        let n = self.len();
        self.expect_len("observations", observations.len(), n * OBSERVATION_LEN)?;
        let masked = |i: usize| request.mask.is_none_or(|mask| mask[i]);
        let start = |i: usize| request.starts.and_then(|starts| starts[i].as_ref());
        if let Some(mask) = request.mask {
            self.expect_len("reset mask", mask.len(), n)?;
        }
        if let Some(starts) = request.starts {
            self.expect_len("starts", starts.len(), n)?;
        }
        for (i, environment) in self.environments.iter().enumerate() {
            if let Some(start) = start(i) {
                if !masked(i) {
                    return Err(Error::Inconsistent(format!(
                        "environment {i} has a start, but the mask leaves it alone"
                    )));
                }
                environment.robot().accepts(start)?;
            }
        }
        if let Some(seeds) = request.seeds {
            self.seed(seeds)?;
        }
        let rows = observations.chunks_exact_mut(OBSERVATION_LEN);
        for (i, (environment, row)) in self.environments.iter_mut().zip(rows).enumerate() {
            match start(i) {
                Some(start) => environment.reset_to(start, row)?,
                None if masked(i) => environment.reset(row),
                None => environment.observe(row),
            }
        }
        Ok(())
    }

    /// Spreads the ends of the present episodes evenly over the length of an episode, so that environments reset
    /// together are not truncated together.
    pub fn stagger(&mut self) {
        let n = self.len();
        for (i, environment) in self.environments.iter_mut().enumerate() {
            let steps = environment.config().max_episode_steps;
            environment.shorten((steps as u128 * (i as u128 + 1) / n as u128) as usize);
        }
    }

    /// Steps every environment. `actions` has one row of three an environment, in [-1, 1].
    ///
    /// # Errors
    /// [`Error::Length`] for buffers of the wrong length, [`Error::OutOfRange`] for an action that is not finite,
    /// [`Error::Inconsistent`] with [`Autoreset::Disabled`] where an episode is over. Nothing has moved then.
    pub fn step(&mut self, actions: &[f32], buffers: &mut StepBuffers<'_>) -> Result<()> {
        self.check_step(actions, buffers)?;
        let autoreset = self.autoreset;
        if self.workers.threads == 1 {
            lanes(&mut self.environments, actions, buffers).for_each(|lane| lane.step(autoreset));
        } else {
            let environments = &mut self.environments;
            let pool = self.workers.pool()?;
            pool.install(|| parallel_lanes(environments, actions, buffers).for_each(|lane| lane.step(autoreset)));
        }
        for (i, outcome) in buffers.outcomes.iter().enumerate() {
            buffers.rewards[i] = outcome.reward as f32;
            buffers.terminated[i] = outcome.terminated.is_some();
            buffers.truncated[i] = outcome.truncated;
        }
        Ok(())
    }

    fn check_step(&self, actions: &[f32], buffers: &StepBuffers<'_>) -> Result<()> {
        let n = self.len();
        self.expect_len("actions", actions.len(), n * ACTION_LEN)?;
        self.expect_len("observations", buffers.observations.len(), n * OBSERVATION_LEN)?;
        self.expect_len("final observations", buffers.final_observations.len(), n * OBSERVATION_LEN)?;
        for len in [buffers.rewards.len(), buffers.terminated.len(), buffers.truncated.len(), buffers.outcomes.len()] {
            self.expect_len("a step buffer", len, n)?;
        }
        if let Some(i) = actions.iter().position(|a| !a.is_finite()) {
            return Err(Error::OutOfRange {
                name: format!("actions[{}, {}]", i / ACTION_LEN, i % ACTION_LEN),
                value: f64::from(actions[i]),
                limit: "finite".into(),
            });
        }
        if self.autoreset == Autoreset::NextStep && !self.environments.iter().any(Environment::begun) {
            return Err(Error::Inconsistent("step before the first reset".into()));
        }
        if self.autoreset != Autoreset::NextStep
            && let Some(i) = self.environments.iter().position(Environment::over)
        {
            return Err(Error::Inconsistent(format!(
                "the episode of environment {i} is over (or has not begun): reset it before it is stepped"
            )));
        }
        Ok(())
    }

    fn expect_len(&self, name: &str, found: usize, expected: usize) -> Result<()> {
        if found == expected { Ok(()) } else { Err(Error::Length { name: name.into(), found, expected }) }
    }
}

fn lanes<'a>(
    environments: &'a mut [Environment],
    actions: &'a [f32],
    buffers: &'a mut StepBuffers<'_>,
) -> impl Iterator<Item = Lane<'a>> {
    environments
        .iter_mut()
        .zip(actions.chunks_exact(ACTION_LEN))
        .zip(buffers.observations.chunks_exact_mut(OBSERVATION_LEN))
        .zip(buffers.final_observations.chunks_exact_mut(OBSERVATION_LEN))
        .zip(buffers.outcomes.iter_mut())
        .map(lane)
}

fn parallel_lanes<'a>(
    environments: &'a mut [Environment],
    actions: &'a [f32],
    buffers: &'a mut StepBuffers<'_>,
) -> impl ParallelIterator<Item = Lane<'a>> {
    environments
        .par_iter_mut()
        .zip(actions.par_chunks_exact(ACTION_LEN))
        .zip(buffers.observations.par_chunks_exact_mut(OBSERVATION_LEN))
        .zip(buffers.final_observations.par_chunks_exact_mut(OBSERVATION_LEN))
        .zip(buffers.outcomes.par_iter_mut())
        .map(lane)
}

type Zipped<'a> = ((((&'a mut Environment, &'a [f32]), &'a mut [f32]), &'a mut [f32]), &'a mut Outcome);

fn lane<'a>(((((environment, action), observation), final_observation), outcome): Zipped<'a>) -> Lane<'a> {
    Lane { environment, action, observation, final_observation, outcome }
}
