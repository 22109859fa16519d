//! Parameters and results of terrain generators.

use super::STEEPEST;
use crate::fields::Limit;

/// A parameter of a generator.
pub struct Parameter {
    /// Its name.
    pub name: &'static str,
    /// Its unit; empty for a pure number.
    pub unit: &'static str,
    /// Its default value.
    pub default: f64,
    /// Its permitted values.
    pub limit: Limit,
    /// Its description.
    pub doc: &'static str,
}

pub(super) const fn parameter(
    name: &'static str,
    unit: &'static str,
    default: f64,
    limit: Limit,
    doc: &'static str,
) -> Parameter {
    Parameter { name, unit, default, limit, doc }
}

pub(super) const SLOPES: Limit = Limit::from(0.0).to(STEEPEST);
pub(super) const LENGTHS: Limit = Limit::from(1e-3).to(1e4);

/// A function of x and y.
pub(super) type Height = Box<dyn Fn(f64, f64) -> f64>;

/// Values of the parameters of a kind.
pub(super) struct Values(pub(super) Vec<(&'static str, f64)>);

impl Values {
    /// The value of a parameter of the kind.
    pub(super) fn get(&self, name: &str) -> f64 {
        self.0.iter().find(|(known, _)| *known == name).expect("a parameter of the kind").1
    }
}

/// From 0 at 0 to 1 at 1, with two zero derivatives at both ends.
pub(super) fn smooth_step(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * t * (t * (6.0 * t - 15.0) + 10.0)
}
