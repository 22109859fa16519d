//! A robot's TOML file: its parameters, its motors in the table `[actuators]`, and its sensors in the table `[sensors]`.

use crate::error::{Error, Result};
use crate::files;
use std::collections::HashMap;
use std::path::Path;

/// Name and text of each file in `robots/`, listed by the build script.
const PRESETS: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/presets.rs"));

/// Largest robot file, bytes. Presets have some thousand.
const MAX_SIZE: u64 = 1 << 20;

const NAMES: [&str; PRESETS.len()] = {
    let mut names = [""; PRESETS.len()];
    let mut i = 0;
    while i < names.len() {
        names[i] = PRESETS[i].0;
        i += 1;
    }
    names
};

/// The tables of options.
const TABLES: [&str; 2] = ["actuators", "sensors"];

/// Numbers by name, one or several per name.
pub type NamedNumbers = Vec<(String, Vec<f64>)>;

/// Content of a robot's file, with only the types checked.
pub struct RobotFile {
    /// Parameters.
    pub params: NamedNumbers,
    /// Options of the motors and sensors, by the name of their table.
    pub options: HashMap<&'static str, NamedNumbers>,
}

impl RobotFile {
    /// A published robot by name; `None` if it does not exist.
    pub fn preset(name: &str) -> Option<Result<Self>> {
        PRESETS.iter().find(|(known, _)| *known == name).map(|(_, text)| Self::parse(text))
    }

    /// Names of the published robots, `paper` first.
    pub fn preset_names() -> &'static [&'static str] {
        &NAMES
    }

    /// Result of `read` for the text of a file.
    ///
    /// # Errors
    /// [`Error::Io`] for a file that cannot be read; [`Error::Decode`] with the file and the reason from `read`.
    pub fn read<T>(path: &Path, read: impl FnOnce(&str) -> Result<T>) -> Result<T> {
        let text = files::read_text(path, MAX_SIZE)?;
        read(&text).map_err(|error| {
            let reason = match error {
                Error::Decode { reason, .. } => reason,
                other => other.to_string(),
            };
            Error::Decode { what: path.display().to_string(), reason }
        })
    }

    /// The content of TOML text.
    ///
    /// # Errors
    /// [`Error::Decode`] for malformed text or values that are not numbers.
    pub fn parse(text: &str) -> Result<Self> {
        let mut table: toml::Table = text.parse().map_err(|e: toml::de::Error| decode(e.to_string()))?;
        let mut options = HashMap::new();
        for name in TABLES {
            match table.remove(name) {
                Some(toml::Value::Table(found)) => drop(options.insert(name, numbers(&found)?)),
                Some(other) => return Err(decode(format!("{name} = {other} is not a table"))),
                None => (),
            }
        }
        Ok(Self { params: numbers(&table)?, options })
    }
}

fn decode(reason: String) -> Error {
    Error::Decode { what: "robot parameters".into(), reason }
}

/// The numbers of a table.
fn numbers(table: &toml::Table) -> Result<NamedNumbers> {
    let number = |v: &toml::Value| v.as_float().or(v.as_integer().map(|i| i as f64));
    let named = |(name, value): (&String, &toml::Value)| {
        let values = match value.as_array() {
            Some(array) => array.iter().map(number).collect(),
            None => number(value).map(|v| vec![v]),
        };
        let values = values.ok_or_else(|| decode(format!("{name} = {value} is not a number")))?;
        Ok((name.clone(), values))
    };
    table.iter().map(named).collect()
}
