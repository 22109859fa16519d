//! What all crates of ballbot share: errors, options, lanes, parameters, state, kinematics and terrain.
//!
//! Applications use the crate `ballbot-core`, which re-exports the public part.

#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]

pub mod collision_shape;
pub mod constants;
pub mod control_steps;
pub mod energy;
pub mod error;
pub mod fields;
pub mod files;
pub mod force;
pub mod friction;
pub mod interrupt;
pub mod kinematics;
pub mod lane_state;
pub mod lanes;
pub mod memory;
pub mod model;
pub mod names;
pub mod options;
pub mod params;
pub mod payload;
pub mod perturbed_floor;
pub mod registry;
pub mod setpoint;
pub mod snapshot;
pub mod state;
pub mod terrain;
pub mod thread_pool;
pub mod wheels;

pub use energy::mechanical_energy;
pub use error::{Error, MAX_MAGNITUDE, Result, bounded as check_bounded, finite as check_finite, one_of};
pub use force::Force;
pub use interrupt::stoppable;
pub use lane_state::{LaneRobot, LaneState};
pub use memory::{require_memory, try_reserve, try_zeros};
pub use model::Model;
pub use params::{PAPER_BALL_VISCOUS_FRICTION, Params};
pub use payload::{Deflection, PAYLOADS};
pub use state::{Contacts, State, attitude, rolling_rate, unit_quaternion, wxyz};
pub use wheels::{WHEELS, Wheels};
