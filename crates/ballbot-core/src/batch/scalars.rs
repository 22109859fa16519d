//! Options of every environment that are single numbers.

use ballbot_base::error::{Error, Result, check};
use ballbot_base::fields::Limit;

/// Largest whole number, 2⁵³.
const LARGEST: f64 = 9_007_199_254_740_992.0;

/// Type of a [`ScalarOption`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScalarKind {
    /// A number.
    Real,
    /// A number, or none: it then follows from other options.
    OptionalReal,
    /// A whole number.
    Whole,
    /// 0 or 1.
    Flag,
}

/// Description of an option that is a single number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScalarOption {
    /// Its name.
    pub name: &'static str,
    /// Its type.
    pub kind: ScalarKind,
    /// Its unit; empty for a pure number.
    pub unit: &'static str,
    /// Limit of its values.
    pub limit: Limit,
    /// Its description, as the lines of its doc comment.
    pub doc: &'static str,
}

impl ScalarOption {
    /// Checks a value.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] naming the value and the limit.
    pub(super) fn check(&self, value: f64) -> Result<()> {
        if self.limit.contains(value) {
            return Ok(());
        }
        let limit = format!("{} {}", self.limit, self.unit).trim_end().into();
        Err(Error::OutOfRange { name: self.name.into(), value, limit })
    }
}

/// The value of a scalar option.
pub(super) trait Scalar: Copy {
    /// Its type.
    const KIND: ScalarKind;

    /// The value as a number; `None` if it follows from other options.
    fn number(self) -> Option<f64>;

    /// The value of a number; `name` is for messages.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a number that is not of the type.
    fn of(name: &str, number: f64) -> Result<Self>;
}

impl Scalar for f64 {
    const KIND: ScalarKind = ScalarKind::Real;

    fn number(self) -> Option<f64> {
        Some(self)
    }

    fn of(_: &str, number: f64) -> Result<Self> {
        Ok(number)
    }
}

impl Scalar for Option<f64> {
    const KIND: ScalarKind = ScalarKind::OptionalReal;

    fn number(self) -> Option<f64> {
        self
    }

    fn of(_: &str, number: f64) -> Result<Self> {
        Ok(Some(number))
    }
}

impl Scalar for usize {
    const KIND: ScalarKind = ScalarKind::Whole;

    fn number(self) -> Option<f64> {
        Some(self as f64)
    }

    fn of(name: &str, number: f64) -> Result<Self> {
        let whole = |n: f64| (0.0..=LARGEST).contains(&n) && n.fract() == 0.0;
        check(name, number, "a whole number from 0 to 2^53", whole).map(|n| n as Self)
    }
}

impl Scalar for bool {
    const KIND: ScalarKind = ScalarKind::Flag;

    fn number(self) -> Option<f64> {
        Some(f64::from(u8::from(self)))
    }

    fn of(name: &str, number: f64) -> Result<Self> {
        check(name, number, "0 or 1 (False or True)", |n| n == 0.0 || n == 1.0).map(|n| n != 0.0)
    }
}

/// Defines [`super::EnvConfig`]: first the options that are single numbers, each with its documentation, type, default,
/// unit and limit on one line, then the others with their defaults.
macro_rules! env_config {
    (
        $(#[$meta:meta])*
        pub struct EnvConfig<T> {
            scalars {
                $($(#[doc = $doc:literal])+ pub $name:ident: $type:ty = $default:expr, $unit:literal, $limit:expr;)*
            }
            $($(#[$other_meta:meta])* pub $other:ident: $other_type:ty = $other_default:expr;)*
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq)]
        pub struct EnvConfig<T> {
            $($(#[doc = $doc])+ pub $name: $type,)*
            $($(#[$other_meta])* pub $other: $other_type,)*
        }

        impl<T: Task> Default for EnvConfig<T> {
            fn default() -> Self {
                Self { $($name: $default,)* $($other: $other_default,)* }
            }
        }

        /// Options of every environment that are single numbers.
        pub const SCALAR_OPTIONS: &[ScalarOption] = &[$(ScalarOption {
            name: stringify!($name),
            kind: <$type as Scalar>::KIND,
            unit: $unit,
            limit: $limit,
            doc: concat!($($doc),+),
        },)*];

        impl<T: Task> EnvConfig<T> {
            /// Values in use of [`SCALAR_OPTIONS`].
            pub(super) fn scalars(&self) -> [f64; SCALAR_OPTIONS.len()] {
                [$(self.$name.number().unwrap_or_else(|| self.derived(stringify!($name))),)*]
            }

            /// Sets one of [`SCALAR_OPTIONS`]; `None` for another name.
            pub(super) fn set_scalar(&mut self, name: &str, value: f64) -> Option<Result<()>> {
                Some(match name {
                    $(stringify!($name) => Scalar::of(name, value).map(|value| self.$name = value),)*
                    _ => return None,
                })
            }
        }
    };
}

pub(super) use env_config;
