//! Configuration of an event: the same keys in Rust, Python and TOML.

use super::setup::Table;
use super::value::Value;
use ballbot_base::error::{Error, Result};
use ballbot_base::names;
use ballbot_base::params::Params;
use ballbot_models::Scale;
use std::str::FromStr;

/// The term that applies an impulse to the body; all other terms are numbers of the robot.
pub(super) const PUSH: &str = "push";

/// The term that applies a force to the body over time.
pub(super) const FORCE: &str = "force";

/// The terms that act on the body.
pub(super) const LOADS: [&str; 2] = [PUSH, FORCE];

/// Key of the random numbers of a task's own pushes: no 32-bit checksum can equal it.
pub const TASK_ID: u64 = 1 << 40;

/// When an event samples. All fire before the action of a control step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum When {
    /// Once per environment: when it is created, and at the first reset after it was seeded.
    Startup,
    /// At each reset.
    Reset,
    /// Repeatedly in an episode, at intervals sampled uniformly from this range, s.
    Every([f64; 2]),
    /// Once per episode, at this time, s.
    At(f64),
}

impl When {
    /// Whether it is within an episode.
    pub(super) fn is_timed(self) -> bool {
        matches!(self, Self::Every(_) | Self::At(_))
    }
}

/// What a draw does to the nominal value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// It replaces the value.
    Abs,
    /// It is added to the value.
    Add,
    /// It multiplies the value.
    Scale,
    /// It is added to the value; the range is for the paper's robot, and is scaled to the robot that the environment was
    /// made with: lengths with the height of the CoM, all else by [`ballbot_models::Scale`].
    AddScaled,
}

/// Distribution of draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Distribution {
    /// Uniform between low and high.
    Uniform,
    /// Uniform in the logarithm between low and high.
    LogUniform,
    /// Normal with mean and standard deviation, truncated at three standard deviations.
    Normal,
}

/// Direction of a push or a force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Direction {
    /// Horizontal, with uniformly sampled azimuth.
    Uniform,
    /// Horizontal, at this azimuth in the inertial frame, rad.
    Azimuth(f64),
}

/// Names of the modes.
const MODES: [&str; 4] = ["startup", "reset", "interval", "at"];

/// All keys of an event.
const KEYS: [&str; 14] = [
    "term",
    "mode",
    "every",
    "at",
    "op",
    "dist",
    "range",
    "shared",
    "id",
    "optional",
    "direction",
    "height",
    "duration",
    "frequency",
];

impl Operation {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Abs, Self::Add, Self::Scale, Self::AddScaled];

    /// The name by which it is chosen.
    pub fn name(self) -> &'static str {
        match self {
            Self::Abs => "abs",
            Self::Add => "add",
            Self::Scale => "scale",
            Self::AddScaled => "add_scaled",
        }
    }
}

impl FromStr for Operation {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        names::find("op", name, Self::ALL, Self::name)
    }
}

impl Distribution {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Uniform, Self::LogUniform, Self::Normal];

    /// The name by which it is chosen.
    pub fn name(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::LogUniform => "log_uniform",
            Self::Normal => "normal",
        }
    }
}

impl FromStr for Distribution {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        names::find("dist", name, Self::ALL, Self::name)
    }
}

/// What changes, when, and how it is sampled. SI units and radians.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// The name of a parameter; `actuators.` or `sensors.` and the name of an option; `push` or `force`.
    pub term: String,
    /// When it samples.
    pub when: When,
    /// What a draw does. For a push, [`Operation::Abs`] samples the impulse, N·s, and [`Operation::Scale`] the change
    /// of velocity, m/s; multiplied by the nominal mass of the body it is the impulse. For a force these are the force, N,
    /// and the acceleration, m/s².
    pub operation: Operation,
    /// Distribution of the draws.
    pub distribution: Distribution,
    /// Low and high, or mean and standard deviation: one pair for all numbers of the term, each sampled separately, or
    /// one pair each.
    pub range: Vec<[f64; 2]>,
    /// Whether all numbers of the term have a common draw; `range` is then one pair.
    pub shared: bool,
    /// The key of its random numbers, at least 1; `None` takes the checksum (CRC-32) of the term's name. It must be
    /// unique in a list of events.
    pub id: Option<u64>,
    /// Whether it is accepted where it changes nothing, such as friction in a model without slip.
    pub optional: bool,
    /// Only for a push or a force.
    pub direction: Direction,
    /// Only for a push or a force: height of its point of application on the mast above the ball's center, m, uniform between the
    /// two. `None` is the body's center of mass.
    pub height: Option<[f64; 2]>,
    /// Only for a push or a force. Of a push the time over which its impulse is spread in equal parts, one per control step,
    /// s; 0 is at once. Of a force the time for which it acts, s; 0 is until the next force or the end of the episode.
    pub duration: f64,
    /// Only for a force: frequency of a sine that begins at zero, with the sampled amplitude, Hz; 0 is a constant force.
    pub frequency: f64,
}

