//! Environments: tasks on robots, many of them stepped together.
//!
//! A control step is: action → actuator → model steps → sensor → task. It is written once (`env`), for one
//! robot of any model and for eight robots of the contact model in lanes.

mod accessors;
mod autoreset;
#[allow(clippy::module_inception, reason = "the batch itself")]
mod batch;
mod buffers;
mod closed_loop;
mod config;
mod derivatives;
mod drawn_law;
mod env;
mod episodes;
mod events;
mod external_motion;
mod history;
mod integral;
mod levels;
mod networks;
mod observation_source;
mod pieces;
mod policy;
mod registry;
mod reset;
mod scalars;
mod single;
mod stage;

pub use autoreset::Autoreset;
pub use batch::Batch;
pub use buffers::{Outcome, StepBuffers, StepResults};
pub use closed_loop::Under;
pub use config::{BalanceConfig, EnvConfig, SCALAR_OPTIONS};
pub use drawn_law::Design;
pub use episodes::Episode;
pub use events::{
    Direction, Distribution, Event, Operation, Value, When, event_sets, events_from_toml, events_to_toml, load_events,
};
pub use external_motion::Outside;
pub use history::History;
pub use integral::Integral;
pub use levels::Levels;
pub use networks::{Layer, Networks};
pub use observation_source::Observation;
pub use policy::policy_controller;
pub use registry::{TaskConfig, TaskKind, register_task, task_kind, task_kinds};
pub use reset::ResetRequest;
pub use scalars::{ScalarKind, ScalarOption};
pub use single::Environment;
pub use stage::{BatchStage, CustomStage, ROBOT_ROW_LEN, RobotRows, StageLayout, StageResults};
