//! Simulation of the robot as bodies in contact.

pub(crate) mod contact;
mod friction;
mod outline;
pub mod rigid;

pub use contact::ContactMotion;
pub use rigid::RigidMotion;
