//! What moves robots: simulators, models, and their derivatives.

pub(crate) mod ballbot;
pub(crate) mod crowd;
pub(crate) mod jacobian;
pub(crate) mod models;
