//! The contact conditions of one step.

use crate::delassus::Delassus;
use crate::friction::{Friction, JointFriction};
use crate::types::PerRow;
use ballbot_base::lanes::Lane;

/// The conditions of one step.
#[derive(Clone, Copy)]
pub struct Conditions<'a, L, V> {
    pub delassus: &'a Delassus<L, V>,
    /// Residuals without impulses.
    pub residuals: &'a PerRow<L>,
    pub friction: &'a Friction<L>,
    pub joint_friction: &'a JointFriction<L>,
    /// Impulse of a wheel's static load in a step, N·s.
    pub static_impulse: L,
}

/// The impulses of a step.
pub struct Solution<L: Lane> {
    pub impulses: PerRow<L>,
    /// Robots whose modes did not repeat, so that all modes were tried.
    pub searched: L::Mask,
    /// Robots without modes that meet the conditions; their impulses are within the bounds of friction.
    pub unsolved: L::Mask,
}
