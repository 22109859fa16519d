//! What happens to an environment whose episode has ended.

use ballbot_base::error::{Error, Result};
use ballbot_base::names;
use std::str::FromStr;

/// What happens to an environment whose episode has ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Autoreset {
    /// It is reset by the next step, which ignores its action and gives a reward of zero.
    #[default]
    NextStep,
    /// It is reset within the same step; the last observation of the episode is stored separately.
    SameStep,
    /// It must be reset by the caller before it is stepped again.
    Disabled,
}

impl Autoreset {
    /// All modes.
    pub const ALL: [Self; 3] = [Self::NextStep, Self::SameStep, Self::Disabled];

    /// The name by which it is chosen.
    pub fn name(self) -> &'static str {
        match self {
            Self::NextStep => "next_step",
            Self::SameStep => "same_step",
            Self::Disabled => "disabled",
        }
    }
}

impl FromStr for Autoreset {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        names::find("autoreset mode", name, Self::ALL, Self::name)
    }
}
