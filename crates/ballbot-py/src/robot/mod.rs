//! What a robot is, its state and its ground.

pub(crate) mod actuators;
pub(crate) mod params;
pub(crate) mod payloads;
pub(crate) mod sensors;
pub(crate) mod state;
pub(crate) mod terrain;
