//! Parameters as TOML: the published presets, files and text.

use super::Params;
use crate::error::{Error, Result};
use crate::files::read_text;
use std::fmt::Write;
use std::path::Path;

/// Name and text of each file in `robots/`, listed by the build script.
const PRESETS: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/presets.rs"));

const NAMES: [&str; PRESETS.len()] = {
    let mut names = [""; PRESETS.len()];
    let mut i = 0;
    while i < names.len() {
        names[i] = PRESETS[i].0;
        i += 1;
    }
    names
};

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
        let Some((_, text)) = PRESETS.iter().find(|(known, _)| *known == name) else {
            return Err(Error::unknown("robot preset", name, Self::preset_names()));
        };
        Self::from_toml(text)
    }

    /// Names that [`Params::preset`] accepts, `paper` first.
    pub fn preset_names() -> &'static [&'static str] {
        &NAMES
    }

    /// Parameters from a TOML file, one key a field.
    ///
    /// # Errors
    /// [`Error::Io`] for a file that cannot be read; [`Error::Decode`] with the file and the reason that
    /// [`Params::from_toml`] gives.
    pub fn from_toml_file(path: &Path) -> Result<Self> {
        let text = read_text(path)?;
        Self::from_toml(&text).map_err(|error| {
            let reason = match error {
                Error::Decode { reason, .. } => reason,
                other => other.to_string(),
            };
            Error::Decode { what: path.display().to_string(), reason }
        })
    }

    /// Parameters from TOML text, one key a field.
    ///
    /// # Errors
    /// [`Error::Decode`] for malformed text or values that are not numbers; those of [`Params::from_fields`].
    pub fn from_toml(text: &str) -> Result<Self> {
        let decode = |reason: String| Error::Decode { what: "robot parameters".into(), reason };
        let table: toml::Table = text.parse().map_err(|e: toml::de::Error| decode(e.to_string()))?;
        let mut fields = Vec::with_capacity(table.len());
        for (name, value) in &table {
            let number = |v: &toml::Value| v.as_float().or(v.as_integer().map(|i| i as f64));
            let values = match value.as_array() {
                Some(array) => array.iter().map(number).collect(),
                None => number(value).map(|v| vec![v]),
            };
            let values = values.ok_or_else(|| decode(format!("{name} = {value} is not a number")))?;
            fields.push((name.as_str(), values));
        }
        Self::from_fields(fields.iter().map(|(name, values)| (*name, values.as_slice())))
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
