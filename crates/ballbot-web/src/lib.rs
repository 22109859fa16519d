//! Scenes of robots for a page in a browser: the physics, controllers and robots of `ballbot-core`.
//!
//! [`Scene`] is the simulation, `interface` its functions for WebAssembly, a plain C interface: numbers and one buffer of
//! text, so that the page needs no generated code.

#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]

mod catalog;
mod interface;
mod scene;
mod settings;
mod target;

pub use catalog::catalog;
pub use interface::*;
pub use scene::{ROW, Scene, row_width};
