//! Metrics of an episode, in addition to reward and success.

/// Description of a metric of an episode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metric {
    /// Its name.
    pub name: &'static str,
    /// Its unit; empty for a pure number.
    pub unit: &'static str,
    /// What it is.
    pub doc: &'static str,
}

impl Metric {
    /// A metric from its parts.
    pub const fn new(name: &'static str, unit: &'static str, doc: &'static str) -> Self {
        Self { name, unit, doc }
    }
}

/// Receives the metrics of an episode, in order; NaN where an episode is too short for a metric.
pub trait Metrics {
    /// The next metric.
    fn metric(&mut self, metric: Metric, value: f64);
}

/// Only the values.
impl Metrics for Vec<f64> {
    fn metric(&mut self, _: Metric, value: f64) {
        self.push(value);
    }
}

/// Only the descriptions.
impl Metrics for Vec<Metric> {
    fn metric(&mut self, metric: Metric, _: f64) {
        self.push(metric);
    }
}
