//! Simulation of the robot as bodies in contact.

mod collision_shape;
// It is public only for tests, except for the motion.
#[allow(missing_docs)]
pub(crate) mod contact;
mod friction;
#[cfg(feature = "rigid")]
pub mod rigid;

pub(crate) use collision_shape::CollisionShape;
pub use contact::ContactMotion;
#[cfg(feature = "rigid")]
pub use rigid::RigidMotion;
