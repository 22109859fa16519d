//! Observation source of tasks.

use ballbot_base::error::{Error, Result};
use ballbot_base::names;
use std::str::FromStr;

/// Source of the rows of an observation, and of the states that controllers get.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Observation {
    /// The true state.
    #[default]
    GroundTruth,
    /// The state estimated from the readings of the sensors.
    Sensors,
}

impl Observation {
    /// All kinds.
    pub const ALL: [Self; 2] = [Self::GroundTruth, Self::Sensors];

    /// Name in options.
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
