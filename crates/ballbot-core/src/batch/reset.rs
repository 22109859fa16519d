//! Resets of a batch.

use super::batch::Batch;
use ballbot_base::error::{Error, Result};
use ballbot_base::interrupt::Watch;
use ballbot_base::state::State;

/// Request for [`Batch::reset_with`]; each slice has one element per environment.
#[derive(Clone, Copy, Debug, Default)]
pub struct ResetRequest<'a> {
    /// Which environments to reset; `None` resets all.
    pub mask: Option<&'a [bool]>,
    /// Seeds for the random numbers; `None` leaves them unchanged.
    pub seeds: Option<&'a [Option<u64>]>,
    /// Initial states; `None` samples one.
    pub starts: Option<&'a [Option<State>]>,
}

impl Batch {
    /// Seeds the environments, one number each, from their next reset on; `None` leaves an environment unchanged.
    ///
    /// # Errors
    /// [`Error::Length`] unless there is one entry per environment.
    pub fn seed(&mut self, seeds: &[Option<u64>]) -> Result<()> {
        self.expect_len("seeds", seeds.len(), self.len())?;
        for ((chunk, i), seed) in self.places().zip(seeds) {
            if let Some(seed) = seed {
                self.chunks[chunk].seed(i, *seed);
            }
        }
        Ok(())
    }

    /// Resets the environments whose `mask` is set (all without a mask) and writes the observations of all.
    ///
    /// # Errors
    /// [`Error::Length`] for buffers of the wrong length.
    pub fn reset(&mut self, mask: Option<&[bool]>, observations: &mut [f32]) -> Result<()> {
        self.reset_with(&ResetRequest { mask, ..ResetRequest::default() }, observations)
    }

    /// Seeds environments, resets them from given or random states, and writes the observations of all. An environment
    /// that starts from a given state does not sample a state.
    ///
    /// # Errors
    /// [`Error::Length`] for any wrong length, [`Error::Inconsistent`] for a start of an environment that the mask
    /// excludes, and errors of [`crate::Ballbot::reset`] for a start. Nothing has changed in these cases.
    /// [`Error::Interrupted`] in [`crate::stoppable`]; all environments must be reset then.
    pub fn reset_with(&mut self, request: &ResetRequest<'_>, observations: &mut [f32]) -> Result<()> {
        let n = self.len();
        self.expect_len("observations", observations.len(), n * self.observation_len())?;
        let masked = |i: usize| request.mask.is_none_or(|mask| mask[i]);
        let start = |i: usize| request.starts.and_then(|starts| starts[i].as_ref());
        if let Some(mask) = request.mask {
            self.expect_len("reset mask", mask.len(), n)?;
        }
        if let Some(starts) = request.starts {
            self.expect_len("starts", starts.len(), n)?;
        }
        let mut watch = Watch::new();
        for index in 0..n {
            watch.check()?;
            if let Some(start) = start(index) {
                if !masked(index) {
                    return Err(Error::Inconsistent(format!(
                        "environment {index} has a start, but the mask does not select it"
                    )));
                }
                let seed = request.seeds.and_then(|seeds| *seeds.get(index)?);
                self.chunks[index / self.width].accepts(index % self.width, start, seed)?;
            }
        }
        if let Some(seeds) = request.seeds {
            self.seed(seeds)?;
        }
        let len = self.observation_len();
        for (index, (chunk, i)) in self.places().enumerate() {
            let row = &mut observations[index * len..][..len];
            if let Err(stop) = watch.check() {
                self.interrupted = true;
                return Err(stop);
            }
            if masked(index) {
                self.chunks[chunk].reset(i, start(index), row)?;
            } else {
                self.chunks[chunk].observation(i, row);
            }
        }
        if (0..n).all(masked) {
            self.interrupted = false;
        }
        self.begin_staged(observations, masked)
    }
}
