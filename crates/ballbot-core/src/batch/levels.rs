//! The terrain tiles that episodes begin on.

use ballbot_base::error::{Error, Result};
use ballbot_base::terrain::Tiles;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Levels of the tiles that episodes begin on; the column is sampled uniformly.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Levels {
    /// Any level, sampled uniformly.
    #[default]
    Any,
    /// This level.
    One(usize),
    /// Each environment has its own level: it starts at the easiest, goes up after episodes that did what was
    /// commanded, and down after others. After the hardest level, levels are sampled uniformly.
    Curriculum,
}

/// Completed fractions of the command: from the first on the next episode is harder, below the second it is easier.
const HARDER: f64 = 0.8;
const EASIER: f64 = 0.4;

impl Levels {
    /// The level as a number of a snapshot.
    pub(super) fn number(self) -> f64 {
        match self {
            Self::Any => -1.0,
            Self::Curriculum => -2.0,
            Self::One(level) => level as f64,
        }
    }

    /// Checks that a terrain has these levels.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for a level that its tiles do not have, and for levels of a terrain without tiles.
    pub(super) fn check(self, tiles: Option<&Tiles>) -> Result<()> {
        match (self, tiles) {
            (Self::Any, _) | (Self::Curriculum, Some(_)) => Ok(()),
            (Self::One(level), Some(tiles)) if level < tiles.levels => Ok(()),
            (Self::One(level), Some(tiles)) => Err(Error::Inconsistent(format!(
                "level = {level}, but the terrain has levels from 0 to {}",
                tiles.levels - 1
            ))),
            (Self::One(_) | Self::Curriculum, None) => Err(Error::Inconsistent(
                "a level is chosen, but the terrain has none: one of the kind 'levels' does".into(),
            )),
        }
    }

    /// Column and level of the tile of an episode; `reached` is the level of the environment.
    #[doc(hidden)]
    pub fn draw(self, tiles: &Tiles, reached: &mut u32, rng: &mut ChaCha8Rng) -> [usize; 2] {
        let column = rng.random_range(0..tiles.columns);
        let any = rng.random_range(0..tiles.levels);
        let level = match self {
            Self::Any => any,
            Self::One(level) => level,
            Self::Curriculum if *reached as usize >= tiles.levels => any,
            Self::Curriculum => *reached as usize,
        };
        if self == Self::Curriculum {
            *reached = level as u32;
        }
        [column, level]
    }

    /// The level after an episode that did a fraction of what was commanded; the level above the hardest means any
    /// level.
    #[doc(hidden)]
    pub fn after(reached: u32, share: f64, fell: bool) -> u32 {
        if fell || share < EASIER {
            reached.saturating_sub(1)
        } else if share >= HARDER {
            reached + 1
        } else {
            reached
        }
    }
}
