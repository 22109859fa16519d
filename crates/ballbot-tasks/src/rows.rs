//! Rows of an observation and terms of a reward: values with their descriptions.

use ballbot_base::error::{Error, Result};
use ballbot_base::lanes::Lane;

/// What a row grows with from robot to robot, in addition to the lean that starts a motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Growth {
    /// The scale of its unit, lengths and velocities also the acceleration of the ball per lean; pure numbers are alike on
    /// all robots.
    Unit,
    /// The speed of a wheel, which scales otherwise than the rates of the body.
    WheelSpeed,
    /// The lean alone: a component of a direction.
    Lean,
}

/// Description of one row of an observation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// The quantity, with its frame.
    pub name: &'static str,
    /// Its unit; empty for a pure number.
    pub unit: &'static str,
    /// Bound of its magnitude, at which it saturates.
    pub bound: f32,
    /// Its typical magnitude when the task is performed well; the scaled observation is in multiples of it.
    pub typical: f64,
    /// What it grows with from robot to robot.
    pub growth: Growth,
}

impl Row {
    /// A row from its parts.
    #[inline(always)]
    pub const fn new(name: &'static str, unit: &'static str, bound: f32, typical: f64) -> Self {
        Self { name, unit, bound, typical, growth: Growth::Unit }
    }

    /// The speed of a wheel from its parts, rad/s.
    #[inline(always)]
    pub const fn of_wheel(name: &'static str, bound: f32, typical: f64) -> Self {
        Self { growth: Growth::WheelSpeed, ..Self::new(name, "rad/s", bound, typical) }
    }

    /// A component of the vertical from its parts.
    #[inline(always)]
    pub const fn of_vertical(name: &'static str, bound: f32, typical: f64) -> Self {
        Self { growth: Growth::Lean, ..Self::new(name, "", bound, typical) }
    }
}

/// Receives the rows of an observation, in order.
pub trait Rows<L> {
    /// The next row.
    fn row(&mut self, row: Row, value: L);
}

/// Description of one term of a reward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Term {
    /// Its name.
    pub name: &'static str,
    /// Its default scale.
    pub scale: f64,
    /// Whether it is subtracted.
    pub cost: bool,
    /// Its formula in words, with its cap.
    pub formula: &'static str,
}

impl Term {
    /// A term that is added.
    #[inline(always)]
    pub const fn reward(name: &'static str, scale: f64, formula: &'static str) -> Self {
        Self { name, scale, cost: false, formula }
    }

    /// A term that is subtracted.
    #[inline(always)]
    pub const fn cost(name: &'static str, scale: f64, formula: &'static str) -> Self {
        Self { name, scale, cost: true, formula }
    }
}

/// Receives the terms of a reward, in order, unscaled.
pub trait Terms<L> {
    /// The next term.
    fn term(&mut self, term: Term, value: L);
}

/// Scale of each term of a reward; costs are subtracted.
#[derive(Clone, Debug, PartialEq)]
pub struct RewardScales(Vec<(&'static str, f64)>);

impl RewardScales {
    /// The default scales of `terms`.
    pub fn of(terms: &[Term]) -> Self {
        Self(terms.iter().map(|term| (term.name, term.scale)).collect())
    }

    /// Names of the terms, in order.
    pub fn names(&self) -> impl Iterator<Item = &'static str> {
        self.0.iter().map(|(name, _)| *name)
    }

    /// The scales, in order.
    pub fn values(&self) -> impl Iterator<Item = f64> {
        self.0.iter().map(|(_, scale)| *scale)
    }

    /// Changes a scale.
    ///
    /// # Errors
    /// [`Error::UnknownName`] if there is no such term.
    pub fn set(&mut self, name: &str, scale: f64) -> Result<()> {
        match self.0.iter_mut().find(|(known, _)| *known == name) {
            Some((_, old)) => {
                *old = scale;
                Ok(())
            }
            None => Err(Error::unknown("reward term", name, &self.names().collect::<Vec<_>>())),
        }
    }

    /// Checks that all scales are within ±1e6.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] naming the first scale out of range.
    pub fn validate(&self) -> Result<()> {
        for (name, scale) in &self.0 {
            ballbot_base::error::check(format_args!("reward.{name}"), *scale, "within ±1e6", |s| s.abs() <= 1e6)?;
        }
        Ok(())
    }
}

/// Bound of every row of a scaled observation.
pub const SCALED_BOUND: f32 = 10.0;

/// Scaling of rows to magnitudes near one: the value at rest upright is subtracted, the result divided by the typical
/// magnitude.
#[derive(Clone, Debug, PartialEq)]
pub struct RowScaling {
    /// Value of each row at rest upright.
    pub rest: Vec<f64>,
    /// 1 / typical magnitude of each row.
    pub gain: Vec<f64>,
}

/// Writes rows into cells: saturated, scaled if requested. NaN is replaced by 0; a NaN state terminates the episode, and
/// learners never receive NaN.
pub struct WriteRows<'a, L: Lane> {
    /// Where the rows go.
    pub cells: &'a mut [L::Cell],
    /// Scaling of the rows, if they are scaled.
    pub scaling: Option<&'a RowScaling>,
    /// Index of the next row.
    pub next: usize,
}

impl<L: Lane> WriteRows<'_, L> {
    /// Writes one row; `scaling` is the value at rest and the gain.
    #[inline(always)]
    pub fn write(row: Row, value: L, scaling: Option<(f64, f64)>, cell: &mut L::Cell) {
        Self::scaled(row, value, scaling).store(cell);
    }

    /// The value of a row as [`WriteRows::write`] writes it.
    #[inline(always)]
    pub fn scaled(row: Row, value: L, scaling: Option<(f64, f64)>) -> L {
        let zero = value.zero();
        let bound = value.splat(f64::from(row.bound));
        let number = value.le(value);
        let mut value = L::select(number, value.min(bound).max(-bound), zero);
        if let Some((rest, gain)) = scaling {
            let bound = value.splat(f64::from(SCALED_BOUND));
            value = ((value - rest) * gain).min(bound).max(-bound);
        }
        value
    }
}

impl<L: Lane> Rows<L> for WriteRows<'_, L> {
    #[inline(always)]
    fn row(&mut self, row: Row, value: L) {
        // Not by `map`, whose closure may not be inlined.
        let scaling = match self.scaling {
            Some(scaling) => Some((scaling.rest[self.next], scaling.gain[self.next])),
            None => None,
        };
        Self::write(row, value, scaling, &mut self.cells[self.next]);
        self.next += 1;
    }
}

/// Writes scaled terms into cells and sums them up; the terms of a robot that is not `sound` are zero.
pub struct WriteTerms<'a, L: Lane> {
    /// Where the terms go.
    pub cells: &'a mut [L::Cell],
    /// Scale of each term.
    pub scales: &'a [f64],
    /// Robots whose terms count.
    pub sound: L::Mask,
    /// Sum of the terms so far.
    pub sum: L,
    /// Index of the next term.
    pub next: usize,
}

impl<L: Lane> Terms<L> for WriteTerms<'_, L> {
    #[inline(always)]
    fn term(&mut self, term: Term, value: L) {
        let scale = self.scales[self.next];
        let scaled = L::select(self.sound, value * if term.cost { -scale } else { scale }, self.sum.zero());
        self.sum += scaled;
        scaled.store(&mut self.cells[self.next]);
        self.next += 1;
    }
}
