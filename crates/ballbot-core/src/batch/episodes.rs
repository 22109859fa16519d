//! Episodes of robots under their own policies, summed up for a search over policies.

use super::autoreset::Autoreset;
use super::batch::Batch;
use super::buffers::{Outcome, StepResults};
use super::networks::Networks;
use crate::task::ACTION_LEN;
use ballbot_base::error::{Error, Result};
use ballbot_base::interrupt::Watch;
use ballbot_base::lanes::EIGHT;
use ballbot_base::thread_pool::WorkerThreads;
use std::sync::{Mutex, PoisonError};

/// Sums over the steps of an episode.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Episode {
    /// Sum of the rewards.
    pub total: f64,
    /// Number of steps.
    pub steps: usize,
    /// Whether it was terminated.
    pub terminated: bool,
    /// Whether it reached its last step.
    pub truncated: bool,
    /// Whether it is a success if it ends here.
    pub success: bool,
}

impl Episode {
    /// Whether it is over.
    pub fn done(&self) -> bool {
        self.terminated || self.truncated
    }

    /// Adds a step, unless the episode is over.
    fn add(&mut self, outcome: &Outcome) {
        if !self.done() {
            self.total += outcome.reward;
            self.steps += 1;
            self.terminated = outcome.terminated.is_some();
            self.truncated = outcome.truncated;
            self.success = outcome.success;
        }
    }
}

impl Batch {
    /// Continues the episode of each robot under its network for at most `steps` steps, and writes the sums over them.
    ///
    /// Eight robots do all of their steps before the next eight, so that they stay in the processor's cache, until their
    /// episodes have ended. Robots whose episodes end earlier begin others, which do not count: reset all robots
    /// afterwards.
    /// ```
    /// use ballbot_core::batch::{Autoreset, BalanceConfig, Batch, Episode, Layer, Networks};
    /// use ballbot_core::task::ACTION_LEN;
    ///
    /// let mut batch = Batch::new(&BalanceConfig::default(), 16, Autoreset::SameStep, None, 0)?;
    /// let (n, inputs) = (batch.len(), batch.observation_len());
    /// batch.reset(None, &mut vec![0.0; n * inputs])?;
    /// let (weights, biases) = (vec![0.0; n * ACTION_LEN * inputs], vec![0.0; n * ACTION_LEN]);
    /// let linear = Layer { inputs, outputs: ACTION_LEN, weights: &weights, biases: &biases };
    /// let mut episodes = vec![Episode::default(); n];
    /// batch.episodes(&Networks::new(n, &[linear])?, 200, &mut episodes)?;
    /// assert!(episodes.iter().all(|episode| episode.terminated && episode.steps < 200));
    /// # Ok::<(), ballbot_core::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Batch::check_networks`]; [`Error::Length`] unless there is one element of `episodes` per robot;
    /// [`Error::Inconsistent`] where an episode is over or has not begun, and for a task with a
    /// [`BatchStage`](super::BatchStage), which is computed for all robots at once. Nothing has moved in these cases.
    /// [`Error::Interrupted`] as in [`Batch::step`].
    pub fn episodes(&mut self, networks: &Networks, steps: usize, episodes: &mut [Episode]) -> Result<()> {
        self.check_networks(networks)?;
        self.expect_len("episodes", episodes.len(), self.len())?;
        if self.staged.is_some() {
            return Err(Error::Inconsistent(format!(
                "{}: what Python adds to a task is computed for all robots at once, but episodes are run by groups of \
                 robots; step all robots instead",
                self.description.name
            )));
        }
        self.check_running()?;
        self.check_episodes()?;
        let stop = self.stop()?;
        let (width, observation) = (self.width, self.observation_len());
        let groups = self.chunks.chunks_mut(EIGHT / width).zip(episodes.chunks_mut(EIGHT)).enumerate();
        let groups = Mutex::new(groups);
        // Long enough for all threads, however few robots there are.
        WorkerThreads::new(self.threads - 1).share(|| {
            let mut watch = Watch::new();
            let mut values = networks.values();
            let mut results = StepResults::of(EIGHT, observation);
            let mut actions = [0.0; EIGHT * ACTION_LEN];
            let next = || groups.lock().unwrap_or_else(PoisonError::into_inner).next();
            while let Some((group, (chunks, episodes))) = next() {
                episodes.fill(Episode::default());
                for (i, row) in results.observations.chunks_exact_mut(observation).take(episodes.len()).enumerate() {
                    chunks[i / width].observation(i % width, row);
                }
                for _ in 0..steps {
                    if stop.look(&mut watch) {
                        return;
                    }
                    networks.act_in_group(group, &results.observations, &mut actions, &mut values);
                    let mut rest = results.buffers();
                    let mut is_running = false;
                    let of_chunks = episodes.chunks_mut(width).zip(actions.chunks_exact(width * ACTION_LEN));
                    for (chunk, (episodes, actions)) in chunks.iter_mut().zip(of_chunks) {
                        let (mut buffers, others) = rest.split(episodes.len());
                        rest = others;
                        if !episodes.iter().all(Episode::done) {
                            is_running = true;
                            let actions = &actions[..episodes.len() * ACTION_LEN];
                            chunk.step(Autoreset::SameStep, actions, buffers.reborrow());
                            episodes.iter_mut().zip(buffers.outcomes).for_each(|(sum, outcome)| sum.add(outcome));
                        }
                    }
                    if !is_running {
                        break;
                    }
                }
            }
        })?;
        self.finish(&stop)
    }

    /// Checks that there is one network per robot, on its observation.
    ///
    /// # Errors
    /// [`Error::Length`] otherwise.
    pub fn check_networks(&self, networks: &Networks) -> Result<()> {
        self.expect_len("the networks of robots", networks.len(), self.len())?;
        self.expect_len("an observation of the networks", networks.inputs(), self.observation_len())
    }
}
