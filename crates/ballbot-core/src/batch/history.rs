//! Which of the last observations are given together.

use super::scalars::Scalar;
use ballbot_base::error::{Error, Result, check};

/// Largest number of observations that are given together, and largest age of an observation, control steps.
const LARGEST: usize = 1000;

/// Which of the last observations are given together, oldest first. The first observation of an episode replaces earlier
/// observations.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum History {
    /// The last observations, this many.
    Last(usize),
    /// Observations of these ages, control steps: ascending, the first 0.
    Ages(Vec<usize>),
}

impl Default for History {
    fn default() -> Self {
        Self::Last(1)
    }
}

impl History {
    /// The last observations, this many.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] unless it is a whole number.
    pub fn last(count: f64) -> Result<Self> {
        usize::of("history", count).map(Self::Last)
    }

    /// Observations of these ages, control steps; a number of observations if the ages have no gaps.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] unless they are whole numbers.
    pub fn of_ages(ages: &[f64]) -> Result<Self> {
        let whole = |(i, age): (usize, &f64)| usize::of(&format!("history[{i}]"), *age);
        let ages: Vec<_> = ages.iter().enumerate().map(whole).collect::<Result<_>>()?;
        let has_gaps = ages.is_empty() || ages.iter().copied().ne(0..ages.len());
        Ok(if has_gaps { Self::Ages(ages) } else { Self::Last(ages.len()) })
    }

    /// The ages of the observations, ascending.
    pub fn ages(&self) -> Vec<usize> {
        match self {
            Self::Last(n) => (0..*n).collect(),
            Self::Ages(ages) => ages.clone(),
        }
    }

    /// How many observations are given together.
    pub fn count(&self) -> usize {
        match self {
            Self::Last(n) => *n,
            Self::Ages(ages) => ages.len(),
        }
    }

    /// # Errors
    /// [`Error::OutOfRange`] for no observations or too many; [`Error::Inconsistent`] for ages that do not ascend from 0,
    /// or are too large.
    pub(super) fn check(&self) -> Result<()> {
        let ages = match self {
            Self::Last(n) => {
                let limit = format_args!(">= 1 and <= {LARGEST}");
                return check("history", *n as f64, limit, |n| (1.0..=LARGEST as f64).contains(&n)).map(|_| ());
            }
            Self::Ages(ages) => ages,
        };
        let invalid = |reason: &str| Err(Error::Inconsistent(format!("history = {ages:?}: {reason}")));
        if ages.first() != Some(&0) {
            return invalid("the first age must be 0, the newest observation");
        }
        if let Some(pair) = ages.windows(2).find(|pair| pair[0] >= pair[1]) {
            return invalid(&format!("ages must ascend, but {} follows {}", pair[1], pair[0]));
        }
        match ages.last() {
            Some(oldest) if *oldest > LARGEST => {
                invalid(&format!("the age {oldest} must be at most {LARGEST} control steps"))
            }
            _ => Ok(()),
        }
    }

    /// The ages as numbers of a snapshot, with their count.
    pub(super) fn numbers(&self) -> impl Iterator<Item = f64> {
        std::iter::once(self.count()).chain(self.ages()).map(|number| number as f64)
    }
}
