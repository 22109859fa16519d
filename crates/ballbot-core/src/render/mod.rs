//! Pictures of a robot, without GPU, window or display: rays cast at its shapes.
//!
//! The same state gives the same picture to the last bit, on any number of threads.

mod camera;
#[cfg(feature = "urdf")]
mod description;
mod forces;
mod look;
mod paint;
mod picture;
mod scene;
mod shading;
mod shape;

pub use camera::Camera;
pub use forces::force_arrows;
pub use paint::{Colour, Paint, srgb};
pub use picture::{Arrow, Picture, Renderer};
pub use scene::{Label, Link, Part, Scene};
pub use shape::Shape;
