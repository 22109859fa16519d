//! The readings of the instruments of a chunk.

use crate::perception::{Perception, Seen};
use std::sync::Arc;

/// Instruments with the readings of each robot.
pub(super) struct Sight {
    pub perception: Arc<Perception>,
    pub seen: Vec<Seen>,
}

impl Sight {
    pub fn new(perception: &Arc<Perception>, robots: usize) -> Self {
        Self { perception: Arc::clone(perception), seen: vec![perception.nothing(); robots] }
    }
}
