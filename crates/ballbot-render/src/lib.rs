//! Ray-cast pictures of a robot, without GPU, window or display.
//!
//! The picture of a state is the same to the last bit on any number of threads.

#![warn(clippy::print_stdout, clippy::print_stderr, clippy::unwrap_used)]

mod camera;
mod color;
mod default_visuals;
mod forces;
#[cfg(feature = "urdf")]
mod from_urdf;
pub mod mesh;
mod renderer;
mod scene;
mod shading;
mod shape;

pub use camera::Camera;
pub use color::{Color, Paint, srgb};
pub use forces::force_arrows;
pub use renderer::{Arrow, Picture, Renderer};
pub use scene::{Label, Link, Part, Scene};
pub use shape::Shape;