impl Event {
    /// An event that replaces a term's value at each reset by a uniform sample from `range`.
    pub fn new(term: &str, range: [f64; 2]) -> Self {
        Self {
            term: term.to_owned(),
            when: When::Reset,
            operation: Operation::Abs,
            distribution: Distribution::Uniform,
            range: vec![range],
            shared: false,
            id: None,
            optional: false,
            direction: Direction::Uniform,
            height: None,
            duration: 0.0,
            frequency: 0.0,
        }
    }

    /// Whether it is a push or a force.
    pub(super) fn is_load(&self) -> bool {
        LOADS.contains(&self.term.as_str())
    }

    /// The event on a robot: [`Operation::Add`] in place of [`Operation::AddScaled`].
    ///
    /// # Errors
    /// [`Error::Inconsistent`] for an unknown term, or a term whose unit does not scale.
    pub(super) fn on_robot(&self, place: usize, params: &Params) -> Result<Self> {
        // The plan rejects pushes and forces.
        if self.operation != Operation::AddScaled || self.is_load() {
            return Ok(self.clone());
        }
        let invalid = |reason: &dyn std::fmt::Display| invalid_event(place, &self.term, reason);
        let (table, index) = Table::find(&self.term, &LOADS).map_err(|e| invalid(&e))?;
        let unit = table.fields()[index].unit;
        let factor = match unit {
            "m" => Some(params.body_com_height / Params::paper().body_com_height),
            // Masses of parts and preloads do not scale with the mass of the whole robot.
            "kg" | "N" | "N·s/m" => None,
            _ => Scale::of(params).factor(unit),
        };
        let factor = factor.ok_or_else(|| {
            invalid(&format!("op = 'add_scaled' has no scale for the unit '{unit}': expected 'add' or 'scale'"))
        })?;
        let range = self.range.iter().map(|pair| pair.map(|value| value * factor)).collect();
        Ok(Self { operation: Operation::Add, range, ..self.clone() })
    }

    /// The term's name, with the id where one is given: `term:id`; `push:task` for the pushes of a task.
    pub fn label(&self) -> String {
        match self.id {
            None => self.term.clone(),
            Some(TASK_ID) => format!("{}:task", self.term),
            Some(id) => format!("{}:{id}", self.term),
        }
    }

    /// An event from its keys and values; `place` is its index in the list of events, for messages.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] with place and term: an unknown or missing key, or a value of the wrong kind. The
    /// numbers are checked together with the robot, by [`crate::batch::EnvConfig::validate`].
    pub fn from_entries(place: usize, entries: &[(String, Value)]) -> Result<Self> {
        let value = |key: &str| entries.iter().find(|(name, _)| name == key).map(|(_, value)| value);
        let term = match value("term") {
            Some(Value::Text(term)) => term,
            Some(other) => return Err(invalid_event(place, "?", &format!("term = {other} is not text"))),
            None => return Err(invalid_event(place, "?", &"it has no key 'term'")),
        };
        let invalid = |reason: &dyn std::fmt::Display| invalid_event(place, term, reason);
        let kind = |key: &str, what: &str, value: &Value| invalid(&format!("{key} = {value} is not {what}"));
        if let Some((key, _)) = entries.iter().find(|(key, _)| !KEYS.contains(&key.as_str())) {
            return Err(invalid(&Error::unknown("key", key, &KEYS)));
        }
        let text = |key: &str| match value(key) {
            None => Ok(None),
            Some(Value::Text(text)) => Ok(Some(text.as_str())),
            Some(other) => Err(kind(key, "text", other)),
        };
        let pair = |key: &str| {
            value(key).map(|v| v.pair().ok_or_else(|| kind(key, "a pair of numbers, [low, high]", v))).transpose()
        };
        let number = |key: &str| value(key).map(|v| v.number().ok_or_else(|| kind(key, "a number", v))).transpose();
        let mut event = Self::new(term, [0.0; 2]);
        event.range = match value("range") {
            None => return Err(invalid(&"it has no key 'range'")),
            Some(range) => ranges(range)
                .ok_or_else(|| kind("range", "a pair of numbers, [low, high], or a list of pairs", range))?,
        };
        event.when = when(text("mode")?, pair("every")?, number("at")?).map_err(|e| invalid(&e))?;
        if let Some(name) = text("op")? {
            event.operation = name.parse().map_err(|e: Error| invalid(&e))?;
        }
        if let Some(name) = text("dist")? {
            event.distribution = name.parse().map_err(|e: Error| invalid(&e))?;
        }
        let flag = |key: &str| match value(key) {
            None => Ok(false),
            Some(Value::Flag(flag)) => Ok(*flag),
            Some(other) => Err(kind(key, "true or false", other)),
        };
        event.shared = flag("shared")?;
        event.optional = flag("optional")?;
        event.id = match value("id") {
            None => None,
            Some(Value::Whole(id)) if *id >= 1 => Some(id.unsigned_abs()),
            Some(other) => return Err(kind("id", "a whole number from 1 to 2^63 - 1", other)),
        };
        if !event.is_load()
            && let Some(key) = ["direction", "height", "duration"].into_iter().find(|key| value(key).is_some())
        {
            return Err(invalid(&format!("{key} is only for the terms '{PUSH}' and '{FORCE}'")));
        }
        if term != FORCE && value("frequency").is_some() {
            return Err(invalid(&format!("frequency is only for the term '{FORCE}'")));
        }
        event.direction = match value("direction") {
            None => Direction::Uniform,
            Some(Value::Text(text)) if text == "uniform" => Direction::Uniform,
            Some(other) => Direction::Azimuth(
                other.number().ok_or_else(|| kind("direction", "'uniform' or an azimuth in rad", other))?,
            ),
        };
        event.height = match value("height") {
            Some(value) if value.number().is_some() => value.number().map(|height| [height; 2]),
            _ => pair("height")?,
        };
        event.duration = number("duration")?.unwrap_or(0.0);
        event.frequency = number("frequency")?.unwrap_or(0.0);
        Ok(event)
    }

