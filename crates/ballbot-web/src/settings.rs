//! What a scene is made of, from TOML.

use ballbot_core::batch::{History, Layer, policy_controller};
use ballbot_core::control::{Admittance, Controller, NamedLaw, controller_kind};
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
    /// Whether the controller yields to a force.
    pub(crate) yields: bool,
    pub(crate) terrain: Option<Arc<Terrain>>,
    pub(crate) robots: usize,
    /// Tilt of the first robot at the start, rad; others tilt as far, each in another direction.
    pub(crate) tilt: f64,
}

impl Settings {
    /// From TOML: `robot`, `model`, `controller`, `robots`, `tilt`, and the tables `params`, `options` of the controller,
    /// `terrain`, and `policy` in place of a controller. Omitted settings have their defaults.
    pub(crate) fn parse(text: &str) -> Result<Self> {
        let mut table = read("settings", text)?;
        let robot = take_text(&mut table, "robot", "paper")?;
        let nominal = Params::preset(&robot)?;
        let params = changed(&nominal, &take_table(&mut table, "params")?)?;
        let model: ModelKind = take_text(&mut table, "model", "contact")?.parse()?;
        let yields = table.get("controller").and_then(Value::as_str) == Some(Admittance::NAME);
        let controller = match table.remove("policy") {
            None => law(&nominal, &mut table)?,
            Some(Value::Table(policy)) => {
                match ["controller", "options"].iter().find(|name| table.contains_key(**name)) {
                    None => network(&nominal, policy)?,
                    Some(name) => {
                        return Err(Error::Inconsistent(format!(
                            "a policy is in place of a controller: omit '{name}'"
                        )));
                    }
                }
            }
            Some(other) => return Err(wrong("policy", &other, "a table")),
        };
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
            let known = ["robot", "model", "controller", "robots", "tilt", "params", "options", "terrain", "policy"];
            return Err(Error::unknown("setting", name, &known));
        }
        Ok(Self { nominal, params, model, controller, yields, terrain, robots, tilt })
    }
}

/// A controller by its name, with its options.
fn law(params: &Params, table: &mut Table) -> Result<Box<dyn Controller>> {
    let kind = controller_kind(&take_text(table, "controller", "lqr")?)?;
    let options = numbers(&take_table(table, "options")?)?;
    let control_dt = kind.control_dt.unwrap_or(SIM_DT * STEPS_PER_CONTROL as f64);
    (kind.make)(params, control_dt, &kind.limits, &named(&options))
}

/// A policy: its `task`, the `widths` of its observation and layers, how many of these are LSTM `cells`, which come first,
/// the `numbers` of each layer, weights then biases, the ages of its `history`, and options of its environment.
fn network(params: &Params, mut table: Table) -> Result<Box<dyn Controller>> {
    let task = take_text(&mut table, "task", "balance")?;
    let mut options = numbers(&table)?;
    let mut take = |name: &str| {
        let place = options.iter().position(|(option, _)| option == name);
        place.map(|place| options.swap_remove(place).1)
    };
    let missing = |name: &str| Error::Inconsistent(format!("the policy has no {name}"));
    let widths = take("widths").ok_or_else(|| missing("widths"))?;
    let numbers = take("numbers").ok_or_else(|| missing("numbers"))?;
    let history = take("history").map_or(Ok(History::default()), |ages| History::of_ages(&ages))?;
    let whole = |width: &f64| match *width {
        width if (1.0..=1e4).contains(&width) && width.fract() == 0.0 => Ok(width as usize),
        value => {
            Err(Error::OutOfRange { name: "widths".into(), value, limit: "a whole number from 1 to 10000".into() })
        }
    };
    let widths = widths.iter().map(whole).collect::<Result<Vec<_>>>()?;
    let most = widths.len().saturating_sub(1);
    let cells = match take("cells").as_deref() {
        None => 0,
        Some([count]) if (0.0..=most as f64).contains(count) && count.fract() == 0.0 => *count as usize,
        Some(_) => {
            return Err(Error::Inconsistent(format!("cells of the policy: expected a whole number up to {most}")));
        }
    };
    // Inputs and outputs of each layer; of a cell they include its own outputs, and four gates.
    let shapes: Vec<_> = widths
        .windows(2)
        .enumerate()
        .map(|(k, pair)| if k < cells { (pair[0] + pair[1], 4 * pair[1]) } else { (pair[0], pair[1]) })
        .collect();
    let expected = shapes.iter().map(|(inputs, outputs)| outputs * (inputs + 1)).sum();
    if numbers.len() != expected {
        return Err(Error::Length { name: "numbers of the policy".into(), found: numbers.len(), expected });
    }
    let mut rest = &numbers[..];
    let layers: Vec<_> = shapes
        .into_iter()
        .map(|(inputs, outputs)| {
            let (weights, others) = rest.split_at(inputs * outputs);
            let (biases, others) = others.split_at(outputs);
            rest = others;
            Layer { inputs, outputs, weights, biases }
        })
        .collect();
    let (cells, layers) = layers.split_at(cells);
    policy_controller(&task, params, &named(&options), &history, cells, layers)
}

fn named(options: &[(String, Vec<f64>)]) -> Vec<(&str, &[f64])> {
    options.iter().map(|(name, values)| (name.as_str(), values.as_slice())).collect()
}

/// Parameters with changes from a table.
fn changed(params: &Params, table: &Table) -> Result<Params> {
    let changes = numbers(table)?;
    params.replace(named(&changes))
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
