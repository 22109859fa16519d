//! Numbers described in one place: name, unit, default, limit and documentation.

use crate::error::{Error, Result};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::fmt;
use std::slice;

/// An interval of numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    low: f64,
    low_included: bool,
    high: f64,
    high_included: bool,
}

impl Limit {
    /// Any finite number.
    pub const FINITE: Self =
        Self { low: f64::NEG_INFINITY, low_included: false, high: f64::INFINITY, high_included: false };
    /// Above zero.
    pub const POSITIVE: Self = Self::above(0.0);
    /// Zero or more.
    pub const NOT_NEGATIVE: Self = Self::from(0.0);

    /// At least `low`.
    pub const fn from(low: f64) -> Self {
        Self { low, low_included: true, ..Self::FINITE }
    }

    /// Above `low`.
    pub const fn above(low: f64) -> Self {
        Self { low, low_included: false, ..Self::FINITE }
    }

    /// With upper limit `high`, inclusive.
    pub const fn to(self, high: f64) -> Self {
        Self { high, high_included: true, ..self }
    }

    /// With upper limit `high`, exclusive.
    pub const fn below(self, high: f64) -> Self {
        Self { high, high_included: false, ..self }
    }

    /// Whether a number is finite and in the interval.
    pub fn contains(&self, value: f64) -> bool {
        value.is_finite()
            && (value > self.low || (self.low_included && value == self.low))
            && (value < self.high || (self.high_included && value == self.high))
    }
}

/// A number, with names for multiples of pi.
struct Named(f64);

impl fmt::Display for Named {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.0 < 0.0 { "-" } else { "" };
        match self.0 {
            v if v.abs() == PI => write!(f, "{sign}pi"),
            v if v.abs() == TAU => write!(f, "{sign}2 pi"),
            v if v.abs() == FRAC_PI_2 => write!(f, "{sign}pi/2"),
            v if v != 0.0 && !(1e-4..1e6).contains(&v.abs()) => write!(f, "{v:e}"),
            v => write!(f, "{v}"),
        }
    }
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let low = match (self.low.is_finite(), self.low_included) {
            (false, _) => None,
            (true, true) => Some(format!(">= {}", Named(self.low))),
            (true, false) => Some(format!("> {}", Named(self.low))),
        };
        let high = match (self.high.is_finite(), self.high_included) {
            (false, _) => None,
            (true, true) => Some(format!("<= {}", Named(self.high))),
            (true, false) => Some(format!("< {}", Named(self.high))),
        };
        match (low, high) {
            (None, None) => f.write_str("finite"),
            (Some(one), None) | (None, Some(one)) => f.write_str(&one),
            (Some(low), Some(high)) => write!(f, "{low} and {high}"),
        }
    }
}

/// Description of one field: a number, or an array of numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Field {
    /// Its name.
    pub name: &'static str,
    /// Its unit; empty for a pure number.
    pub unit: &'static str,
    /// Its description, as the lines of its doc comment.
    pub doc: &'static str,
    /// Number of values.
    pub len: usize,
    /// Limit of each value.
    pub limit: Limit,
    /// Whether it has no default.
    pub required: bool,
    /// Whether its default is for the robot of the paper, and follows from the size of other robots.
    pub scaled: bool,
}

impl Field {
    /// Checks its numbers against its limit.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] naming the first number outside its limit.
    pub fn check(&self, values: &[f64]) -> Result<()> {
        // Nothing is formatted unless a value is wrong: events create robots at each reset.
        for (i, &value) in values.iter().enumerate() {
            if !self.limit.contains(value) {
                let name = if self.len == 1 { self.name.to_owned() } else { format!("{}[{i}]", self.name) };
                let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
                return Err(Error::OutOfRange { name, value, limit: format!("{}{unit}", self.limit) });
            }
        }
        Ok(())
    }
}

/// A number or an array of numbers as a slice.
pub trait Numbers: Copy {
    /// Number of values.
    const LEN: usize;
    /// The value of a field without a default.
    const UNSET: Self;
    /// For reading.
    fn as_slice(&self) -> &[f64];
    /// For writing.
    fn as_mut_slice(&mut self) -> &mut [f64];
}

impl Numbers for f64 {
    const LEN: usize = 1;
    const UNSET: Self = f64::NAN;
    fn as_slice(&self) -> &[f64] {
        slice::from_ref(self)
    }
    fn as_mut_slice(&mut self) -> &mut [f64] {
        slice::from_mut(self)
    }
}

