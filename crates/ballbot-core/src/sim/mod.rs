//! Simulation of the robot as bodies in contact.

pub mod rigid;

pub use rigid::RigidMotion;
