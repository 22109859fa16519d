//! The robot in maximal coordinates with a contact solver of its own: what `rigid` does, specialised and in lanes.
//!
//! Ball, body and the absolute spins of three wheels move freely; nine contact rows hold them together: the normal load
//! of each wheel and of the floor, the floor's friction (a disc) and the drive friction of each wheel (an interval along
//! its drive direction). Each step evaluates the rows where the robot is, solves them for impulses by projected
//! Gauss-Seidel sweeps that start from the last step's impulses, and moves everything with the velocities that result
//! (semi-implicit Euler). A bot on the floor and a ball against the body are solved by further sweeps (`fallen`).

mod constants;
mod exchange;
mod fallen;
mod memory;
mod motion;
mod quantities;
mod rows;
mod solve;
mod step;
#[cfg(test)]
mod tests;

pub use constants::Constants;
pub use memory::Memory;
pub use motion::ContactMotion;
pub use step::{advance, advance_wide};
