//! What tasks observe robots by.

use crate::error::{Error, Result};
use crate::names;
use std::str::FromStr;

/// What the rows of an observation are computed from, and what controllers take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Observation {
    /// The true state.
    #[default]
    GroundTruth,
    /// The state that follows from the readings of the sensors.
    Sensors,
}

impl Observation {
    /// All kinds.
    pub const ALL: [Self; 2] = [Self::GroundTruth, Self::Sensors];

    /// The name by which it is chosen.
    pub fn name(self) -> &'static str {
        match self {
            Self::GroundTruth => "ground_truth",
            Self::Sensors => "sensors",
        }
    }
}

impl FromStr for Observation {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        names::find("observation", name, Self::ALL, Self::name)
    }
}
