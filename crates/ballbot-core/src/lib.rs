//! Physics, controllers and batched environments for a ballbot: a robot that balances on a ball driven by three
//! omniwheels.
//!
//! Layers, each depending only on earlier layers: parameters, state, kinematics and lanes; models in closed form
//! ([`models`]); actuators and sensors ([`actuator`], [`sensor`]); rigid bodies with contacts ([`sim`]); controllers
//! ([`control`]); tasks ([`task`]). Each is a crate, which this crate re-exports. Its own code is what joins
//! them: one robot of any model ([`Ballbot`]), several that touch each other (`Crowd`), environments ([`batch`]) and simulation-based controllers ([`planning`]).
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
//!     robot.step(torques, 5)?;
//! }
//! assert!(robot.state().tilt() < 0.01);
//! # Ok::<(), ballbot_core::Error>(())
//! ```

#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]

pub mod batch;
#[cfg(feature = "rigid")]
mod crowd;
pub mod planning;
mod robot;

pub use {nalgebra, rand_chacha};

#[doc(inline)]
pub use ballbot_base::{
    Contacts, Deflection, Error, Force, LaneRobot, LaneState, MAX_MAGNITUDE, Model, PAPER_BALL_VISCOUS_FRICTION,
    PAYLOADS, Params, Result, State, WHEELS, Wheels, attitude, check_bounded, check_finite, fields, kinematics, lanes,
    mechanical_energy, one_of, options, require_memory, rolling_rate, stoppable, terrain, try_reserve, try_zeros,
    unit_quaternion, wxyz,
};
#[doc(inline)]
pub use ballbot_control as control;
#[doc(inline)]
pub use ballbot_gradients as gradients;
#[doc(inline)]
pub use ballbot_models as models;
#[cfg(feature = "render")]
#[doc(inline)]
pub use ballbot_render as render;
#[doc(inline)]
pub use ballbot_stages::{actuator, perception, sensor};
#[doc(inline)]
pub use ballbot_tasks as task;
#[cfg(feature = "urdf")]
#[doc(inline)]
pub use ballbot_urdf as urdf;
#[cfg(feature = "rigid")]
pub use crowd::Crowd;
pub use robot::{Ballbot, ModelKind};

/// The motions of rigid bodies in contact.
pub mod sim {
    #[doc(inline)]
    pub use ballbot_contact::ContactMotion;
    #[cfg(feature = "rigid")]
    #[doc(inline)]
    pub use ballbot_rigid::{Between, RigidMotion};
}
