//! The robot in maximal coordinates with a contact solver of its own: what `rigid` does, specialized and in lanes.
//!
//! Ball, body and the absolute spins of three wheels move freely; nine contact rows hold them together: the normal load
//! of each wheel and of the floor, the floor's friction (a disc) and the drive friction of each wheel (an interval along
//! its drive direction). Each step evaluates the rows where the robot is, solves them for impulses by projected
//! Gauss-Seidel sweeps that start from the last step's impulses, and moves everything with the velocities that result
//! (semi-implicit Euler). A bot on the floor and a ball against the body are solved by further sweeps (`body_contacts`).

mod body_contacts;
mod constants;
mod lanes;
mod motion;
mod phases;
mod readout;
mod rows;
mod solve;
mod state;
mod step;
#[cfg(test)]
mod tests;
mod types;

#[cfg(test)]
pub use constants::Constants;
pub use lanes::{ContactLanes, RobotsKernel};
pub use motion::ContactMotion;
#[cfg(test)]
pub use state::ContactState;
#[cfg(test)]
pub use step::{advance, advance_wide};
