//! The error type of the crate: every message names the offending value and the violated limit.

use std::borrow::Cow;
use std::fmt;
use std::path::PathBuf;

/// Possible errors, from a parameter out of range to a diverged simulation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A number is outside its valid range.
    #[error("{name} = {} is out of range: it must be {limit}", Readable(*value))]
    OutOfRange {
        /// Name of the number, with its index for an element of an array.
        name: String,
        /// The given number.
        value: f64,
        /// The range, in words.
        limit: String,
    },
    /// An array has the wrong number of elements.
    #[error("{name} has {found} values, expected {expected}")]
    Length {
        /// Name of the array.
        name: String,
        /// Number of given values.
        found: usize,
        /// Number of expected values.
        expected: usize,
    },
    /// A name is not in the set of known names.
    #[error("unknown {kind} '{name}': expected one of {known}")]
    UnknownName {
        /// Kind of the name, as in "model".
        kind: Cow<'static, str>,
        /// The given name.
        name: String,
        /// The accepted names.
        known: String,
    },
    /// Physical parameters without a default were not given.
    #[error("{} missing", listed(names))]
    MissingParameters {
        /// The parameters, at least one.
        names: Vec<&'static str>,
    },
    /// Values that are individually valid contradict each other.
    #[error("{0}")]
    Inconsistent(String),
    /// A URDF is malformed, or describes something that is not a ballbot.
    #[error("{file}: {reason}")]
    Urdf {
        /// The file, or a label such as "bot URDF" for text.
        file: String,
        /// Why it was rejected.
        reason: String,
    },
    /// A file cannot be read.
    #[error("cannot read {path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// Text in a structured format (a preset, a saved simulation) cannot be decoded.
    #[error("cannot decode {what}: {reason}")]
    Decode {
        /// The data being decoded.
        what: String,
        /// Why it failed.
        reason: String,
    },
    /// The simulation left the range of meaningful numbers.
    #[error("the simulation diverged at t = {time} s: {reason}")]
    Diverged {
        /// Simulated time, s.
        time: f64,
        /// The quantity and the bound that it violated.
        reason: String,
    },
    /// A part of the crate was not compiled in.
    #[error("{what} needs the cargo feature '{feature}' of ballbot-core, which is not enabled")]
    MissingFeature {
        /// The requested part.
        what: String,
        /// The feature that contains it.
        feature: &'static str,
    },
    /// There is not enough memory.
    #[error("{what} needs {need} of memory: {limit}")]
    Memory {
        /// Purpose of the memory.
        what: String,
        /// Required amount, in words.
        need: String,
        /// Available amount, in words.
        limit: String,
    },
    /// The caller of [`crate::stoppable`] stopped its work.
    #[error("interrupted")]
    Interrupted,
    /// The algebraic Riccati equation has no stabilizing solution for the given weights.
    #[error("the Riccati equation was not solved: {0}")]
    Riccati(String),
}

/// Parameters with the verb that follows them.
fn listed(names: &[&str]) -> String {
    match names {
        [name] => format!("parameter {name} is"),
        _ => format!("parameters {} are", names.join(", ")),
    }
}

/// A number printed without hundreds of zeros.
struct Readable(f64);

impl fmt::Display for Readable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(value) = self;
        let long = value.is_finite() && *value != 0.0 && !(1e-7..1e16).contains(&value.abs());
        if long { write!(f, "{value:e}") } else { write!(f, "{value}") }
    }
}

impl Error {
    /// An [`Error::UnknownName`] that lists the `known` names and suggests a name similar to `name`.
    pub fn unknown(kind: impl Into<Cow<'static, str>>, name: &str, known: &[&str]) -> Self {
        Self::UnknownName { kind: kind.into(), name: name.into(), known: one_of(name, known) }
    }

    /// The error for an option of a table: the table's name precedes the option's, or is the kind of an unknown name.
    pub fn of_option(self, table: &str) -> Self {
        match self {
            Self::OutOfRange { name, value, limit } => {
                Self::OutOfRange { name: format!("{table}.{name}"), value, limit }
            }
            Self::Length { name, found, expected } => Self::Length { name: format!("{table}.{name}"), found, expected },
            Self::UnknownName { name, known, .. } => {
                Self::UnknownName { kind: format!("option of {table}").into(), name, known }
            }
            other => other,
        }
    }
}

/// Jaro-Winkler similarity from which on two names are similar.
const ALIKE: f64 = 0.85;

/// The `known` names, and a suggestion if a name is similar to `name`.
pub fn one_of(name: &str, known: &[&str]) -> String {
    let listed = known.join(", ");
    // In any case of letters.
    let name = name.to_lowercase();
    let like = |known: &&str| strsim::jaro_winkler(&name, &known.to_lowercase());
    match known.iter().copied().max_by(|a, b| like(a).total_cmp(&like(b))) {
        Some(closest) if like(&closest) >= ALIKE => format!("{listed}; did you mean '{closest}'?"),
        _ => listed,
    }
}

/// The result of every fallible function of the crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Returns `value` if it is finite and `accept(value)`; otherwise [`Error::OutOfRange`] with `limit`. Nothing is formatted
/// on success: pass `format_args!`.
pub fn check(
    name: impl fmt::Display,
    value: f64,
    limit: impl fmt::Display,
    accept: impl Fn(f64) -> bool,
) -> Result<f64> {
    if value.is_finite() && accept(value) {
        return Ok(value);
    }
    Err(Error::OutOfRange { name: name.to_string(), value, limit: limit.to_string() })
}

/// Returns `value` if it is a finite number above zero.
pub fn positive(name: impl fmt::Display, value: f64) -> Result<f64> {
    check(name, value, "a finite number > 0", |v| v > 0.0)
}

/// Largest magnitude of a number of a state, a rate or a torque, in SI units: far beyond any robot. Its square times
/// any parameter does not overflow.
pub const MAX_MAGNITUDE: f64 = 1e9;

/// Returns `values` if all are finite and within ±[`MAX_MAGNITUDE`].
pub fn bounded(name: &str, values: &[f64]) -> Result<()> {
    finite(name, values)?;
    for (i, &value) in values.iter().enumerate() {
        if value.abs() > MAX_MAGNITUDE {
            let name = if values.len() == 1 { name.into() } else { format!("{name}[{i}]") };
            return Err(Error::OutOfRange { name, value, limit: format!("within ±{MAX_MAGNITUDE:e}") });
        }
    }
    Ok(())
}

/// Returns `values` if all are finite.
pub fn finite(name: &str, values: &[f64]) -> Result<()> {
    for (i, &v) in values.iter().enumerate() {
        if !v.is_finite() {
            let name = if values.len() == 1 { name.into() } else { format!("{name}[{i}]") };
            return Err(Error::OutOfRange { name, value: v, limit: "finite".into() });
        }
    }
    Ok(())
}
