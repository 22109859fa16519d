//! Stages between the actions of a policy and the motion of a robot, and between the motion and what a policy observes.

#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]

pub mod actuator;
pub mod perception;
pub mod sensor;
