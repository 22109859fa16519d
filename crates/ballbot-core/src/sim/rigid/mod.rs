//! The robot as rigid bodies in rapier3d: ball, body and three omniwheels, in unilateral contact.
//!
//! Body and wheels are one multibody with revolute joints, and the ball rests on the floor by a rapier contact. Contact
//! friction of rapier is isotropic, that of an omniwheel is not. The forces between the wheels and the ball are therefore
//! solved here (`rows`, `solve`) on the mass matrix of the multibody, exactly and together with what the floor will do,
//! and applied to rapier's bodies. Every traction is within the Coulomb limit of the load of the same step.
//!
//! It is the default of [`crate::ModelKind`], because it assumes least: the wheels are links with mass, and a general
//! engine moves the bodies and finds what touches the floor. `contact` moves the same way, a ball that has been driven by
//! slipping wheels for 0.2 s at 1 kHz 0.04 % of its way apart, at a thirtieth of the time.

mod bodies;
mod bot;
mod convert;
mod floor;
mod losses;
mod motion;
mod rows;
mod solve;
mod stepping;
mod world;

pub use motion::RigidMotion;
