//! Which tiles of a terrain episodes begin on.

use crate::error::{Error, Result};
use crate::terrain::Tiles;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Levels of the tiles that episodes begin on; the column is drawn evenly.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Levels {
    /// Any, drawn evenly.
    #[default]
    Any,
    /// This one.
    One(usize),
    /// Each environment has its own: from the easiest up after episodes that did what was asked, down after others. After the
    /// hardest they are drawn evenly.
    Curriculum,
}

/// Shares of what an episode was asked for from which on the next one is harder, and below which it is easier.
const HARDER: f64 = 0.8;
const EASIER: f64 = 0.4;

impl Levels {
    /// The same as a number of a snapshot.
    pub(super) fn number(self) -> f64 {
        match self {
            Self::Any => -1.0,
            Self::Curriculum => -2.0,
            Self::One(level) => level as f64,
        }
    }

    /// Checks that a terrain has them.
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

    /// Column and level of the tile of an episode; `reached` is that of the environment.
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

    /// The level after an episode that did a share of what was asked of it; that above the hardest stands for any.
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
