//! Numbers of eight robots in memory.

use serde::{Deserialize, Serialize};

/// How many robots lie side by side.
pub const EIGHT: usize = 8;

/// One number of each of eight robots, as a vector register takes them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[repr(C, align(64))]
pub struct Eight(pub [f64; EIGHT]);
