//! Environments: the balance task as a Markov decision process, and many of them in step.

mod balance;
mod batch;
mod block;
mod environment;
mod group;
mod judge;
mod observation;
mod reward;

pub use balance::{BalanceConfig, Termination};
pub use batch::{Autoreset, Batch, ResetRequest, StepBuffers};
pub use environment::{Environment, Outcome};
pub use observation::{OBSERVATION, OBSERVATION_LEN, ObservationRow};
pub use reward::{RewardScales, RewardTerms};

/// Number of actions: one for each wheel.
pub const ACTION_LEN: usize = 3;
