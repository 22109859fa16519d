//! The robot as rigid bodies in rapier3d: ball, body and three omniwheels, in unilateral contact.
//!
//! Body and wheels are one multibody with revolute joints. The ball rests on the floor and carries the wheels by ordinary
//! contacts; rapier's friction being isotropic, those wheel contacts transmit the normal force alone, and the friction
//! along each wheel's drive direction is a constraint row of its own (`drive`).

mod bodies;
mod convert;
mod drive;
mod motion;
mod world;

pub use motion::RigidMotion;
