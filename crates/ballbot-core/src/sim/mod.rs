//! Simulation of the robot as bodies in contact.

pub(crate) mod contact;
pub mod rigid;
mod shape;

pub use contact::ContactMotion;
pub use rigid::RigidMotion;
