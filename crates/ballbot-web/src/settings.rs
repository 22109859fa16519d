//! What a scene is made of, from TOML.

use ballbot_core::control::{Controller, controller_kind};
use ballbot_core::terrain::Terrain;
use ballbot_core::{Error, ModelKind, Params, Result};
use std::sync::Arc;
use toml::{Table, Value};

/// Time step of the models, s.
pub(crate) const SIM_DT: f64 = 0.001;

/// Time steps between two calls of a controller designed for any sampling time: 10 ms, the default of the package.
pub(crate) const STEPS_PER_CONTROL: usize = 10;

/// Most robots of a scene.
const MOST_ROBOTS: i64 = 1000;

/// What the page chooses.
pub(crate) struct Settings {
    /// The robot for which the controller is designed.
    pub(crate) nominal: Params,
    /// The robots.
    pub(crate) params: Params,
    pub(crate) model: ModelKind,
    pub(crate) controller: Box<dyn Controller>,
    pub(crate) terrain: Option<Arc<Terrain>>,
    pub(crate) robots: usize,
    /// Tilt of the first robot at the start, rad; others tilt as far, each in another direction.
    pub(crate) tilt: f64,
}

impl Settings {
    /// From TOML: `robot`, `model`, `controller`, `robots`, `tilt`, and the tables `params`, `options` of the controller
    /// and `terrain`. Omitted settings have their defaults.
    pub(crate) fn parse(text: &str) -> Result<Self> {
        let mut table = read("settings", text)?;
        let robot = take_text(&mut table, "robot", "paper")?;
        let nominal = Params::preset(&robot)?;
        let params = changed(&nominal, &take_table(&mut table, "params")?)?;
        let model: ModelKind = take_text(&mut table, "model", "contact")?.parse()?;
        let kind = controller_kind(&take_text(&mut table, "controller", "lqr")?)?;
        let options = numbers(&take_table(&mut table, "options")?)?;
        let options: Vec<_> = options.iter().map(|(name, values)| (name.as_str(), values.as_slice())).collect();
        let control_dt = kind.control_dt.unwrap_or(SIM_DT * STEPS_PER_CONTROL as f64);
        let controller = (kind.make)(&nominal, control_dt, &kind.limits, &options)?;
        let robots = match table.remove("robots") {
            None => 1,
            Some(Value::Integer(robots)) if (1..=MOST_ROBOTS).contains(&robots) => robots as usize,
            Some(other) => return Err(wrong("robots", &other, &format!("a whole number from 1 to {MOST_ROBOTS}"))),
        };
        let tilt = match table.remove("tilt") {
            None => 0.0,
            Some(value) => match number(&value) {
                Some(tilt) if tilt.abs() <= 1.0 => tilt,
                _ => return Err(wrong("tilt", &value, "within ±1 rad")),
            },
        };
        let terrain = terrain(take_table(&mut table, "terrain")?)?;
        if let Some(name) = table.keys().next() {
            let known = ["robot", "model", "controller", "robots", "tilt", "params", "options", "terrain"];
            return Err(Error::unknown("setting", name, &known));
        }
        Ok(Self { nominal, params, model, controller, terrain, robots, tilt })
    }
}

/// Parameters with changes from a table.
fn changed(params: &Params, table: &Table) -> Result<Params> {
    let changes = numbers(table)?;
    params.replace(changes.iter().map(|(name, values)| (name.as_str(), values.as_slice())))
}

/// Parameters with changes from TOML.
pub(crate) fn changed_by(params: &Params, text: &str) -> Result<Params> {
    changed(params, &read("parameters", text)?)
}

fn read(what: &str, text: &str) -> Result<Table> {
    text.parse().map_err(|error: toml::de::Error| Error::Inconsistent(format!("the {what}: {error}")))
}

fn terrain(mut table: Table) -> Result<Option<Arc<Terrain>>> {
    let kind = take_text(&mut table, "kind", "level")?;
    let seed = match table.remove("seed") {
        None => 0,
        Some(Value::Integer(seed)) if seed >= 0 => seed as u64,
        Some(other) => return Err(wrong("seed", &other, "a whole number from 0")),
    };
    if kind == "level" {
        return match table.keys().next() {
            Some(name) => Err(Error::Inconsistent(format!("level ground has no parameter '{name}': give the kind"))),
            None => Ok(None),
        };
    }
    let parameters = numbers(&table)?;
    let one = |(name, values): &'_ (String, Vec<f64>)| match values[..] {
        [value] => Ok((name.clone(), value)),
        _ => Err(Error::Length { name: name.clone(), found: values.len(), expected: 1 }),
    };
    let parameters = parameters.iter().map(one).collect::<Result<Vec<_>>>()?;
    let parameters: Vec<_> = parameters.iter().map(|(name, value)| (name.as_str(), *value)).collect();
    Terrain::generate(&kind, seed, &parameters).map(|terrain| Some(Arc::new(terrain)))
}

fn take_text(table: &mut Table, name: &str, default: &str) -> Result<String> {
    match table.remove(name) {
        None => Ok(default.into()),
        Some(Value::String(text)) => Ok(text),
        Some(other) => Err(wrong(name, &other, "a name")),
    }
}

fn take_table(table: &mut Table, name: &str) -> Result<Table> {
    match table.remove(name) {
        None => Ok(Table::new()),
        Some(Value::Table(table)) => Ok(table),
        Some(other) => Err(wrong(name, &other, "a table")),
    }
}

/// Numbers and lists of numbers by name.
fn numbers(table: &Table) -> Result<Vec<(String, Vec<f64>)>> {
    table
        .iter()
        .map(|(name, value)| {
            let values = match value {
                Value::Array(values) if !values.is_empty() => values.iter().map(number).collect(),
                one => number(one).map(|number| vec![number]),
            };
            values.map(|values| (name.clone(), values)).ok_or_else(|| wrong(name, value, "a number or numbers"))
        })
        .collect()
}

fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Integer(number) => Some(*number as f64),
        Value::Float(number) => Some(*number),
        _ => None,
    }
}

fn wrong(name: &str, value: &Value, expected: &str) -> Error {
    Error::Inconsistent(format!("{name} = {value}: expected {expected}"))
}
