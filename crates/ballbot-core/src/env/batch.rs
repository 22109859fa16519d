//! Many environments in step.

use super::block::Block;
use super::environment::{Environment, Outcome};
use super::group::{Group, GroupBuffers};
use super::{ACTION_LEN, BalanceConfig, OBSERVATION_LEN};
use crate::error::{Error, Result};
use crate::lanes::EIGHT;
use crate::robot::ModelKind;
use crate::state::State;
use crate::workers::{Workers, thread_count};
use std::str::FromStr;
use std::sync::{Mutex, PoisonError};

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
    config: BalanceConfig,
    len: usize,
    /// Environments in order, `width` to a group; the last may have fewer.
    groups: Vec<Box<dyn Group>>,
    width: usize,
    autoreset: Autoreset,
    /// Of a step, the caller's among them.
    threads: usize,
    /// Others that a step is worth waking.
    helpers: Workers,
}

/// What a helping thread must have to do for its waking to pay, s.
const WORTH_WAKING: f64 = 50e-6;

/// Into how many pieces a step is cut for each thread, to even out what falling robots and busy processors cost.
const PIECES_PER_THREAD: usize = 8;

impl Batch {
    /// `num_envs` environments on up to `num_threads` threads: as many as there are cores if `None`, never more than there
    /// are environments (eights of them in the contact model), and fewer where waking one would not pay.
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
        let threads = thread_count(num_threads)?;
        let width = if config.model == ModelKind::Contact { EIGHT } else { 1 };
        let group = |first: usize| -> Result<Box<dyn Group>> {
            let seed = seed.wrapping_add(first as u64);
            Ok(match config.model {
                ModelKind::Contact => Box::new(Block::new(config, (num_envs - first).min(width), seed)?),
                _ => Box::new(Environment::new(config, seed)?),
            })
        };
        let groups = (0..num_envs).step_by(width).map(group).collect::<Result<Vec<_>>>()?;
        let threads = threads.min(groups.len());
        let seconds = (num_envs * config.substeps()?) as f64 * config.model.step_seconds();
        let helpers = (threads - 1).min((seconds / WORTH_WAKING) as usize);
        let helpers = Workers::new(helpers);
        Ok(Self { config: config.clone(), len: num_envs, groups, width, autoreset, threads, helpers })
    }

    /// Number of environments.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none, which cannot be.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Number of threads that step them.
    pub fn num_threads(&self) -> usize {
        self.threads
    }

    /// What happens when an episode ends.
    pub fn autoreset(&self) -> Autoreset {
        self.autoreset
    }

    /// The task.
    pub fn config(&self) -> &BalanceConfig {
        &self.config
    }

    /// Shows one environment.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if there is no such environment.
    pub fn view(&mut self, index: usize) -> Result<&Environment> {
        let (group, i) = self.locate(index)?;
        Ok(self.groups[group].view(i))
    }

    /// Changes one environment: pushes its robot, changes its joint dynamics, continues from a snapshot.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if there is no such environment; what `change` returns.
    pub fn edit<R>(&mut self, index: usize, change: impl FnOnce(&mut Environment) -> Result<R>) -> Result<R> {
        let (group, i) = self.locate(index)?;
        let (mut change, mut changed) = (Some(change), None);
        self.groups[group].edit(i, &mut |environment| changed = change.take().map(|change| change(environment)));
        changed.expect("a group shows its environment once")
    }

    /// The group of an environment, and its place there.
    fn locate(&self, index: usize) -> Result<(usize, usize)> {
        if index < self.len {
            return Ok((index / self.width, index % self.width));
        }
        Err(Error::OutOfRange {
            name: "environment index".into(),
            value: index as f64,
            limit: format!("below num_envs = {}", self.len),
        })
    }

    /// All environments: their groups and places.
    fn places(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let width = self.width;
        (0..self.len).map(move |index| (index / width, index % width))
    }

    /// Seeds the environments, one number each; `None` leaves one as it is.
    ///
    /// # Errors
    /// [`Error::Length`] unless there is one entry for each environment.
    pub fn seed(&mut self, seeds: &[Option<u64>]) -> Result<()> {
        self.expect_len("seeds", seeds.len(), self.len())?;
        for ((group, i), seed) in self.places().zip(seeds) {
            if let Some(seed) = seed {
                self.groups[group].seed(i, *seed);
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
        for index in 0..n {
            if let Some(start) = start(index) {
                if !masked(index) {
                    return Err(Error::Inconsistent(format!(
                        "environment {index} has a start, but the mask leaves it alone"
                    )));
                }
                self.groups[index / self.width].accepts(start)?;
            }
        }
        if let Some(seeds) = request.seeds {
            self.seed(seeds)?;
        }
        let rows = observations.chunks_exact_mut(OBSERVATION_LEN);
        for (index, ((group, i), row)) in self.places().zip(rows).enumerate() {
            if masked(index) {
                self.groups[group].reset(i, start(index), row)?;
            } else {
                self.groups[group].observe(i, row);
            }
        }
        Ok(())
    }

    /// Spreads the ends of the present episodes evenly over the length of an episode, so that environments reset
    /// together are not truncated together.
    pub fn stagger(&mut self) {
        let n = self.len();
        let steps = self.config.max_episode_steps as u128;
        for (index, (group, i)) in self.places().enumerate() {
            self.groups[group].shorten(i, (steps * (index as u128 + 1) / n as u128) as usize);
        }
    }

    /// Steps every environment. `actions` has one row of three an environment, in [-1, 1].
    ///
    /// # Errors
    /// [`Error::Length`] for buffers of the wrong length, [`Error::OutOfRange`] for an action that is not finite,
    /// [`Error::Inconsistent`] with [`Autoreset::Disabled`] where an episode is over. Nothing has moved then.
    pub fn step(&mut self, actions: &[f32], buffers: &mut StepBuffers<'_>) -> Result<()> {
        self.check_step(actions, buffers)?;
        let (autoreset, width) = (self.autoreset, self.width);
        if self.helpers.count() == 0 {
            step_groups(&mut self.groups, width, autoreset, whole(actions, buffers));
            return Ok(());
        }
        let groups = self.groups.len().div_ceil(PIECES_PER_THREAD * (self.helpers.count() + 1));
        let pieces = Mutex::new(pieces(&mut self.groups, groups, groups * width, whole(actions, buffers)));
        self.helpers.share(|| {
            let next = || pieces.lock().unwrap_or_else(PoisonError::into_inner).next();
            while let Some((groups, share)) = next() {
                step_groups(groups, width, autoreset, share);
            }
        })
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
        if self.autoreset == Autoreset::NextStep && !self.groups.iter().any(|group| group.begun()) {
            return Err(Error::Inconsistent("step before the first reset".into()));
        }
        if self.autoreset != Autoreset::NextStep
            && let Some((group, i)) =
                self.groups.iter().enumerate().find_map(|(g, group)| Some((g, group.first_over()?)))
        {
            let i = group * self.width + i;
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

fn whole<'a>(actions: &'a [f32], buffers: &'a mut StepBuffers<'_>) -> GroupBuffers<'a> {
    GroupBuffers {
        actions,
        observations: buffers.observations,
        final_observations: buffers.final_observations,
        rewards: buffers.rewards,
        terminated: buffers.terminated,
        truncated: buffers.truncated,
        outcomes: buffers.outcomes,
    }
}

/// `groups` groups at a time, which are `environments` environments, with their share of the buffers.
fn pieces<'a>(
    all: &'a mut [Box<dyn Group>],
    groups: usize,
    environments: usize,
    buffers: GroupBuffers<'a>,
) -> impl Iterator<Item = (&'a mut [Box<dyn Group>], GroupBuffers<'a>)> {
    let GroupBuffers { actions, observations, final_observations, rewards, terminated, truncated, outcomes } = buffers;
    all.chunks_mut(groups)
        .zip(actions.chunks(environments * ACTION_LEN))
        .zip(observations.chunks_mut(environments * OBSERVATION_LEN))
        .zip(final_observations.chunks_mut(environments * OBSERVATION_LEN))
        .zip(rewards.chunks_mut(environments))
        .zip(terminated.chunks_mut(environments))
        .zip(truncated.chunks_mut(environments))
        .zip(outcomes.chunks_mut(environments))
        .map(
            |(
                ((((((piece, actions), observations), final_observations), rewards), terminated), truncated),
                outcomes,
            )| {
                let share = GroupBuffers {
                    actions,
                    observations,
                    final_observations,
                    rewards,
                    terminated,
                    truncated,
                    outcomes,
                };
                (piece, share)
            },
        )
}

fn step_groups(groups: &mut [Box<dyn Group>], width: usize, autoreset: Autoreset, buffers: GroupBuffers<'_>) {
    for (group, share) in pieces(groups, 1, width, buffers) {
        group[0].step(autoreset, share);
    }
}
