//! An instrument with its clock: pending samples, and the current reading.

use super::clock::Clock;
use super::instrument::{AnyInstrument, Instrument, Random, Reads, Sample};
use super::view::View;
use ballbot_base::error::Result;
use ballbot_base::terrain::Terrain;
use serde::{Deserialize, Serialize};

/// Source of the random numbers of a robot's episode.
#[derive(Clone, Copy, Debug, Default)]
pub struct Source {
    pub key: [u32; 2],
    pub episode: u32,
}

/// Memory of an instrument for a robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// The last reading.
    pub values: Vec<f32>,
    /// Views of the pending samples.
    views: Vec<View>,
    #[serde(skip)]
    constants: [f64; 3],
}

impl Reading {
    /// Whether a saved reading may replace this reading.
    pub fn fits(&self, saved: &Self) -> bool {
        self.values.len() == saved.values.len()
            && self.views.len() == saved.views.len()
            && saved.values.iter().all(|value| value.is_finite())
            && saved.views.iter().all(View::is_finite)
    }
}

/// An instrument of all robots of a batch.
#[derive(Debug)]
pub struct Channel {
    name: &'static str,
    /// Its place among all instruments.
    index: u32,
    reader: Box<dyn Reads>,
    clock: Clock,
    shape: Vec<usize>,
    /// Factor from a reading to the numbers of an observation.
    gain: f32,
}

impl Channel {
    pub(super) fn new<I: Instrument>(instrument: &I, index: u32, control_dt: f64, scaled: bool) -> Result<Self> {
        let [rate, latency] = instrument.timing();
        Ok(Self {
            name: I::NAME,
            index,
            reader: instrument.reader(),
            clock: Clock::new(rate, latency, control_dt).map_err(|error| error.of_option(I::NAME))?,
            shape: instrument.shape(),
            gain: instrument.range().gain(scaled),
        })
    }

    /// Name of the instrument.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Count of numbers of a reading.
    pub fn width(&self) -> usize {
        self.shape.iter().product()
    }

    /// Lengths of a reading, the slowest index first.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    pub(super) fn bytes(&self) -> usize {
        self.width() * size_of::<f32>() + self.clock.slots() * size_of::<View>()
    }

    pub(super) fn nothing(&self) -> Reading {
        Reading {
            values: vec![0.0; self.width()],
            views: vec![View::default(); self.clock.slots()],
            constants: [0.0; 3],
        }
    }

    fn random(&self, source: &Source, sample: u64) -> Random {
        Random::new(source.key, source.episode, sample, self.index)
    }

    /// Samples the constants of the episode.
    pub(super) fn fix(&self, reading: &mut Reading, source: &Source) {
        reading.constants = self.reader.constants(&self.random(source, 0));
    }

    /// Reads at the start of an episode.
    pub(super) fn begin(&self, reading: &mut Reading, view: &View, terrain: Option<&Terrain>, source: &Source) {
        reading.views.fill(*view);
        let Reading { values, constants, .. } = reading;
        let random = &self.random(source, 0);
        self.reader.read(&Sample { view, terrain, constants, random, is_first: true }, values);
    }

    /// Takes the samples and readings that are due.
    pub(super) fn step(
        &self,
        reading: &mut Reading,
        step: u64,
        view: &dyn Fn() -> View,
        terrain: Option<&Terrain>,
        source: &Source,
    ) {
        if let Some(sample) = self.clock.taken(step) {
            reading.views[self.clock.slot(sample)] = view();
        }
        if let Some(sample) = self.clock.read(step) {
            let Reading { values, views, constants } = reading;
            let view = &views[self.clock.slot(sample)];
            // A diverged state ends its episode; no view is taken from it.
            if view.is_finite() {
                let random = &self.random(source, sample);
                self.reader.read(&Sample { view, terrain, constants, random, is_first: false }, values);
            }
        }
    }

    pub(super) fn write(&self, reading: &Reading, out: &mut [f32]) {
        for (out, value) in out.iter_mut().zip(&reading.values) {
            *out = value * self.gain;
        }
    }
}
