//! Lists of events as TOML: files, text, and the sets in this crate.

use super::event::Event;
use super::value::Value;
use ballbot_base::error::{Error, Result};
use ballbot_base::files;
use std::fmt::Write;
use std::path::Path;

/// Name and text of each set.
const SETS: [(&str, &str); 3] = [
    ("mild", include_str!("../../../events/mild.toml")),
    ("hard", include_str!("../../../events/hard.toml")),
    ("wide", include_str!("../../../events/wide.toml")),
];

/// Largest file of events, bytes.
const MAX_SIZE: u64 = 1 << 20;

/// Names of the sets of events in this crate.
pub fn event_sets() -> [&'static str; SETS.len()] {
    SETS.map(|(name, _)| name)
}

/// The events of a set by its name, or of a TOML file by its path, which ends in `.toml`.
///
/// # Errors
/// [`Error::UnknownName`] for an unknown name; [`Error::Io`] for a file that cannot be read; the errors of
/// [`events_from_toml`].
pub fn load_events(name_or_path: &str) -> Result<Vec<Event>> {
    if let Some((_, text)) = SETS.iter().find(|(name, _)| *name == name_or_path) {
        return events_from_toml(text, name_or_path);
    }
    if !name_or_path.ends_with(".toml") {
        let known: Vec<_> = event_sets().into_iter().chain(["the path of a .toml file"]).collect();
        return Err(Error::unknown("set of events", name_or_path, &known));
    }
    let text = files::read_text(Path::new(name_or_path), MAX_SIZE)?;
    events_from_toml(&text, name_or_path)
}

/// Events from TOML text, one table `[[events]]` each; `what` names the text in messages.
///
/// # Errors
/// [`Error::Decode`] for malformed text and keys other than `events`; errors of [`Event::from_entries`].
pub fn events_from_toml(text: &str, what: &str) -> Result<Vec<Event>> {
    let decode = |reason: String| Error::Decode { what: what.to_owned(), reason };
    let table: toml::Table = text.parse().map_err(|e: toml::de::Error| decode(e.to_string()))?;
    if let Some(key) = table.keys().find(|key| *key != "events") {
        return Err(decode(Error::unknown("key", key, &["events"]).to_string()));
    }
    let Some(events) = table.get("events") else { return Ok(Vec::new()) };
    let tables = events.as_array().and_then(|list| list.iter().map(toml::Value::as_table).collect::<Option<Vec<_>>>());
    let Some(tables) = tables else { return Err(decode("'events' is not a list of tables, [[events]]".to_owned())) };
    let event = |(place, table): (usize, &toml::Table)| {
        let entries: Vec<_> = table.iter().map(|(key, value)| (key.clone(), from_toml(value))).collect();
        Event::from_entries(place, &entries).map_err(|error| decode(error.to_string()))
    };
    tables.into_iter().enumerate().map(event).collect()
}

/// Events as TOML text, which [`events_from_toml`] reads back to the last bit.
pub fn events_to_toml(events: &[Event]) -> String {
    let mut text = String::new();
    for event in events {
        text += "[[events]]\n";
        for (key, value) in event.entries() {
            writeln!(text, "{key} = {}", to_toml(&value)).expect("a string takes any text");
        }
        text.push('\n');
    }
    text
}

fn from_toml(value: &toml::Value) -> Value {
    match value {
        toml::Value::Integer(number) => Value::Whole(*number),
        toml::Value::Float(number) => Value::Number(*number),
        toml::Value::Boolean(flag) => Value::Flag(*flag),
        toml::Value::String(text) => Value::Text(text.clone()),
        toml::Value::Array(values) => Value::List(values.iter().map(from_toml).collect()),
        other => Value::Other(other.to_string()),
    }
}

fn to_toml(value: &Value) -> toml::Value {
    match value {
        Value::Whole(number) => (*number).into(),
        Value::Number(number) => (*number).into(),
        Value::Flag(flag) => (*flag).into(),
        Value::Text(text) | Value::Other(text) => text.as_str().into(),
        Value::List(values) => values.iter().map(to_toml).collect::<Vec<_>>().into(),
    }
}
