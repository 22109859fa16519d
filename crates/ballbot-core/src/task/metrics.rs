//! What an episode is judged by, besides reward and success.

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
    /// From all its parts.
    pub const fn new(name: &'static str, unit: &'static str, doc: &'static str) -> Self {
        Self { name, unit, doc }
    }
}

/// Takes the metrics of an episode, in order; NaN where an episode is too short for one.
pub trait Metrics {
    /// The next metric.
    fn metric(&mut self, metric: Metric, value: f64);
}

/// The values alone.
impl Metrics for Vec<f64> {
    fn metric(&mut self, _: Metric, value: f64) {
        self.push(value);
    }
}

/// The descriptions alone.
impl Metrics for Vec<Metric> {
    fn metric(&mut self, metric: Metric, _: f64) {
        self.push(metric);
    }
}
