//! The numbers of a robot that events may change: tables, each with its names.

use crate::actuator::MotorOptions;
use crate::sensor::SensorOptions;
use ballbot_base::error::{Error, Result};
use ballbot_base::fields::{Field, Fields};
use ballbot_base::params::Params;

/// A robot with the options of its stages.
#[derive(Clone, Debug, PartialEq)]
pub struct Setup {
    pub params: Params,
    pub stages: Stages,
}

/// The options of a robot's stages.
#[derive(Clone, Debug, PartialEq)]
pub struct Stages {
    pub actuators: MotorOptions,
    pub sensors: SensorOptions,
}

/// A part of a [`Setup`]. A new stage needs a variant here, and its match arms below.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Table {
    Params,
    Actuators,
    Sensors,
}

impl Table {
    const ALL: [Self; 3] = [Self::Params, Self::Actuators, Self::Sensors];

    /// Prefix of the names of its numbers in a term.
    const fn prefix(self) -> &'static str {
        match self {
            Self::Params => "",
            Self::Actuators => "actuators.",
            Self::Sensors => "sensors.",
        }
    }

    /// Descriptions of its numbers.
    pub const fn fields(self) -> &'static [Field] {
        match self {
            Self::Params => Params::FIELDS,
            Self::Actuators => MotorOptions::FIELDS,
            Self::Sensors => SensorOptions::FIELDS,
        }
    }

    /// The time that a number must be a whole multiple of, s, if any.
    pub fn grain(self, index: usize, sim_dt: f64, control_dt: f64) -> Option<f64> {
        match self {
            Self::Params => None,
            Self::Actuators => MotorOptions::in_model_steps(index).then_some(sim_dt),
            Self::Sensors => SensorOptions::in_control_steps(index).then_some(control_dt),
        }
    }

    /// The table and index of a term.
    ///
    /// # Errors
    /// [`Error::UnknownName`] with all terms, first the terms of `others`.
    pub fn find(term: &str, others: &[&str]) -> Result<(Self, usize)> {
        let place = |table: Self| {
            let name = term.strip_prefix(table.prefix())?;
            Some((table, table.fields().iter().position(|known| known.name == name)?))
        };
        Self::ALL.into_iter().find_map(place).ok_or_else(|| {
            let all = |table: Self| table.fields().iter().map(move |field| format!("{}{}", table.prefix(), field.name));
            let known: Vec<_> = Self::ALL.into_iter().flat_map(all).collect();
            let known: Vec<_> = others.iter().copied().chain(known.iter().map(String::as_str)).collect();
            Error::unknown("term", term, &known)
        })
    }
}

impl Setup {
    /// Numbers of a table, mutable.
    pub fn values_mut(&mut self, table: Table, index: usize) -> &mut [f64] {
        match table {
            Table::Params => self.params.values_mut(index),
            Table::Actuators => self.stages.actuators.values_mut(index),
            Table::Sensors => self.stages.sensors.values_mut(index),
        }
    }
}
