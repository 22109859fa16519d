//! Parameters as TOML: the published presets, files and text.

use super::Params;
use super::robot_file::RobotFile;
use crate::error::{Error, Result};
use std::fmt::Write;
use std::path::Path;

impl Params {
    /// The robot of the paper, Table II.
    pub fn paper() -> Self {
        Self::preset("paper").expect("the paper's preset is part of the crate and tested")
    }

    /// A published robot by name.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for a name that is not in [`Params::preset_names`].
    pub fn preset(name: &str) -> Result<Self> {
        match RobotFile::preset(name) {
            Some(file) => Self::from_file(&file?),
            None => Err(Error::unknown("robot preset", name, Self::preset_names())),
        }
    }

    /// Names that [`Params::preset`] accepts, `paper` first.
    pub fn preset_names() -> &'static [&'static str] {
        RobotFile::preset_names()
    }

    /// Parameters from a TOML file, one key per field.
    ///
    /// # Errors
    /// [`Error::Io`] for a file that cannot be read; [`Error::Decode`] with the file and the reason from
    /// [`Params::from_toml`].
    pub fn from_toml_file(path: &Path) -> Result<Self> {
        RobotFile::read(path, Self::from_toml)
    }

    /// Parameters from TOML text, one key per field. Tables `[actuators]` and `[sensors]` are read by
    /// `PublishedOptions::from_toml`.
    ///
    /// # Errors
    /// [`Error::Decode`] for malformed text or values that are not numbers; errors of [`Params::from_fields`].
    pub fn from_toml(text: &str) -> Result<Self> {
        Self::from_file(&RobotFile::parse(text)?)
    }

    fn from_file(file: &RobotFile) -> Result<Self> {
        Self::from_fields(file.params.iter().map(|(name, values)| (name.as_str(), values.as_slice())))
    }

    /// All parameters as TOML, which [`Params::from_toml`] reads back to the last bit.
    pub fn to_toml(&self) -> String {
        let mut text = String::new();
        for (name, values) in self.fields() {
            let value = match values {
                [number] => toml::Value::from(*number),
                _ => toml::Value::from(values.to_vec()),
            };
            writeln!(text, "{name} = {value}").expect("a string takes any text");
        }
        text
    }
}
