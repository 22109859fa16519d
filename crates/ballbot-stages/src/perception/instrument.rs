//! What defines an instrument: its options, and how it reads.

use super::channel::Channel;
use super::view::View;
use ballbot_base::error::{Result, check};
use ballbot_base::lanes::{Draws, Scalar};
use ballbot_base::options::OptionTable;
use ballbot_base::params::Params;
use ballbot_base::terrain::Terrain;
use std::fmt::Debug;
use std::sync::Arc;

/// Maximum count of numbers in a reading.
const MOST_NUMBERS: f64 = 65536.0;

/// Blocks of random numbers of each instrument.
const BLOCKS: u32 = 3 << 20;

/// An instrument, defined by the struct of its options. [`super::register_instrument`] makes it known by name.
pub trait Instrument: OptionTable + Debug + Send + Sync + 'static {
    /// Its title in the documentation.
    const TITLE: &'static str;

    /// Its description in the documentation, Markdown: what a reading is, its shape, and the unit of scaled observations.
    const ABOUT: &'static str;

    /// The option with the lengths of a reading, the fastest index first, and its values.
    fn lengths(&self) -> (&'static str, &[f64]);

    /// Rate, Hz, and latency, s.
    fn timing(&self) -> [f64; 2];

    /// Range of the numbers of a reading.
    fn range(&self) -> Range;

    /// Checks options against the robot.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] naming the value and the limit.
    fn check_robot(&self, _: &Params) -> Result<()> {
        Ok(())
    }

    /// What takes its readings.
    fn reader(&self) -> Box<dyn Reads>;
}

/// Range of the numbers of a reading, in their unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Least number.
    pub low: f64,
    /// Largest number.
    pub high: f64,
    /// Typical magnitude; a scaled observation is in multiples of it.
    pub typical: f64,
}

impl Range {
    /// Factor from a reading to an observation.
    pub(super) fn gain(&self, scaled: bool) -> f32 {
        if scaled { (1.0 / self.typical) as f32 } else { 1.0 }
    }

    /// Least and largest number of an observation, including readings rounded to f32.
    fn bounds(&self, scaled: bool) -> [f32; 2] {
        let observed = |number: f64| number as f32 * self.gain(scaled);
        let exact = |number: f64| if scaled { (number / self.typical) as f32 } else { number as f32 };
        [observed(self.low).min(exact(self.low)), observed(self.high).max(exact(self.high))]
    }
}

/// Takes readings.
pub trait Reads: Debug + Send + Sync {
    /// Constants of an episode.
    fn constants(&self, _: &Random) -> [f64; 3] {
        [0.0; 3]
    }

    /// Writes a reading; `out` holds the reading before it. Called for each robot and sample; it must not allocate.
    fn read(&self, sample: &Sample, out: &mut [f32]);
}

/// What a reading is taken from.
#[derive(Clone, Copy)]
pub struct Sample<'a> {
    /// Pose of the robot.
    pub view: &'a View,
    /// The ground; `None` for level ground.
    pub terrain: Option<&'a Terrain>,
    /// [`Reads::constants`] of the episode.
    pub constants: &'a [f64; 3],
    /// Random numbers of the sample.
    pub random: &'a Random,
    /// Whether it is the first of an episode: the reading before it is not of this episode.
    pub is_first: bool,
}

/// Random numbers of a sample of one instrument, independent of other samples and instruments.
#[derive(Clone, Copy)]
pub struct Random {
    draws: Draws<f64>,
    first_block: u32,
}

impl Random {
    /// For the instrument at `index` of all instruments.
    pub(super) fn new(key: [u32; 2], episode: u32, sample: u64, index: u32) -> Self {
        let draws = Draws::new(Scalar, key.map(f64::from), f64::from(episode), sample as f64);
        Self { draws, first_block: index * BLOCKS }
    }

    /// Four independent standard normal numbers; equal for equal `block`, below 3 · 2^20.
    #[inline]
    pub fn normals(&self, block: u32) -> [f64; 4] {
        self.draws.normals(self.first_block + block)
    }

    /// Four independent numbers in [0, 1), from other blocks than [`Random::normals`].
    #[inline]
    pub fn units(&self, block: u32) -> [f64; 4] {
        self.draws.units(self.first_block + block)
    }
}

/// An instrument whose type is not known.
pub trait AnyInstrument: Debug + Send + Sync {
    /// [`OptionTable::NAME`].
    fn name(&self) -> &'static str;

    /// All options with their values.
    fn options(&self) -> Vec<(&'static str, &[f64])>;

    /// Lengths of a reading, the slowest index first.
    fn shape(&self) -> Vec<usize>;

    /// Least and largest number of its part of an observation.
    fn bounds(&self, scaled: bool) -> [f32; 2];

    /// Checks all options.
    ///
    /// # Errors
    /// [`ballbot_base::Error::OutOfRange`] naming the value and the limit.
    fn check(&self) -> Result<()>;

    /// The instrument of all robots of a batch; `index` is its place among all instruments.
    ///
    /// # Errors
    /// The errors of [`AnyInstrument::check`]; [`ballbot_base::Error::OutOfRange`] for options that do not fit the
    /// robot, or a latency that is not a whole number of at most 100 control steps.
    fn channel(&self, index: u32, params: &Params, control_dt: f64, scaled: bool) -> Result<Channel>;
}

impl<I: Instrument> AnyInstrument for I {
    fn name(&self) -> &'static str {
        I::NAME
    }

    fn options(&self) -> Vec<(&'static str, &[f64])> {
        I::FIELDS.iter().enumerate().map(|(index, field)| (field.name, self.values(index))).collect()
    }

    fn shape(&self) -> Vec<usize> {
        self.lengths().1.iter().rev().map(|length| *length as usize).collect()
    }

    fn bounds(&self, scaled: bool) -> [f32; 2] {
        self.range().bounds(scaled)
    }

    fn check(&self) -> Result<()> {
        self.validate()?;
        check_lengths(self)
    }

    fn channel(&self, index: u32, params: &Params, control_dt: f64, scaled: bool) -> Result<Channel> {
        self.check()?;
        self.check_robot(params)?;
        Channel::new(self, index, control_dt, scaled)
    }
}

/// An instrument from named options, the others at their defaults.
///
/// # Errors
/// The errors of [`OptionTable::from_fields`] and [`AnyInstrument::check`].
pub(super) fn from_options<I: Instrument>(options: &[(&str, &[f64])]) -> Result<Arc<dyn AnyInstrument>> {
    let instrument = I::from_fields(options.iter().copied())?;
    check_lengths(&instrument)?;
    Ok(Arc::new(instrument))
}

/// Checks that a reading has whole lengths and not too many numbers.
fn check_lengths<I: Instrument>(instrument: &I) -> Result<()> {
    let (name, lengths) = instrument.lengths();
    let count: f64 = lengths.iter().product();
    let whole = lengths
        .iter()
        .try_for_each(|length| check(name, *length, "a whole number", |number| number.fract() == 0.0).map(drop));
    let limit = format_args!("at most {MOST_NUMBERS}");
    whole
        .and_then(|()| check(format_args!("product of {name}"), count, limit, |n| n <= MOST_NUMBERS).map(drop))
        .map_err(|error| error.of_option(I::NAME))
}
