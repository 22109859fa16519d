//! Tables of options: from named numbers, presets and robot files.

use crate::error::{Error, Result};
use crate::fields::Fields;
use crate::params::robot_file::RobotFile;
use std::path::Path;

/// A struct of fields that is one option of an environment.
pub trait OptionTable: Fields {
    /// Name of the option, also in front of its fields in messages.
    const NAME: &'static str;
    /// Whether one number sets every value of a field.
    const FILLS: bool = false;

    /// Checks numbers within their limits against each other; messages have the names of fields without [`Self::NAME`].
    ///
    /// # Errors
    /// [`Error::OutOfRange`] or [`Error::Inconsistent`], naming the value and the limit.
    fn check_relations(&self) -> Result<()> {
        Ok(())
    }

    /// Options from named numbers, the others at their defaults.
    ///
    /// # Errors
    /// [`Error::UnknownName`], [`Error::Length`]; the errors of [`OptionTable::validate`].
    fn from_fields<'n, 'v>(fields: impl IntoIterator<Item = (&'n str, &'v [f64])>) -> Result<Self> {
        let mut options = Self::defaults();
        for (name, values) in fields {
            match (Self::index_of(name), values) {
                (Some(index), [value]) if Self::FILLS => options.values_mut(index).fill(*value),
                _ => options.set(name, values).map_err(|error| error.of_option(Self::NAME))?,
            }
        }
        options.validate()?;
        Ok(options)
    }

    /// Checks the numbers against their limits and each other.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] or [`Error::Inconsistent`], naming the value and the limit.
    fn validate(&self) -> Result<()> {
        self.check_limits().and_then(|()| self.check_relations()).map_err(|error| error.of_option(Self::NAME))
    }
}

/// Options with presets: a table [`OptionTable::NAME`] in a robot's TOML file.
pub trait PublishedOptions: OptionTable {
    /// The preset of the defaults.
    const DEFAULT: &'static str;

    /// Options by name: [`Self::DEFAULT`], or a robot with published ones.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for a name that is not in [`PublishedOptions::preset_names`].
    fn preset(name: &str) -> Result<Self> {
        if name == Self::DEFAULT {
            return Ok(Self::defaults());
        }
        match RobotFile::preset(name).transpose()?.and_then(Self::published) {
            Some(options) => options,
            None => Err(Error::unknown(Self::NAME, name, &Self::preset_names())),
        }
    }

    /// Names that [`PublishedOptions::preset`] accepts.
    fn preset_names() -> Vec<&'static str> {
        let published = RobotFile::preset_names().iter().copied().filter(|name| {
            let file = RobotFile::preset(name).and_then(Result::ok);
            file.and_then(Self::published).is_some()
        });
        [Self::DEFAULT].into_iter().chain(published).collect()
    }

    /// Options from their table in a robot's TOML file.
    ///
    /// # Errors
    /// [`Error::Io`] for a file that cannot be read; [`Error::Decode`] with the file and the reason that
    /// [`PublishedOptions::from_toml`] gives.
    fn from_toml_file(path: &Path) -> Result<Self> {
        RobotFile::read(path, Self::from_toml)
    }

    /// Options from their table in TOML text.
    ///
    /// # Errors
    /// [`Error::Decode`] for malformed text, values that are not numbers, or no such table; the errors of
    /// [`OptionTable::from_fields`].
    fn from_toml(text: &str) -> Result<Self> {
        let missing =
            || Error::Decode { what: Self::NAME.into(), reason: format!("there is no table [{}]", Self::NAME) };
        Self::published(RobotFile::parse(text)?).ok_or_else(missing)?
    }

    /// The options in a robot's file, if it has any.
    fn published(mut file: RobotFile) -> Option<Result<Self>> {
        let fields = file.options.remove(Self::NAME)?;
        Some(Self::from_fields(fields.iter().map(|(name, values)| (name.as_str(), values.as_slice()))))
    }
}
