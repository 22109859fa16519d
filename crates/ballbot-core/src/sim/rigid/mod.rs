//! The robot as rigid bodies in rapier3d: ball, body and three omniwheels, in unilateral contact.
//!
//! Body and wheels are one multibody with revolute joints. The ball rests on the floor by a rapier contact. Contact
//! friction of rapier is isotropic, that of an omniwheel is not. The contact of an omniwheel with the ball is therefore
//! two rows of a joint (`rows`): the unilateral normal force, and the friction along the drive direction within ±μ N.

mod bodies;
mod convert;
mod motion;
mod rows;
mod stepping;
mod wheel_contact;
mod world;

pub use motion::RigidMotion;