impl<const N: usize> Numbers for [f64; N] {
    const LEN: usize = N;
    const UNSET: Self = [f64::NAN; N];
    fn as_slice(&self) -> &[f64] {
        self
    }
    fn as_mut_slice(&mut self) -> &mut [f64] {
        self
    }
}

/// A struct of numbers defined by [`crate::fields!`].
pub trait Fields: Clone {
    /// Descriptions, in the order of the struct's fields.
    const FIELDS: &'static [Field];

    /// All fields at their defaults, scaled ones for the robot of the paper; NaN without a default.
    fn defaults() -> Self;

    /// All fields at their defaults, but NaN where [`Fields::fitted`] sets the default of a robot.
    fn unset() -> Self {
        let mut fields = Self::defaults();
        for (field, values) in Self::FIELDS.iter().zip(fields.slices_mut()) {
            if field.scaled {
                values.fill(f64::NAN);
            }
        }
        fields
    }

    /// The same with the defaults of a robot where fields are unset; `factor` scales a default by its unit.
    #[must_use]
    fn fitted(&self, factor: impl Fn(&str) -> f64) -> Self {
        let (mut fitted, defaults) = (self.clone(), Self::defaults());
        let values = fitted.slices_mut().zip(defaults.slices()).zip(Self::FIELDS);
        for ((values, defaults), field) in values.filter(|(_, field)| field.scaled) {
            for (value, default) in values.iter_mut().zip(defaults).filter(|(value, _)| value.is_nan()) {
                *value = default * factor(field.unit);
            }
        }
        fitted
    }

    /// Values of each field, in the order of [`Fields::FIELDS`].
    fn slices(&self) -> impl Iterator<Item = &[f64]>;

    /// Mutable values of each field, in the order of [`Fields::FIELDS`].
    fn slices_mut(&mut self) -> impl Iterator<Item = &mut [f64]>;

    /// Values of a field; `index` refers to [`Fields::FIELDS`].
    fn values(&self, index: usize) -> &[f64] {
        self.slices().nth(index).expect("an index of FIELDS")
    }

    /// Mutable values of a field.
    fn values_mut(&mut self, index: usize) -> &mut [f64] {
        self.slices_mut().nth(index).expect("an index of FIELDS")
    }

    /// Index of a field in [`Fields::FIELDS`].
    fn index_of(name: &str) -> Option<usize> {
        Self::FIELDS.iter().position(|field| field.name == name)
    }

    /// All numbers, in the order of the fields.
    fn numbers(&self) -> Vec<f64> {
        self.slices().flatten().copied().collect()
    }

    /// The inverse of [`Fields::numbers`], unchecked; `None` for a wrong number of values.
    fn from_numbers(numbers: &[f64]) -> Option<Self> {
        let mut fields = Self::defaults();
        let mut rest = numbers;
        for values in fields.slices_mut() {
            let (first, others) = rest.split_at_checked(values.len())?;
            values.copy_from_slice(first);
            rest = others;
        }
        rest.is_empty().then_some(fields)
    }

    /// Sets a field by its name.
    ///
    /// # Errors
    /// [`Error::UnknownName`], [`Error::Length`], or [`Error::OutOfRange`] for NaN. Limits are checked by
    /// [`Fields::check_limits`].
    fn set(&mut self, name: &str, values: &[f64]) -> Result<()> {
        self.set_of("option", name, values)
    }

    /// [`Fields::set`]; `kind` describes an unknown name in its error.
    ///
    /// # Errors
    /// As [`Fields::set`].
    fn set_of(&mut self, kind: &'static str, name: &str, values: &[f64]) -> Result<()> {
        let Some(index) = Self::index_of(name) else {
            let known: Vec<_> = Self::FIELDS.iter().map(|field| field.name).collect();
            return Err(Error::unknown(kind, name, &known));
        };
        let field = self.values_mut(index);
        if values.len() != field.len() {
            return Err(Error::Length { name: name.into(), found: values.len(), expected: field.len() });
        }
        field.copy_from_slice(values);
        // NaN is an unset field.
        if values.iter().any(|value| value.is_nan()) { Self::FIELDS[index].check(values) } else { Ok(()) }
    }

    /// Checks every number against the limit of its field.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] naming the first number outside its limit.
    fn check_limits(&self) -> Result<()> {
        Self::FIELDS.iter().zip(self.slices()).try_for_each(|(field, values)| field.check(values))
    }
}

