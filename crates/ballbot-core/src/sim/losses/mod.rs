//! The contact conditions of a robot with losses: spinning and rolling friction of the ball on the floor, and friction of
//! the rollers of its wheels.
//!
//! `contact` and `rigid` build the rows of such a robot, each in its own coordinates, and solve them here; robots without
//! losses have the solvers of these models. The rows are those of the nine contacts and three joints, and six more: the
//! ball's rates, and the speeds along the free directions of the wheels. Derivation: `docs/derivations.md`, "Losses".

mod elimination;
mod law;
mod problem;
mod rows;
mod solution;
#[cfg(test)]
mod tests;

pub use law::Bounds;
pub use problem::Problem;
pub use rows::{DRIVE, FLOOR, JOINT, NORMAL, Present, ROLLER, ROWS, TORQUE};
