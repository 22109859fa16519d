//! The robot in maximal coordinates with a specialized contact solver, for one robot and in lanes.
//!
//! The coordinates are the poses of ball and body and the absolute spins of three wheels. Nine contact rows couple
//! them: the normal force of each wheel and of the floor, the floor friction (in a disc) and the drive friction of each
//! wheel (in an interval along its drive direction). A step evaluates the rows, finds the impulses that meet the
//! contact conditions (`active_set`), and integrates with the new velocities (semi-implicit Euler). `step` documents
//! the algorithm. Contacts of bot and floor and of ball and body are solved by sweeps (`body_contacts`).

// The motion is the interface; the rest is public for batches and tests.
#![allow(missing_docs)]
#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]

mod active_set;
mod body_contacts;
mod constants;
mod delassus;
mod derivative;
mod encoder;
mod footing;
mod friction;
mod held_force;
mod losses;
#[warn(missing_docs)]
mod motion;
mod obstacles;
mod payload;
mod perturbed;
mod phases;
mod preload;
mod principal;
mod readout;
mod ripple;
mod rows;
mod state;
mod step;
mod sweeps;
mod types;

pub use body_contacts::Near;
pub use constants::{Constants, InLanes, LaneConstants};
pub use delassus::Delassus;
pub use derivative::{Kinds, SolvedStep};
pub use footing::Footing;
pub use friction::{Friction, JointFriction};
pub use motion::ContactMotion;
pub use perturbed::PerturbedFloor;
pub use phases::{Start, free_velocities};
pub use principal::PrincipalAxes;
pub use state::ContactState;
pub use step::{advance, advance_wide, step};
pub use types::{Actions, PerRow, Velocities};