/// An option: a name with its unit, default, limit and documentation.
#[derive(Clone, Debug, PartialEq)]
pub struct OptionDescription {
    /// Its name.
    pub name: &'static str,
    /// Its unit; empty for a pure number.
    pub unit: &'static str,
    /// Default values: one, or one per array element; none without a default.
    pub default: Vec<f64>,
    /// Valid range of the values, in words.
    pub limit: String,
    /// Its description.
    pub doc: String,
    /// Whether the default is for the robot of the paper, and follows from the size of other robots.
    pub scaled: bool,
}

/// The options of a struct of fields.
pub fn describe_options<F: Fields>() -> Vec<OptionDescription> {
    let defaults = F::defaults();
    let describe = |(field, values): (&Field, &[f64])| OptionDescription {
        name: field.name,
        unit: field.unit,
        default: if field.required { Vec::new() } else { values.to_vec() },
        limit: field.limit.to_string(),
        doc: field.doc.trim().replace("\n ", "\n"),
        scaled: field.scaled,
    };
    F::FIELDS.iter().zip(defaults.slices()).map(describe).collect()
}

/// Whether a field of [`fields!`] is marked as `scaled`.
#[doc(hidden)]
#[macro_export]
macro_rules! is_scaled {
    () => {
        false
    };
    (scaled) => {
        true
    };
}

/// Defines a struct of numbers: each field with its documentation, default, unit and limit; `scaled` after the limit marks
/// a default for the robot of the paper, which [`Fields::fitted`] scales to other robots. The struct implements
/// [`Fields`], and `Default`, as [`Fields::unset`], if every field has a default.
#[macro_export]
macro_rules! fields {
    (
        $(#[$meta:meta])*
        pub struct $name:ident {
            $($(#[doc = $doc:literal])+ pub $field:ident: $type:ty = $default:expr, $unit:literal, $limit:expr $(, $scaled:ident)?;)*
        }
    ) => {
        $crate::fields! {
            @
            $(#[$meta])*
            pub struct $name {
                $($(#[doc = $doc])+ pub $field: $type = $default, false, $unit, $limit $(, $scaled)?;)*
            }
        }

        impl Default for $name {
            fn default() -> Self {
                <Self as $crate::fields::Fields>::unset()
            }
        }
    };
    (
        $(#[$meta:meta])*
        pub struct $name:ident {
            required {
                $($(#[doc = $r_doc:literal])+ pub $r_field:ident: $r_type:ty, $r_unit:literal, $r_limit:expr;)*
            }
            $($(#[doc = $doc:literal])+ pub $field:ident: $type:ty = $default:expr, $unit:literal, $limit:expr $(, $scaled:ident)?;)*
        }
    ) => {
        $crate::fields! {
            @
            $(#[$meta])*
            pub struct $name {
                $($(#[doc = $r_doc])+ pub $r_field: $r_type
                    = <$r_type as $crate::fields::Numbers>::UNSET, true, $r_unit, $r_limit;)*
                $($(#[doc = $doc])+ pub $field: $type = $default, false, $unit, $limit $(, $scaled)?;)*
            }
        }
    };
    (
        @
        $(#[$meta:meta])*
        pub struct $name:ident {
            $(
                $(#[doc = $doc:literal])+
                pub $field:ident: $type:ty = $default:expr, $required:literal, $unit:literal, $limit:expr $(, $scaled:ident)?;
            )*
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq)]
        pub struct $name {
            $(
                $(#[doc = $doc])+
                #[doc = concat!("\n\nUnit: \"", $unit, "\", limit: `", stringify!($limit), "`.")]
                pub $field: $type,
            )*
        }

        impl $crate::fields::Fields for $name {
            const FIELDS: &'static [$crate::fields::Field] = &[$($crate::fields::Field {
                name: stringify!($field),
                unit: $unit,
                doc: concat!($($doc),+),
                len: <$type as $crate::fields::Numbers>::LEN,
                limit: $limit,
                required: $required,
                scaled: $crate::is_scaled!($($scaled)?),
            },)*];

            fn defaults() -> Self {
                Self { $($field: $default,)* }
            }

            fn slices(&self) -> impl Iterator<Item = &[f64]> {
                [$($crate::fields::Numbers::as_slice(&self.$field),)*].into_iter()
            }

            fn slices_mut(&mut self) -> impl Iterator<Item = &mut [f64]> {
                [$($crate::fields::Numbers::as_mut_slice(&mut self.$field),)*].into_iter()
            }
        }
    };
}
