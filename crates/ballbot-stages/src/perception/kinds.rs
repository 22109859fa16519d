//! Instruments by name, and the instruments of a robot.

use super::instrument::{AnyInstrument, Instrument, from_options};
use super::{DepthOptions, LidarOptions, ScanOptions};
use ballbot_base::error::Result;
use ballbot_base::fields::{OptionDescription, describe_options};
use ballbot_base::registry::{Named, Registry};
use std::sync::Arc;

/// An instrument known by its name.
#[derive(Clone, Copy, Debug)]
pub struct InstrumentKind {
    /// [`ballbot_base::options::OptionTable::NAME`].
    pub name: &'static str,
    /// [`Instrument::TITLE`].
    pub title: &'static str,
    /// [`Instrument::ABOUT`].
    pub about: &'static str,
    /// Its options.
    pub options: fn() -> Vec<OptionDescription>,
    /// Constructor.
    pub make: MakeInstrument,
}

/// Makes an instrument from options by name; the others have their defaults.
pub type MakeInstrument = fn(options: &[(&str, &[f64])]) -> Result<Arc<dyn AnyInstrument>>;

impl InstrumentKind {
    const fn of<I: Instrument>() -> Self {
        Self {
            name: I::NAME,
            title: I::TITLE,
            about: I::ABOUT,
            options: describe_options::<I>,
            make: from_options::<I>,
        }
    }
}

impl Named for InstrumentKind {
    fn name(&self) -> &'static str {
        self.name
    }
}

/// The instruments of this crate, in the order of their numbers in an observation.
static INSTRUMENTS: [InstrumentKind; 3] =
    [InstrumentKind::of::<ScanOptions>(), InstrumentKind::of::<DepthOptions>(), InstrumentKind::of::<LidarOptions>()];

static REGISTRY: Registry<InstrumentKind> = Registry::new("instrument", &INSTRUMENTS);

/// Registers an instrument by its name, like the instruments of this crate. Its random numbers follow from its place
/// among the registered instruments.
///
/// # Errors
/// [`ballbot_base::Error::Inconsistent`] if its name is taken.
pub fn register_instrument<I: Instrument>() -> Result<()> {
    REGISTRY.register(InstrumentKind::of::<I>())
}

/// All instruments.
pub fn instrument_kinds() -> Vec<InstrumentKind> {
    REGISTRY.all()
}

/// An instrument by its name.
///
/// # Errors
/// [`ballbot_base::Error::UnknownName`] if it does not exist.
pub fn instrument_kind(name: &str) -> Result<InstrumentKind> {
    REGISTRY.find(name)
}

/// The instruments of a robot, at most one of each kind.
#[derive(Clone, Debug, Default)]
pub struct Instruments(Vec<Arc<dyn AnyInstrument>>);

impl Instruments {
    /// The same with one more instrument, in place of an instrument of its kind.
    #[must_use]
    pub fn with(mut self, instrument: impl Instrument) -> Self {
        self.set(Arc::new(instrument));
        self
    }

    /// Adds an instrument, in place of an instrument of its kind.
    pub fn set(&mut self, instrument: Arc<dyn AnyInstrument>) {
        self.remove(instrument.name());
        self.0.push(instrument);
        let kinds = instrument_kinds();
        self.0.sort_by_key(|one| kinds.iter().position(|kind| kind.name == one.name()));
    }

    /// Removes the instrument of a name, if there is one.
    pub fn remove(&mut self, name: &str) {
        self.0.retain(|known| known.name() != name);
    }

    /// The instrument of a name, if there is one.
    pub fn get(&self, name: &str) -> Option<&dyn AnyInstrument> {
        self.iter().find(|known| known.name() == name)
    }

    /// All, in the order of their numbers in an observation.
    pub fn iter(&self) -> impl Iterator<Item = &dyn AnyInstrument> {
        self.0.iter().map(|instrument| &**instrument)
    }

    /// All numbers of their options.
    pub fn numbers(&self) -> Vec<f64> {
        self.iter().flat_map(AnyInstrument::options).flat_map(|(_, values)| values).copied().collect()
    }
}

impl PartialEq for Instruments {
    fn eq(&self, other: &Self) -> bool {
        self.iter().map(AnyInstrument::name).eq(other.iter().map(AnyInstrument::name))
            && self.numbers() == other.numbers()
    }
}
