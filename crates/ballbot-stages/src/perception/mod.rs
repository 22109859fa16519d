//! Perception of the ground: instruments that observe the terrain that models roll on.
//!
//! A reading is a part of a robot's observation, after the rows of its task.

mod channel;
pub mod clock;
mod depth;
mod instrument;
mod kinds;
mod lidar;
mod rays;
mod scan;
mod view;

pub use channel::{Channel, Reading};
pub use depth::DepthOptions;
pub use instrument::{AnyInstrument, Instrument, Random, Range, Reads, Sample};
pub use kinds::{InstrumentKind, Instruments, MakeInstrument, instrument_kind, instrument_kinds, register_instrument};
pub use lidar::LidarOptions;
pub use scan::ScanOptions;
pub use view::View;

use ballbot_base::error::{Error, Result};
use ballbot_base::params::Params;
use ballbot_base::terrain::Terrain;
use channel::Source;

/// The instruments of all robots of a batch.
#[derive(Debug)]
pub struct Perception {
    channels: Vec<Channel>,
}

/// The readings of one robot.
#[derive(Clone, Debug)]
pub struct Seen {
    /// A reading of each instrument.
    pub readings: Vec<Reading>,
    source: Source,
}

impl Perception {
    /// Instruments that are read every `control_dt`, s. Numbers of observations are scaled if `scaled`; otherwise they are
    /// in their units. `None` without instruments.
    ///
    /// # Errors
    /// The errors of [`AnyInstrument::channel`]; [`Error::UnknownName`] for an instrument that is not registered.
    pub fn new(instruments: &Instruments, params: &Params, control_dt: f64, scaled: bool) -> Result<Option<Self>> {
        let names: Vec<_> = instrument_kinds().iter().map(|kind| kind.name).collect();
        let channel = |instrument: &dyn AnyInstrument| {
            let place = names.iter().position(|name| *name == instrument.name());
            let index = place.ok_or_else(|| Error::unknown("instrument", instrument.name(), &names))?;
            instrument.channel(index as u32, params, control_dt, scaled)
        };
        let channels = instruments.iter().map(channel).collect::<Result<Vec<_>>>()?;
        Ok((!channels.is_empty()).then_some(Self { channels }))
    }

    /// The instruments, in the order of their numbers in an observation.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// Count of numbers that it adds to an observation.
    pub fn width(&self) -> usize {
        self.channels.iter().map(Channel::width).sum()
    }

    /// Approximate memory for each robot, bytes.
    pub fn bytes(&self) -> usize {
        self.channels.iter().map(Channel::bytes).sum()
    }

    /// The readings of a robot before its first episode: zeros.
    pub fn nothing(&self) -> Seen {
        Seen { readings: self.channels.iter().map(Channel::nothing).collect(), source: Source::default() }
    }

    /// Begins an episode under the key of a robot's random numbers, and reads for the first time.
    pub fn begin(&self, seen: &mut Seen, key: [u32; 2], episode: u32, view: &View, terrain: Option<&Terrain>) {
        self.restore(seen, key, episode);
        for (channel, reading) in self.channels.iter().zip(&mut seen.readings) {
            channel.begin(reading, view, terrain, &seen.source);
        }
    }

    /// Continues an episode whose readings were restored.
    pub fn restore(&self, seen: &mut Seen, key: [u32; 2], episode: u32) {
        seen.source = Source { key, episode };
        for (channel, reading) in self.channels.iter().zip(&mut seen.readings) {
            channel.fix(reading, &seen.source);
        }
    }

    /// Takes the samples and readings that are due at a step of the episode.
    pub fn step(&self, seen: &mut Seen, step: u64, view: &dyn Fn() -> View, terrain: Option<&Terrain>) {
        for (channel, reading) in self.channels.iter().zip(&mut seen.readings) {
            channel.step(reading, step, view, terrain, &seen.source);
        }
    }

    /// Writes the readings in the form of an observation.
    pub fn write(&self, seen: &Seen, mut out: &mut [f32]) {
        for (channel, reading) in self.channels.iter().zip(&seen.readings) {
            let (part, rest) = out.split_at_mut(channel.width());
            channel.write(reading, part);
            out = rest;
        }
    }
}
