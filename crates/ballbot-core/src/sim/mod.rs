//! Simulation of the robot as bodies in contact.

pub(crate) mod contact;
mod friction;
mod outline;
#[cfg(feature = "rigid")]
pub mod rigid;

pub use contact::ContactMotion;
#[cfg(feature = "rigid")]
pub use rigid::RigidMotion;
