//! Controllers by name: the controllers of this crate and controllers registered by other crates.

use crate::controllers::CONTROLLERS;
use crate::{Controller, Law, LimitOptions, Plant, SETPOINT_PARTS, Sampled};
use ballbot_base::error::{Error, Result};
use ballbot_base::fields::{Fields, OptionDescription, describe_options};
use ballbot_base::params::Params;
use ballbot_base::registry::{Named, Registry};

/// A controller known by its name.
#[derive(Clone, Debug)]
pub struct ControllerKind {
    /// Its name, as in `lqr`.
    pub name: &'static str,
    /// Description in one sentence.
    pub summary: &'static str,
    /// Its name in figures, in few letters.
    pub label: &'static str,
    /// The sampling time of its design, s; `None` for a controller designed for any sampling time.
    pub control_dt: Option<f64>,
    /// The parts of a setpoint that it follows.
    pub parts: &'static [&'static str],
    /// Default limits of its torques.
    pub limits: LimitOptions,
    /// Its options.
    pub options: fn() -> Vec<OptionDescription>,
    /// Constructor.
    pub make: MakeController,
}

impl Named for ControllerKind {
    fn name(&self) -> &'static str {
        self.name
    }
}

/// Makes a controller for `params`, sampled every `control_dt` seconds, with limited torques, from options by name.
pub type MakeController = fn(
    params: &Params,
    control_dt: f64,
    limits: &LimitOptions,
    options: &[(&str, &[f64])],
) -> Result<Box<dyn Controller>>;

/// A struct of fields with some values changed; [`crate::Sampled::new`] checks their limits.
///
/// # Errors
/// As [`Fields::set`].
pub fn fields_with<F: Fields>(options: &[(&str, &[f64])]) -> Result<F> {
    let mut fields = F::unset();
    options.iter().try_for_each(|(name, values)| fields.set(name, values))?;
    Ok(fields)
}

/// A law with a name: its entry in lists, on command lines and in figures, and its design.
pub trait NamedLaw: Law + Sized + 'static {
    /// Its name, as in `lqr`.
    const NAME: &'static str;

    /// Description in one sentence.
    const SUMMARY: &'static str;

    /// Its name in figures, in few letters.
    const LABEL: &'static str;

    /// The sampling time of its design, s; `None` for a law designed for any sampling time.
    const CONTROL_DT: Option<f64> = None;

    /// Default limits of its torques.
    const LIMITS: LimitOptions = LimitOptions::TRACTION;

    /// Its options.
    type Options: Fields + Default;

    /// All of these, for [`register_controller`].
    const KIND: ControllerKind = ControllerKind {
        name: Self::NAME,
        summary: Self::SUMMARY,
        label: Self::LABEL,
        control_dt: Self::CONTROL_DT,
        parts: Self::PARTS,
        limits: Self::LIMITS,
        options: describe_options::<Self::Options>,
        make: |params, control_dt, limits, options| {
            Ok(Box::new(Self::with_options(params, control_dt, &fields_with(options)?, limits)?))
        },
    };

    /// The law for a robot.
    ///
    /// # Errors
    /// A design without solution.
    fn design(plant: &Plant<'_>, options: &Self::Options) -> Result<Self>;

    /// The controller for `params`, sampled every `control_dt` seconds, with limited torques.
    ///
    /// # Errors
    /// As [`Sampled::new`] and [`NamedLaw::design`].
    fn with_options(
        params: &Params,
        control_dt: f64,
        options: &Self::Options,
        limits: &LimitOptions,
    ) -> Result<Sampled<Self>> {
        Sampled::new(params, control_dt, options, limits, Self::design)
    }

    /// [`NamedLaw::with_options`] with the default options and limits.
    ///
    /// # Errors
    /// As [`NamedLaw::with_options`].
    fn with_defaults(params: &Params, control_dt: f64) -> Result<Sampled<Self>> {
        Self::with_options(params, control_dt, &Self::Options::default(), &Self::LIMITS)
    }
}

static REGISTRY: Registry<ControllerKind> = Registry::new("controller", CONTROLLERS);

/// Registers a controller by its name, like the controllers of this crate; [`Law`] has an example.
///
/// # Errors
/// [`Error::Inconsistent`] if its name is taken; [`Error::UnknownName`] if it follows a part that a setpoint does not
/// have.
pub fn register_controller(kind: ControllerKind) -> Result<()> {
    if let Some(part) = kind.parts.iter().find(|part| !SETPOINT_PARTS.contains(part)) {
        return Err(Error::unknown("part of a setpoint", part, &SETPOINT_PARTS));
    }
    REGISTRY.register(kind)
}

/// All controllers.
pub fn controller_kinds() -> Vec<ControllerKind> {
    REGISTRY.all()
}

/// A controller by its name.
///
/// # Errors
/// [`Error::UnknownName`] if it does not exist.
pub fn controller_kind(name: &str) -> Result<ControllerKind> {
    REGISTRY.find(name)
}
