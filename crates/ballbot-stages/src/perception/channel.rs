//! An instrument with its clock: pending samples, and the current reading.

use super::clock::Clock;
use super::options::Instrument;
use super::view::View;
use ballbot_base::error::Result;
use ballbot_base::lanes::{Draws, Scalar};
use ballbot_base::terrain::Terrain;
use serde::{Deserialize, Serialize};

/// A sensor that reads the ground.
pub trait Reads {
    /// Constants of an episode.
    fn constants(&self, draws: &Draws<f64>) -> [f64; 3];

    /// Reads from a view; for the `first` reading of an episode, `out` holds no older reading.
    fn read(
        &self,
        view: &View,
        terrain: Option<&Terrain>,
        constants: &[f64; 3],
        draws: &Draws<f64>,
        first: bool,
        out: &mut [f32],
    );
}

/// Source of the random numbers of a robot's episode.
#[derive(Clone, Copy, Debug)]
pub struct Source {
    pub key: [u32; 2],
    pub episode: u32,
}

impl Source {
    fn draws(&self, sample: u64) -> Draws<f64> {
        Draws::new(Scalar, self.key.map(f64::from), f64::from(self.episode), sample as f64)
    }
}

/// Memory of an instrument for a robot.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// The last reading, m.
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
#[derive(Clone, Debug)]
pub struct Channel<I> {
    instrument: I,
    clock: Clock,
    /// Rows and columns of a reading.
    shape: [usize; 2],
    /// Factor from m to the numbers of an observation.
    gain: f32,
}

impl<I: Reads> Channel<I> {
    pub fn new<O: Instrument>(options: &O, make: impl Fn(&O) -> I, gain: f32, control_dt: f64) -> Result<Self> {
        options.validate()?;
        Ok(Self { instrument: make(options), clock: options.clock(control_dt)?, shape: options.shape(), gain })
    }

    pub fn len(&self) -> usize {
        self.shape[0] * self.shape[1]
    }

    pub fn shape(&self) -> [usize; 2] {
        self.shape
    }

    pub fn bytes(&self) -> usize {
        self.len() * size_of::<f32>() + self.clock.slots() * size_of::<View>()
    }

    pub fn nothing(&self) -> Reading {
        Reading { values: vec![0.0; self.len()], views: vec![View::default(); self.clock.slots()], constants: [0.0; 3] }
    }

    /// Samples the constants of the episode.
    pub fn fix(&self, reading: &mut Reading, source: &Source) {
        reading.constants = self.instrument.constants(&source.draws(0));
    }

    /// Reads at the start of an episode.
    pub fn begin(&self, reading: &mut Reading, view: &View, terrain: Option<&Terrain>, source: &Source) {
        reading.views.fill(*view);
        let Reading { values, constants, .. } = reading;
        self.instrument.read(view, terrain, constants, &source.draws(0), true, values);
    }

    /// Takes the samples and readings that are due.
    pub fn step(
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
                self.instrument.read(view, terrain, constants, &source.draws(sample), false, values);
            }
        }
    }

    pub fn write(&self, reading: &Reading, out: &mut [f32]) {
        for (out, value) in out.iter_mut().zip(&reading.values) {
            *out = value * self.gain;
        }
    }
}
