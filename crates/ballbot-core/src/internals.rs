//! Internals for unit tests; not part of the interface.

pub use crate::control::common_lyapunov::common_lyapunov;
pub use crate::interrupt::Watch;
pub use crate::perception::clock::Clock;

pub mod contact {
    pub use crate::sim::contact::{
        Actions, Constants, ContactState, Delassus, Footing, Friction, JointFriction, LaneConstants, Near, PerRow,
        PrincipalAxes, Start, Velocities, advance, advance_wide, free_velocities, step,
    };
}
pub mod normal {
    pub use crate::lanes::normal::{cosine_and_sine, logarithm};
}
#[cfg(feature = "render")]
pub mod mesh {
    pub use crate::render::mesh::{any, first};
}
pub mod snapshot {
    pub use crate::snapshot::{MAGIC, VERSION, decode, encode};
}
