//! What the robot senses, as float32.

use super::ACTION_LEN;
use crate::state::State;
use nalgebra::{Vector2, Vector3};

/// One number of the observation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObservationRow {
    /// What it is.
    pub name: &'static str,
    /// Its unit, empty for a pure number.
    pub unit: &'static str,
    /// Bound of its magnitude; beyond it the sensor saturates.
    pub bound: f32,
}

/// How many numbers an observation has.
pub const OBSERVATION_LEN: usize = 16;

const fn row(name: &'static str, unit: &'static str, bound: f32) -> ObservationRow {
    ObservationRow { name, unit, bound }
}

/// The observation, row by row. The heading frame has the robot's yaw and a vertical z axis; positions and velocities are
/// relative to the setpoint. Nothing depends on where the setpoint is or where the robot faces.
pub const OBSERVATION: [ObservationRow; OBSERVATION_LEN] = [
    row("gravity direction, body x", "", 1.0),
    row("gravity direction, body y", "", 1.0),
    row("gravity direction, body z", "", 1.0),
    row("body rate about body x", "rad/s", 20.0),
    row("body rate about body y", "rad/s", 20.0),
    row("body rate about body z", "rad/s", 20.0),
    row("wheel speed 0", "rad/s", 200.0),
    row("wheel speed 1", "rad/s", 200.0),
    row("wheel speed 2", "rad/s", 200.0),
    row("ball position from the setpoint, heading x", "m", 10.0),
    row("ball position from the setpoint, heading y", "m", 10.0),
    row("ball velocity, heading x", "m/s", 10.0),
    row("ball velocity, heading y", "m/s", 10.0),
    row("last action, wheel 0", "", 1.0),
    row("last action, wheel 1", "", 1.0),
    row("last action, wheel 2", "", 1.0),
];

/// Writes the observation of `state`, saturated at its bounds. A state that is not finite reads as zero: it ends its
/// episode, and nothing that is not a number may reach a learner.
pub(super) fn observe(state: &State, setpoint: &Vector2<f64>, last_action: &[f32; ACTION_LEN], out: &mut [f32]) {
    let gravity = state.body_quaternion.inverse_transform_vector(&-Vector3::z());
    let position = state.to_heading(state.ball_position.xy() - setpoint);
    let velocity = state.to_heading(state.ball_velocity.xy());
    let sensed = gravity
        .iter()
        .chain(state.body_angular_velocity.iter())
        .chain(state.wheel_speeds.iter())
        .chain(position.iter())
        .chain(velocity.iter())
        .map(|&v| v as f32)
        .chain(last_action.iter().copied());
    for ((value, row), out) in sensed.zip(&OBSERVATION).zip(out) {
        *out = if value.is_nan() { 0.0 } else { value.clamp(-row.bound, row.bound) };
    }
}