    /// Its keys and values, which [`Event::from_entries`] reads back; keys that do not apply are omitted.
    pub fn entries(&self) -> Vec<(&'static str, Value)> {
        let text = |text: &str| Value::Text(text.to_owned());
        let mode = match self.when {
            When::Startup => MODES[0],
            When::Reset => MODES[1],
            When::Every(_) => MODES[2],
            When::At(_) => MODES[3],
        };
        let mut entries = vec![("term", text(&self.term)), ("mode", text(mode))];
        match self.when {
            When::Every(gap) => entries.push(("every", gap.into())),
            When::At(time) => entries.push(("at", Value::Number(time))),
            When::Startup | When::Reset => (),
        }
        entries.push(("op", text(self.operation.name())));
        entries.push(("dist", text(self.distribution.name())));
        let range = match self.range.as_slice() {
            [pair] => (*pair).into(),
            pairs => Value::List(pairs.iter().map(|&pair| pair.into()).collect()),
        };
        entries.push(("range", range));
        if self.shared {
            entries.push(("shared", Value::Flag(true)));
        }
        if let Some(id) = self.id {
            entries.push(("id", Value::Whole(i64::try_from(id).unwrap_or(i64::MAX))));
        }
        if self.optional {
            entries.push(("optional", Value::Flag(true)));
        }
        if self.is_load() {
            entries.push((
                "direction",
                match self.direction {
                    Direction::Uniform => text("uniform"),
                    Direction::Azimuth(azimuth) => Value::Number(azimuth),
                },
            ));
            entries.extend(self.height.map(|height| ("height", height.into())));
            if self.duration != 0.0 {
                entries.push(("duration", Value::Number(self.duration)));
            }
            if self.frequency != 0.0 {
                entries.push(("frequency", Value::Number(self.frequency)));
            }
        }
        entries
    }
}

/// The error for the event at `place`.
pub fn invalid_event(place: usize, term: &str, reason: &dyn std::fmt::Display) -> Error {
    Error::Inconsistent(format!("events[{place}] ({term}): {reason}"))
}

/// One pair, or one pair per number.
fn ranges(value: &Value) -> Option<Vec<[f64; 2]>> {
    if let Some(pair) = value.pair() {
        return Some(vec![pair]);
    }
    match value {
        Value::List(pairs) if !pairs.is_empty() => pairs.iter().map(Value::pair).collect(),
        _ => None,
    }
}

/// The mode that the keys `mode`, `every` and `at` describe.
fn when(mode: Option<&str>, every: Option<[f64; 2]>, at: Option<f64>) -> Result<When> {
    let implied = match (every, at) {
        (Some(_), Some(_)) => return Err(Error::Inconsistent("it has both keys, 'every' and 'at'".into())),
        (Some(_), None) => "interval",
        (None, Some(_)) => "at",
        (None, None) => "reset",
    };
    let mode = mode.unwrap_or(implied);
    match (mode, every, at) {
        ("startup", None, None) => Ok(When::Startup),
        ("reset", None, None) => Ok(When::Reset),
        ("interval", Some(gap), None) => Ok(When::Every(gap)),
        ("at", None, Some(time)) => Ok(When::At(time)),
        ("interval", ..) => Err(Error::Inconsistent("mode 'interval' needs the key 'every' = [low, high] s".into())),
        ("at", ..) => Err(Error::Inconsistent("mode 'at' needs the key 'at' = time in s".into())),
        ("startup" | "reset", ..) => {
            Err(Error::Inconsistent(format!("'every' and 'at' have no meaning in mode '{mode}'")))
        }
        _ => Err(Error::unknown("mode", mode, &MODES)),
    }
}
