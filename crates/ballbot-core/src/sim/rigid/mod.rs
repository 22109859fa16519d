//! The robot as rigid bodies in rapier3d: ball, body and three omniwheels, in unilateral contact.
//!
//! Body and wheels are one multibody with revolute joints. The ball rests on the floor by an ordinary contact. Rapier's
//! friction being isotropic, an omniwheel's contact with the ball is two constraint rows of their own (`rows`): the
//! normal force, which only pushes, and the friction along the drive direction, bounded by μ N.

mod bodies;
mod convert;
mod motion;
mod rows;
mod stepping;
mod wheel_contact;
mod world;

pub use motion::RigidMotion;
