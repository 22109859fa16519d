//! Simulation of the robot as bodies in contact.

pub(crate) mod contact;
mod friction;
mod collision_shape;
pub mod rigid;

pub(crate) use collision_shape::CollisionShape;
pub use contact::ContactMotion;
pub use rigid::RigidMotion;
