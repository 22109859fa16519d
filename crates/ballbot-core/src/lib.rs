//! Physics, controllers and batched environments for a ballbot: a robot that balances on a ball driven by three
//! omniwheels.
//!
//! Layers, each depending only on earlier layers: parameters, state, kinematics and lanes; actuators and sensors
//! ([`actuator`], [`sensor`]); models, from closed form ([`models`]) to rigid bodies with contacts ([`sim`]);
//! controllers ([`control`]) and simulation-based controllers ([`planning`]); tasks ([`task`]); environments
//! ([`batch`]).
//!
//! Without `--release`, Cargo builds dependencies without optimization, and this crate is many times slower. To debug
//! your code with an optimized crate, add to the workspace's `Cargo.toml`:
//!
//! ```toml
//! [profile.dev.package."*"]
//! opt-level = 3
//! ```
//!
//! [`Batch`](batch::Batch) steps many robots at once, [`task::Task`] and [`control::Law`] are for custom tasks and
//! controllers; each has an example. Signatures contain types of [`nalgebra`] and [`rand_chacha`], so both crates are
//! re-exported.
//!
//! Cargo features, all on by default: `rigid` (the model `rigid`, by rapier3d), `urdf` (robots from URDFs), `render`
//! (pictures).
//!
//! ```
//! use ballbot_core::{Ballbot, ModelKind, Params, State, control::{Controller, Lqr, Setpoint}};
//!
//! let params = Params::paper();
//! let mut robot = Ballbot::new(&params, ModelKind::Rigid, 0.001)?;
//! robot.reset(&State::tilted(&params, [0.0, 0.05].into(), 0.0))?;
//! let mut lqr = Lqr::new(&params, 0.005)?;
//! for _ in 0..600 {
//!     let torques = lqr.wheel_torques(&robot.state(), &Setpoint::default());
//!     robot.step(&torques, 5)?;
//! }
//! assert!(robot.state().tilt() < 0.01);
//! # Ok::<(), ballbot_core::Error>(())
//! ```

#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]

pub mod actuator;
pub mod batch;
mod constants;
pub mod control;
mod control_steps;
mod energy;
mod error;
pub mod fields;
mod files;
#[doc(hidden)]
pub mod internals;
mod interrupt;
pub mod kinematics;
mod lane_state;
pub mod lanes;
mod memory;
mod model;
pub mod models;
mod names;
mod params;
pub mod perception;
pub mod planning;
#[cfg(feature = "render")]
pub mod render;
mod robot;
pub mod sensor;
mod setpoint;
pub mod sim;
mod snapshot;
mod state;
pub mod task;
pub mod terrain;
mod thread_pool;
#[cfg(feature = "urdf")]
pub mod urdf;

pub use {nalgebra, rand_chacha};

pub use energy::mechanical_energy;
pub use error::{Error, MAX_MAGNITUDE, Result, bounded as check_bounded, finite as check_finite, one_of};
pub use interrupt::stoppable;
pub use lane_state::{LaneRobot, LaneState, StateCells};
pub use memory::{require_memory, try_reserve, try_zeros};
pub use model::Model;
pub use params::{PAPER_BALL_VISCOUS_FRICTION, Params};
pub use robot::{Ballbot, ModelKind};
pub use state::{Contacts, State, attitude, rolling_rate, unit_quaternion, wxyz};
