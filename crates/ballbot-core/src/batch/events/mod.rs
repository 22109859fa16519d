//! Seeded randomization: what changes of a robot, and what hits it, at random times and by random amounts.
//!
//! An [`Event`] draws numbers for one term, a parameter or a push. Draws are keyed, not sequenced: each depends on the
//! environment's seed, the episode, the event's id and its count in the episode, and on nothing else. Parameters are
//! computed anew from the nominal robot and the present draws whenever one of them changes.

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
pub(super) use event::refused;
pub use event::{Direction, Distribution, Event, Operation, When};
pub(super) use plan::Plan;
pub(super) use robots::{Randomized, Saved};
pub(super) use sampler::{Source, key_of};
pub use sets::{event_sets, events_from_toml, events_to_toml, load_events};
pub(super) use setup::{Setup, Stages};
pub use value::Value;
