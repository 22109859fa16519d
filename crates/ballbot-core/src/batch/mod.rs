//! Environments: tasks on robots, many of them stepped together.
//!
//! A control step is: action → actuator → model steps → sensor → task. It is written once (`environments`), for one
//! robot of any model and for eight robots of the contact model in lanes.

mod autoreset;
#[allow(clippy::module_inception, reason = "the batch itself")]
mod batch;
mod beginning;
mod buffers;
mod chunk;
mod closed_loop;
mod commanding;
mod commands;
mod config;
mod drawn;
mod environment;
mod environments;
mod events;
mod kinds;
mod ledger;
mod levels;
mod measured;
mod observation;
mod observations;
mod observing;
mod outside;
mod perceiving;
mod pieces;
mod renewing;
mod resetting;
mod results;
mod robots;
mod saving;
mod sight;
mod standing;
mod task_step;

pub use autoreset::Autoreset;
pub use batch::Batch;
pub use buffers::{Outcome, StepBuffers};
pub use closed_loop::Under;
pub use config::{BalanceConfig, EnvConfig};
pub use environment::Environment;
pub use events::{
    Direction, Distribution, Event, Operation, Value, When, event_sets, events_from_toml, events_to_toml, load_events,
};
pub use kinds::{TaskConfig, TaskKind, register_task, task_kind, task_kinds};
pub use levels::Levels;
pub use observation::Observation;
pub use outside::Outside;
pub use resetting::ResetRequest;
pub use results::StepResults;
