//! Seeded randomization: parameter changes and pushes at random times and by random amounts.
//!
//! An [`Event`] samples numbers for one term, a parameter or a push. Draws are keyed, not sequenced: each depends only
//! on the environment's seed, the episode, the event's id and its count in the episode. Parameters are recomputed from
//! the nominal robot and the current draws whenever a draw changes.

mod check;
mod effects;
mod event;
mod plan;
mod robots;
mod sampler;
mod sets;
mod setup;
mod value;

pub(super) use check::Tests;
pub(super) use effects::check_effects;
pub(super) use event::TASK_ID;
pub(super) use event::invalid_event;
pub use event::{Direction, Distribution, Event, Operation, When};
pub(super) use plan::Plan;
pub(super) use robots::{Randomized, Saved};
pub(super) use sampler::{Source, key_of};
pub use sets::{event_sets, events_from_toml, events_to_toml, load_events};
pub(super) use setup::{Setup, Stages};
pub use value::Value;
