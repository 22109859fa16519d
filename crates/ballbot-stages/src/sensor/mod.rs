//! Sensors: from the state of the model to the state that a task observes.

mod axes;
mod constants;
mod encoders;
pub mod estimator;
mod exact;
mod onboard;
mod options;
mod period;
mod readings;
mod stage;

pub use exact::Exact;
pub use onboard::Onboard;
pub use options::SensorOptions;
pub use readings::Readings;
pub use stage::{EpisodeStart, Sensor};
